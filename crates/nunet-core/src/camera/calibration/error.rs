//! The errors of a calibration.

use std::borrow::Cow;

use nunet_types::{Hint, RegionOutside, counted};

use super::{MAX_BYTES, MAX_IGNORED_SKEW};
use crate::camera::{CameraError, Distortion};
use crate::error_kind::ErrorKind;

/// The hint for a factor that is wrong or missing.
const SCALE_HINT: &str = "remove `nunet_scale` from the file, or correct its `factor`";

/// Why a calibration cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// Too much text for a calibration.
    #[error("the file has more than {MAX_BYTES} bytes")]
    TooLong,
    /// No text.
    #[error("the file is empty")]
    Empty,
    /// A region of interest beyond the sensor.
    #[error(transparent)]
    Region(#[from] RegionOutside),
    /// A file of several cameras.
    #[error("it has the cameras {names}, expected one")]
    SeveralCameras {
        /// The names of the first ones.
        names: String,
    },
    /// Not YAML, or a value of the wrong type.
    #[error("it is not a ROS `camera_info` file in YAML: {reason}")]
    Syntax {
        /// The parser's message, with line and column.
        reason: String,
    },
    /// A required key is absent.
    #[error("`{key}` is missing")]
    Missing {
        /// The key.
        key: String,
    },
    /// The count of numbers is not rows x cols.
    #[error("`{key}` has {}, expected {rows} x {cols}", counted(*got, "value"))]
    Shape {
        /// The matrix.
        key: &'static str,
        /// Its `rows`.
        rows: usize,
        /// Its `cols`.
        cols: usize,
        /// Numbers in its `data`.
        got: usize,
    },
    /// NaN or infinite.
    #[error("value {place} of `{key}` is `{value}`, expected a finite number")]
    NotFinite {
        /// The matrix.
        key: &'static str,
        /// Counted from 1.
        place: usize,
        /// The value.
        value: f64,
    },
    /// Not nine numbers.
    #[error("`camera_matrix` has {}, expected 9", counted(*got, "value"))]
    CameraMatrixSize {
        /// How many there are.
        got: usize,
    },
    /// A skew too large to ignore.
    #[error(
        "the camera matrix has a skew of {skew_px} px, {:.2} % of fx; at most {} % can be ignored",
        100.0 * skew_px.abs() / fx_px.abs(),
        100.0 * MAX_IGNORED_SKEW
    )]
    Skew {
        /// Row 1, column 2 of the camera matrix, pixels.
        skew_px: f64,
        /// Row 1, column 1, pixels.
        fx_px: f64,
    },
    /// What ROS writes for a camera that is not calibrated.
    #[error("`camera_matrix` is all zeros: the camera is not calibrated")]
    NotCalibrated,
    /// Other numbers where a camera matrix has zeros and a one.
    #[error("`camera_matrix` is not of the form `[fx, 0, cx, 0, fy, cy, 0, 0, 1]`")]
    NotACameraMatrix,
    /// A lens model that is not supported.
    #[error("distortion model `{model:.60}` is not supported; supported are {}", Distortion::ros_names())]
    UnknownModel {
        /// The name as written.
        model: String,
    },
    /// Invalid intrinsics.
    #[error("the camera matrix does not fit an image of {width}x{height}")]
    Intrinsics {
        /// Image width, pixels.
        width: u32,
        /// Image height, pixels.
        height: u32,
        /// What is wrong with them.
        source: CameraError,
    },
    /// Not the hash of a model.
    #[error("`model_sha256` is `{text:.80}`, expected 64 hexadecimal digits")]
    ModelHash {
        /// The text.
        text: String,
    },
    /// Not the name of a mode for images of another aspect ratio.
    #[error("`aspect` is `{text:.40}`, expected `crop`, `stretch` or `letterbox`")]
    Aspect {
        /// The text.
        text: String,
    },
    /// A file that a factor of depth cannot be added to.
    #[error("`nunet_scale` cannot be added to it: {reason}")]
    NoPlaceForScale {
        /// What adding it would do.
        reason: String,
    },
    /// A factor of depth out of range.
    #[error("`nunet_scale`: {0}")]
    ScaleFactor(CameraError),
    /// Coefficients out of range.
    #[error(transparent)]
    Lens(#[from] CameraError),
}

impl CalibrationError {
    /// [`ErrorKind::Camera`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Camera
    }
}

impl Hint for CalibrationError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        let text = match self {
            Self::TooLong | Self::Empty | Self::Syntax { .. } => {
                "pass a `camera_info` file as ROS's camera_calibration writes it (YAML, about 1 kB)"
            }
            Self::ScaleFactor(_) => SCALE_HINT,
            Self::Missing { key } if key.starts_with("nunet_scale") => SCALE_HINT,
            Self::Missing { .. } => {
                "a `camera_info` file has `image_width`, `image_height`, `camera_matrix`, `distortion_model` and \
                 `distortion_coefficients`; the matrices have `rows`, `cols` and `data`"
            }
            Self::Shape { .. } => "write rows x cols numbers",
            Self::NotFinite { .. } => "calibrate again; this calibration did not converge",
            Self::CameraMatrixSize { .. } | Self::NotACameraMatrix => {
                "write the matrix row by row: `[fx, 0, cx, 0, fy, cy, 0, 0, 1]`, in pixels"
            }
            Self::NotCalibrated => {
                "calibrate the camera; ROS writes zeros for a camera that is not calibrated"
            }
            Self::Skew { .. } => "calibrate with the skew fixed at 0 (OpenCV: `CALIB_FIX_SKEW`)",
            Self::UnknownModel { model } if model.is_empty() => {
                "name the lens model that the coefficients belong to"
            }
            Self::UnknownModel { .. } => {
                let names = Distortion::kalibr_names();
                return Some(
                    format!("calibrate again with a supported model; Kalibr calls them {names}").into(),
                );
            }
            Self::Region(_) => "write the region of interest in pixels of the sensor of `width` x `height`",
            Self::SeveralCameras { .. } => "keep the camera of the images in a file of its own",
            // One hint is enough.
            Self::Intrinsics { source, .. } if source.hint().is_some() => return None,
            Self::Intrinsics { .. } => {
                "write `[fx, 0, cx, 0, fy, cy, 0, 0, 1]` in pixels of the calibrated size; ROS writes zeros for a \
                 camera that is not calibrated"
            }
            Self::ModelHash { .. } => "omit it for a factor that holds for any model",
            Self::Aspect { .. } => "omit it if it is not known how the factor was measured",
            Self::NoPlaceForScale { .. } => "write the file with one unindented `key: value` per line",
            Self::Lens(error) => return error.hint(),
        };
        Some(text.into())
    }
}
