//! A camera's calibration as ROS describes it: a `camera_info` file in YAML (`camera_calibration_parsers`), or the fields
//! of a `sensor_msgs/CameraInfo`.

mod error;
mod kalibr;
mod opencv;
mod scale;
#[cfg(test)]
mod tests;

use std::fmt;

use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::{Camera, CameraError, Distortion, Intrinsics};
use crate::text::shortened;

pub use error::CalibrationError;
pub use scale::{CalibratedScale, ScaleNote};

/// A `camera_info` file has about a thousand bytes.
const MAX_BYTES: usize = 64 * 1024;

/// The largest skew that is ignored, relative to fx. Depth maps and messages have no place for a skew. ROS's fisheye
/// calibration leaves one of 0.2 to 2 % in its files, which moves a point at 45 degrees by at most a hundredth of its depth;
/// a larger one is not the error of an estimate.
const MAX_IGNORED_SKEW: f64 = 0.02;

/// A calibrated camera at the size that it was calibrated at.
///
/// It describes the image as the sensor delivers it. `rectification_matrix` and `projection_matrix` describe rectified
/// images and are not read.
///
/// # Example: half the size of the calibration
/// ```
/// # use nunet_core::camera::{Calibration, CalibrationError};
/// let calibration = Calibration::parse(
///     "image_width: 1280
/// image_height: 960
/// camera_name: front
/// camera_matrix: {rows: 3, cols: 3, data: [1037, 0, 651, 0, 1038, 507, 0, 0, 1]}
/// distortion_model: plumb_bob
/// distortion_coefficients: {rows: 1, cols: 5, data: [-0.31, 0.11, 0.0007, -0.0004, 0]}
/// ",
/// )?;
/// let camera = calibration.at_size(640, 480)?;
/// assert_eq!((camera.intrinsics.fx_px, camera.intrinsics.cx_px), (518.5, 325.25));
/// assert_eq!(camera.distortion, calibration.camera().distortion, "a lens does not change with the image size");
/// # Ok::<(), CalibrationError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    camera: Camera,
    ignored_skew: Option<IgnoredSkew>,
    scale: Option<CalibratedScale>,
}

/// The fields of a `sensor_msgs/CameraInfo` that describe the image as the sensor delivers it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RosCameraInfo<'a> {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// The camera matrix, nine numbers row by row: `[fx, skew, cx, 0, fy, cy, 0, 0, 1]`, pixels.
    pub k: &'a [f64],
    /// The name of the lens model; empty for none.
    pub distortion_model: &'a str,
    /// The lens coefficients, in the model's order.
    pub d: &'a [f64],
}

/// A skew of the camera matrix that was small enough to ignore. Front ends log it as a warning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IgnoredSkew {
    /// Row 1, column 2 of the camera matrix, pixels.
    pub skew_px: f64,
    /// Row 1, column 1 of the camera matrix, pixels.
    pub fx_px: f64,
}

impl fmt::Display for IgnoredSkew {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = 100.0 * self.skew_px.abs() / self.fx_px.abs();
        write!(
            f,
            "the camera matrix has a skew of {} px, {percent:.2} % of fx, which is ignored",
            self.skew_px
        )
    }
}

impl Calibration {
    /// No calibration that [`Calibration::parse`] accepts has more bytes; a reader can stop there.
    pub const MAX_BYTES: usize = MAX_BYTES;

    /// Parses YAML: `camera_info` as ROS's `camera_calibration` writes it, a `CameraInfo` message as `ros2 topic echo` prints
    /// it, Kalibr's camchain of one camera, or the file of OpenCV's calibration sample.
    ///
    /// # Errors
    /// Text that is too long, empty or not YAML, missing keys, a matrix of the wrong shape, and what
    /// [`Calibration::from_ros`] refuses.
    pub fn parse(text: &str) -> Result<Self, CalibrationError> {
        if text.len() > MAX_BYTES {
            return Err(CalibrationError::TooLong);
        }
        if text.trim().is_empty() {
            return Err(CalibrationError::Empty);
        }
        if let Some(reason) = other_format(text) {
            return Err(CalibrationError::Syntax { reason: reason.to_owned() });
        }
        let text = first_document(opencv::without_directive(text));
        let scale = scale::parse(text)?;
        let calibration = if kalibr::is_camchain(text) {
            kalibr::calibration(parse_yaml(text)?)?
        } else {
            parse_yaml::<CameraInfoFile>(text)?.calibration(text)?
        };
        Ok(Self { scale, ..calibration })
    }

    /// The calibration in a `CameraInfo` message. Files and recordings share this rule.
    ///
    /// A skew of up to 2 % of fx is ignored ([`Calibration::ignored_skew`]).
    ///
    /// # Errors
    /// A camera matrix that is not one, a larger skew, and what [`Intrinsics::new`] and [`Distortion::from_ros`] refuse.
    pub fn from_ros(info: &RosCameraInfo<'_>) -> Result<Self, CalibrationError> {
        let RosCameraInfo { width, height, .. } = *info;
        check_finite("camera_matrix", info.k)?;
        check_finite("distortion_coefficients", info.d)?;
        let &[fx, skew, cx, below_fx, fy, cy, far_x, far_y, one] = info.k else {
            return Err(CalibrationError::CameraMatrixSize { got: info.k.len() });
        };
        if [below_fx, far_x, far_y, one] != [0.0, 0.0, 0.0, 1.0] {
            return Err(CalibrationError::NotACameraMatrix);
        }
        let intrinsics = Intrinsics::new(fx, fy, cx, cy, width, height)
            .map_err(|source| CalibrationError::Intrinsics { width, height, source })?;
        if skew.abs() > MAX_IGNORED_SKEW * fx {
            return Err(CalibrationError::Skew { skew_px: skew, fx_px: fx });
        }
        let distortion = Distortion::from_ros(info.distortion_model, info.d)?;
        let ignored_skew = (skew != 0.0).then_some(IgnoredSkew { skew_px: skew, fx_px: fx });
        Ok(Self { camera: Camera { intrinsics, distortion }, ignored_skew, scale: None })
    }

