//! What a picture became.

use std::num::NonZeroU32;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{Ix2, Ix3, PyArray2, PyArray3, PyArrayMethods as _};
use nunet_core::camera::{self, RayTable};
use nunet_core::cloud::{CloudPoint, organised_cloud};
use nunet_daemon::embed::{self, Inferred, Played};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::camera::Camera;
use crate::cloud::Cloud;
use crate::error::{NunetError, of_camera};
use crate::memory::array;

/// What a model and its results have in common.
pub(crate) struct Shared {
    pub(crate) class_names: Py<PyTuple>,
    pub(crate) stage_names: Vec<String>,
    /// The rays of the last cloud: those of a stream are computed once.
    rays: Mutex<Option<(camera::Camera, Arc<RayTable>)>>,
}

impl Shared {
    pub(crate) fn new(class_names: Py<PyTuple>, stage_names: Vec<String>) -> Self {
        Self { class_names, stage_names, rays: Mutex::default() }
    }

    fn rays(&self, camera: camera::Camera) -> Arc<RayTable> {
        let mut kept = self.rays.lock().unwrap_or_else(PoisonError::into_inner);
        match &*kept {
            Some((of, rays)) if *of == camera => Arc::clone(rays),
            _ => Arc::clone(&kept.insert((camera, Arc::new(RayTable::new(&camera)))).1),
        }
    }
}

/// Where a picture came from, where it was one of a recording.
#[derive(Default)]
pub(crate) struct Origin {
    topic: Option<String>,
    frame_id: Option<String>,
    sequence: Option<u64>,
    capture_nanos: Option<i64>,
}

/// Depth, labels and where they come from, of one picture. The arrays are this result's own; nothing writes into them
/// later.
///
/// Attributes
/// ----------
/// depth : numpy.ndarray
///     float32 (H, W), rows from the top: distance along the optical axis, in `units`. NaN where there is none.
/// labels : numpy.ndarray or None
///     uint8 (H, W): indices into `class_names`; `None` where the network does not segment.
/// class_names : tuple of str
///     The name of each label.
/// rgb : numpy.ndarray
///     uint8 (H, W, 3): the picture as the network saw it, pixel on pixel with `depth`.
/// units : str
///     `metre`, or `relative` for nearer and farther without a unit.
/// scale_source : str
///     `metric`: the network's own metres. `focal_scaled`: metres corrected for the camera's focal length.
///     `assumed_camera`: metres as if the training camera had taken the picture; give a camera to have them corrected.
///     `relative`: no scale.
/// timings : dict of str to float
///     Milliseconds of each stage in order, and `total` of all with the results' memory.
/// invalid_pixels : int
///     Pixels of `depth` that are NaN.
/// quality : str
///     `full`, or `reused_labels` where a stage was skipped.
/// camera : Camera or None
///     The camera at the size of `depth`; `None` where nobody knows it.
/// capture_nanos : int or None
///     Of a recording: the picture's stamp, nanoseconds since 1970.
/// topic, frame_id : str or None
///     Of a recording: the picture's topic and coordinate frame.
/// sequence : int or None
///     Of a recording: the picture's place in it, from 0.
#[pyclass(frozen, module = "nunet_py")]
pub(crate) struct Result {
    #[pyo3(get)]
    depth: Py<PyArray2<f32>>,
    #[pyo3(get)]
    labels: Option<Py<PyArray2<u8>>>,
    #[pyo3(get)]
    rgb: Py<PyArray3<u8>>,
    #[pyo3(get)]
    units: &'static str,
    #[pyo3(get)]
    scale_source: &'static str,
    #[pyo3(get)]
    timings: Py<PyDict>,
    #[pyo3(get)]
    invalid_pixels: u32,
    #[pyo3(get)]
    quality: &'static str,
    #[pyo3(get)]
    camera: Option<Camera>,
    origin: Origin,
    points_camera: camera::Camera,
    frame_size: (u32, u32),
    shared: Arc<Shared>,
}

impl Result {
    /// The results of a picture of `frame_size`.
    pub(crate) fn of_picture(
        py: Python<'_>,
        inferred: Inferred,
        frame_size: (u32, u32),
        shared: Arc<Shared>,
    ) -> PyResult<Self> {
        Self::new(py, inferred, frame_size, Origin::default(), shared)
    }

    /// The results of a picture of a recording.
    pub(crate) fn of_recording(
        py: Python<'_>,
        played: Played,
        topic: String,
        shared: Arc<Shared>,
    ) -> PyResult<Self> {
        let origin = Origin {
            topic: Some(topic),
            frame_id: Some(played.frame_id),
            sequence: Some(played.sequence),
            capture_nanos: Some(played.capture_unix_nanos),
        };
        Self::new(py, played.inferred, played.frame_size, origin, shared)
    }

