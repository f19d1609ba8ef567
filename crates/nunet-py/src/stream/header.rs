//! The header of a message.

use nunet_engine::hexadecimal;
use nunet_ipc::UnknownValue;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{NunetError, hinted};

/// The hint for a message that violates the contract.
pub(super) const VIOLATION: &str = "update the sender: it violates the shared-memory contract";

/// The header of a message: the fields of the shared-memory contract, enums as `str`.
#[pyclass(frozen, get_all, eq, module = "nunet_py")]
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FrameHeader {
    /// Version of the contract.
    contract_version: u32,
    /// `rgb`, `depth`, `labels`, `confidence`, `cloud`, `obstacles` or `stats`.
    topic: &'static str,
    /// Number of the frame: equal in all topics of a frame. It increases from an arbitrary start.
    sequence: u64,
    /// Capture time of the image, nanoseconds of `capture_clock`.
    capture_nanos: i64,
    /// Capture time of the image, nanoseconds since 1970-01-01 UTC; 0 if unknown.
    capture_unix_nanos: i64,
    /// Time at which this message was sent, nanoseconds of `time.monotonic_ns()`.
    publish_nanos: i64,
    /// `monotonic` (that of `time.monotonic_ns()`), `unix` or `media` (the position in a recording).
    capture_clock: &'static str,
    /// `depth_f32`, `labels_u8`, `confidence_u8`, `points`, `obstacle_record`, `stats_record`, or of an
    /// image: `rgb8`, `bgr8`, `mono8`, `yuyv`, `nv12`.
    encoding: &'static str,
    /// Number of columns, pixels or points.
    width: u32,
    /// Number of rows.
    height: u32,
    /// Bytes from one row to the next.
    row_stride_bytes: u32,
    /// `metre`, `relative` (depth without a scale) or `none`.
    units: &'static str,
    /// Size of the payload, bytes.
    payload_bytes: u64,
    /// `metric`, `focal_scaled`, `assumed_camera`, `relative`, `calibrated` or `floor`; meaningless if
    /// `units` is `none`.
    scale_source: &'static str,
    /// `full` or `reused_labels` (from an earlier frame).
    quality: &'static str,
    /// Horizontal focal length at `width` x `height`, pixels; 0 if the camera is unknown.
    fx: f64,
    /// Vertical focal length, pixels.
    fy: f64,
    /// Column of the principal point, pixels; 0 is the center of the first pixel.
    cx: f64,
    /// Row of the principal point, pixels.
    cy: f64,
    /// The 14 coefficients of `distortion_model`; unused ones are 0.
    distortion: [f64; 14],
    /// `none`, `brown_conrady` or `kannala_brandt`.
    distortion_model: &'static str,
    /// Number of stages that ran.
    stage_count: u32,
    /// SHA-256 of the model file, in hexadecimal; `None` for images of a camera.
    model_hash: Option<String>,
    /// Microseconds of each stage for this frame; `Stats.stages_ms` has their names in the same order.
    stage_micros: Vec<u32>,
    /// Bytes copied for this frame: for the network's input, for reused labels, and for resized results.
    bytes_copied: u64,
    /// Number of NaN pixels of the depth map.
    invalid_pixels: u64,
    /// The name of the camera's coordinate frame; of the robot's base for `obstacles`.
    frame_id: String,
    /// Factor by which the network's meters were multiplied; 0 if unknown.
    scale_factor: f64,
    /// Nanoseconds since `scale_factor` was measured; 0 for one that does not change.
    scale_age_nanos: i64,
    /// First column of the part of the camera's image that this message covers, pixels of the image.
    view_x: u32,
    /// First row of this part.
    view_y: u32,
    /// Columns of this part; 0 if it is unknown, and in images.
    view_width: u32,
    /// Rows of this part; 0 if it is unknown, and in images.
    view_height: u32,
}

impl FrameHeader {
    /// Reads a header.
    ///
    /// # Errors
    /// `NunetError` for a number that no enum of the contract has.
    pub(super) fn read(header: &nunet_ipc::FrameHeader) -> PyResult<Self> {
        let known = header.model_hash.iter().any(|byte| *byte != 0);
        Ok(Self {
            contract_version: header.contract_version,
            topic: header.topic().map_err(unknown)?.name(),
            sequence: header.sequence,
            capture_nanos: header.capture_nanos,
            capture_unix_nanos: header.capture_unix_nanos,
            publish_nanos: header.publish_nanos,
            capture_clock: header.capture_clock().map_err(unknown)?.name(),
            encoding: header.encoding().map_err(unknown)?.name(),
            width: header.width,
            height: header.height,
            row_stride_bytes: header.row_stride_bytes,
            units: header.units().map_err(unknown)?.name(),
            payload_bytes: header.payload_bytes,
            scale_source: header.scale_source().map_err(unknown)?.name(),
            quality: header.quality().map_err(unknown)?.name(),
            fx: header.fx,
            fy: header.fy,
            cx: header.cx,
            cy: header.cy,
            distortion: header.distortion,
            distortion_model: header.distortion_model().map_err(unknown)?.name(),
            stage_count: header.stage_count,
            model_hash: known.then(|| hexadecimal(&header.model_hash)),
            stage_micros: header.stages().to_vec(),
            bytes_copied: header.bytes_copied,
            invalid_pixels: header.invalid_pixels,
            frame_id: header.frame_id().into_owned(),
            scale_factor: header.scale_factor,
            scale_age_nanos: header.scale_age_nanos,
            view_x: header.view_x,
            view_y: header.view_y,
            view_width: header.view_width,
            view_height: header.view_height,
        })
    }
}

#[pymethods]
impl FrameHeader {
    /// All fields by name, in the order of the contract.
    fn as_dict<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyDict>> {
        let fields = PyDict::new(slf.py());
        for field in nunet_ipc::FrameHeader::FIELDS.iter().filter(|field| field.name != "reserved") {
            fields.set_item(field.name, slf.getattr(field.name)?)?;
        }
        Ok(fields)
    }

    fn __repr__(slf: &Bound<'_, Self>) -> PyResult<String> {
        let fields = Self::as_dict(slf)?;
        let parts = fields.iter().map(|(name, value)| Ok(format!("{name}={}", value.repr()?)));
        Ok(format!("FrameHeader({})", parts.collect::<PyResult<Vec<_>>>()?.join(", ")))
    }
}

/// The error for a number in a header that no enum of the contract has.
pub(super) fn unknown(error: UnknownValue) -> PyErr {
    hinted::<NunetError>(error, VIOLATION)
}