    /// The camera at the size that it was calibrated at.
    #[must_use]
    pub fn camera(&self) -> Camera {
        self.camera
    }

    /// The skew of the camera matrix, where it has one.
    #[must_use]
    pub fn ignored_skew(&self) -> Option<IgnoredSkew> {
        self.ignored_skew
    }

    /// The factor of depth that was measured with this camera, where the file has one.
    #[must_use]
    pub fn scale(&self) -> Option<CalibratedScale> {
        self.scale
    }

    /// The camera when its images are resized to `width` x `height` pixels.
    ///
    /// # Errors
    /// A size of another aspect ratio, by more than the rounding to whole pixels: such an image was cropped or
    /// stretched, and the calibration does not say where.
    pub fn at_size(&self, width: u32, height: u32) -> Result<Camera, CameraError> {
        self.camera.fitted_to(width, height)
    }
}

fn parse_yaml<T: DeserializeOwned>(text: &str) -> Result<T, CalibrationError> {
    let options = serde_saphyr::options! { with_snippet: false };
    serde_saphyr::from_str_with_options(text, options).map_err(|error| CalibrationError::Syntax {
        reason: shortened(&error.render_with_formatter(&serde_saphyr::UserMessageFormatter)),
    })
}

/// Other formats of calibrations, with their conversion.
fn other_format(text: &str) -> Option<&'static str> {
    if text.lines().any(|line| line.trim() == "[image]") {
        return Some(
            "it is an INI file; convert it to YAML, as ROS's `camera_calibration_parsers convert` does",
        );
    }
    text.trim_start().starts_with("<?xml").then_some("it is XML; let OpenCV write it to a file named .yaml")
}

/// `ros2 topic echo` ends each message with `---`.
fn first_document(text: &str) -> &str {
    let start = text.strip_prefix("---\n").unwrap_or(text);
    start.split_once("\n---").map_or(text, |(first, _)| first)
}

/// The keys that are read of a file and of a printed message; others are ignored. All are optional here, so that a missing
/// one is an error of ours.
#[derive(Deserialize)]
struct CameraInfoFile {
    #[serde(alias = "width")]
    image_width: Option<u32>,
    #[serde(alias = "height")]
    image_height: Option<u32>,
    camera_matrix: Option<Matrix>,
    distortion_model: Option<String>,
    distortion_coefficients: Option<Matrix>,
    /// 1 in OpenCV's files of a fisheye.
    fisheye_model: Option<u8>,
    /// The camera matrix of a message; ROS 1 writes `K` and `D`.
    #[serde(alias = "K")]
    k: Option<Vec<f64>>,
    /// The lens coefficients of a message.
    #[serde(alias = "D")]
    d: Option<Vec<f64>>,
}

#[derive(Deserialize)]
struct Matrix {
    rows: Option<usize>,
    cols: Option<usize>,
    data: Option<Vec<f64>>,
}

impl CameraInfoFile {
    /// `text` is the file.
    fn calibration(self, text: &str) -> Result<Calibration, CalibrationError> {
        let width = present("image_width", self.image_width)?;
        let height = present("image_height", self.image_height)?;
        let numbers = |key, matrix: Option<Matrix>, flat: Option<Vec<f64>>| match flat {
            Some(numbers) => Ok(numbers),
            None => present(key, matrix)?.numbers(key),
        };
        let k = numbers("camera_matrix", self.camera_matrix, self.k)?;
        let d = numbers("distortion_coefficients", self.distortion_coefficients, self.d);
        let is_fisheye = self.fisheye_model.is_some_and(|flag| flag != 0);
        let of_opencv = opencv::lens_model(text, is_fisheye, d.as_ref().map_or(0, Vec::len));
        let model = present("distortion_model", self.distortion_model.or(of_opencv.map(str::to_owned)))?;
        let d = d?;
        Calibration::from_ros(&RosCameraInfo { width, height, k: &k, distortion_model: &model, d: &d })
    }
}

impl Matrix {
    fn numbers(self, key: &'static str) -> Result<Vec<f64>, CalibrationError> {
        let missing = |part: &str| CalibrationError::Missing { key: format!("{key}: {part}") };
        let rows = self.rows.ok_or_else(|| missing("rows"))?;
        let cols = self.cols.ok_or_else(|| missing("cols"))?;
        let data = self.data.ok_or_else(|| missing("data"))?;
        if rows.checked_mul(cols) != Some(data.len()) {
            return Err(CalibrationError::Shape { key, rows, cols, got: data.len() });
        }
        Ok(data)
    }
}

fn check_finite(key: &'static str, values: &[f64]) -> Result<(), CalibrationError> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(place) => Err(CalibrationError::NotFinite { key, place: place + 1, value: values[place] }),
        None => Ok(()),
    }
}

fn present<T>(key: &str, value: Option<T>) -> Result<T, CalibrationError> {
    value.ok_or_else(|| CalibrationError::Missing { key: key.to_owned() })
}