    fn new(
        py: Python<'_>,
        inferred: Inferred,
        frame_size: (u32, u32),
        origin: Origin,
        shared: Arc<Shared>,
    ) -> PyResult<Self> {
        let Inferred { depth, labels, rgb, report, points_camera, total_nanos } = inferred;
        let (width, height) = (points_camera.intrinsics.width, points_camera.intrinsics.height);
        let (rows, columns) = (height as usize, width as usize);
        let timings = PyDict::new(py);
        for (name, &micros) in shared.stage_names.iter().zip(report.stages.micros()) {
            timings.set_item(name, f64::from(micros) / 1e3)?;
        }
        timings.set_item("total", total_nanos as f64 / 1e6)?;
        Ok(Self {
            depth: array(py, depth, Ix2(rows, columns))?,
            labels: labels.map(|labels| array(py, labels, Ix2(rows, columns))).transpose()?,
            rgb: array(py, rgb, Ix3(rows, columns, 3))?,
            units: embed::units_name(report.units),
            scale_source: embed::scale_source_name(report.scale_source),
            timings: timings.unbind(),
            invalid_pixels: report.invalid_pixels,
            quality: embed::quality_name(report.quality),
            camera: report.camera.map(Camera),
            origin,
            points_camera,
            frame_size,
            shared,
        })
    }

    /// The camera of the points: at the size of depth, from one at the picture's size or of its shape.
    fn camera_for_points(&self, camera: Option<&Camera>) -> PyResult<camera::Camera> {
        let Some(Camera(camera)) = camera else { return Ok(self.points_camera) };
        let (width, height) = self.frame_size;
        let own = self.points_camera.intrinsics;
        let fitted =
            camera.fitted_to(width, height).and_then(|camera| camera.scaled_to(own.width, own.height));
        fitted.map_err(of_camera)
    }
}

/// A vector as an array of Python's, without a copy.
#[pymethods]
impl Result {
    #[getter]
    fn class_names(&self, py: Python<'_>) -> Py<PyTuple> {
        self.shared.class_names.clone_ref(py)
    }

    #[getter]
    fn topic(&self) -> Option<&str> {
        self.origin.topic.as_deref()
    }

    #[getter]
    fn frame_id(&self) -> Option<&str> {
        self.origin.frame_id.as_deref()
    }

    #[getter]
    fn sequence(&self) -> Option<u64> {
        self.origin.sequence
    }

    #[getter]
    fn capture_nanos(&self) -> Option<i64> {
        self.origin.capture_nanos
    }

    /// The depth map as points.
    ///
    /// Parameters
    /// ----------
    /// camera : Camera, optional
    ///     The camera whose rays the points lie on; else the one that the picture was inferred with, else the training
    ///     camera is assumed. It moves points sideways alone: metres are scaled by the camera given to `Model.infer`.
    ///
    /// Returns
    /// -------
    /// Cloud
    ///     One point a pixel, in the camera's optical frame.
    ///
    /// Raises
    /// ------
    /// CameraError
    ///     The camera does not fit the picture's shape.
    #[pyo3(signature = (camera = None))]
    fn cloud(&self, py: Python<'_>, camera: Option<&Bound<'_, Camera>>) -> PyResult<Cloud> {
        let camera = self.camera_for_points(camera.map(Bound::get))?;
        let size = (camera.intrinsics.width, camera.intrinsics.height);
        let depth = self.depth.bind(py).try_readonly()?;
        let rgb = self.rgb.bind(py).try_readonly()?;
        let labels = self.labels.as_ref().map(|labels| labels.bind(py).try_readonly()).transpose()?;
        let (depth, rgb) = (depth.as_slice()?, rgb.as_slice()?);
        let labels = labels.as_ref().map(|labels| labels.as_slice()).transpose()?;
        let points = py.detach(|| {
            let mut points = vec![CloudPoint::NONE; depth.len()];
            let rays = self.shared.rays(camera);
            organised_cloud(depth, &rays, rgb, labels, NonZeroU32::MIN, &mut points).map(|()| points)
        });
        Cloud::of_points(py, &points.map_err(|error| NunetError::new_err(error.to_string()))?, size)
    }

    /// Draw the picture, its depth with a scale, and its labels with their names.
    ///
    /// Returns
    /// -------
    /// matplotlib.figure.Figure
    ///     A figure that belongs to no window: a notebook shows it, `figure.savefig(path)` writes it.
    ///
    /// Raises
    /// ------
    /// ImportError
    ///     The package matplotlib is not installed (the extra `plot`).
    fn plot(slf: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        let module = slf.py().import("nunet_py._pictures")?;
        Ok(module.getattr("plot")?.call1((slf,))?.unbind())
    }

    /// The valid points with their colours, for Open3D: `cloud().to_open3d()`.
    ///
    /// Returns
    /// -------
    /// open3d.geometry.PointCloud
    ///     float64 points, colours from 0 to 1.
    ///
    /// Raises
    /// ------
    /// ImportError
    ///     The package open3d is not installed (the extra `open3d`).
    fn to_open3d(slf: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        let cloud = slf.get().cloud(slf.py(), None)?;
        Ok(Bound::new(slf.py(), cloud)?.call_method0("to_open3d")?.unbind())
    }

    fn __repr__(&self) -> String {
        let (width, height) = (self.points_camera.intrinsics.width, self.points_camera.intrinsics.height);
        let pixels = f64::from(width) * f64::from(height);
        let valid = 100.0 * (1.0 - f64::from(self.invalid_pixels) / pixels);
        let (units, source) = (self.units, self.scale_source);
        format!("Result({width}x{height}, units='{units}', scale_source='{source}', {valid:.0} % valid)")
    }
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Result>()
}
