//! A camera's calibration as ROS describes it: a `camera_info` file in YAML (`camera_calibration_parsers`),
//! or the fields of a `sensor_msgs/CameraInfo`.

mod document;
mod error;
mod file;
mod kalibr;
mod opencv;
mod scale;
#[cfg(test)]
mod tests;
mod yaml;

use std::fmt;

use nunet_types::{ImageSize, SensorRegion};

use super::{Camera, CameraError, Distortion, Intrinsics};

pub use error::CalibrationError;
pub use scale::{CalibratedScale, ScaleNote};

/// A `camera_info` file has about a thousand bytes.
const MAX_BYTES: usize = 64 * 1024;

/// The largest skew that is ignored, relative to fx. Depth maps and messages have no place for a skew. ROS's
/// fisheye calibration leaves one of 0.2 to 2 % in its files, which moves a point at 45 degrees by at most a
/// hundredth of its depth; a larger one is not the error of an estimate.
const MAX_IGNORED_SKEW: f64 = 0.02;

/// A calibrated camera at the size that it was calibrated at.
///
/// It describes the image as the sensor delivers it. `rectification_matrix` and `projection_matrix` describe
/// rectified images and are not read.
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
/// assert_eq!(camera.distortion, calibration.camera().distortion, "a lens does not change with the size");
/// # Ok::<(), CalibrationError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    camera: Camera,
    ignored_skew: Option<IgnoredSkew>,
    assumed_model: Option<&'static str>,
    scale: Option<CalibratedScale>,
}

/// The fields of a `sensor_msgs/CameraInfo` that describe the image as the sensor delivers it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RosCalibration<'a> {
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
    /// The part of the sensor that the images show; the fields above describe the whole.
    pub region: SensorRegion,
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

    /// Parses YAML: `camera_info` as ROS's `camera_calibration` writes it, a `CameraInfo` message as
    /// `ros2 topic echo` prints it, OpenCV's `FileStorage`, or Kalibr's camchain of one camera.
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
        file::parse(text)
    }

    /// The calibration in a `CameraInfo` message. Files and recordings share this rule.
    ///
    /// A skew of up to 2 % of fx is ignored ([`Calibration::ignored_skew`]).
    ///
    /// # Errors
    /// A camera matrix that is not one, a larger skew, and what [`Intrinsics::new`] and
    /// [`Distortion::from_ros`] refuse.
    pub fn from_ros(info: &RosCalibration<'_>) -> Result<Self, CalibrationError> {
        check_finite("camera_matrix", info.k)?;
        check_finite("distortion_coefficients", info.d)?;
        let &[fx, skew, cx, below_fx, fy, cy, far_x, far_y, one] = info.k else {
            return Err(CalibrationError::CameraMatrixSize { got: info.k.len() });
        };
        if info.k.iter().all(|&value| value == 0.0) {
            return Err(CalibrationError::NotCalibrated);
        }
        if [below_fx, far_x, far_y, one] != [0.0, 0.0, 0.0, 1.0] {
            return Err(CalibrationError::NotACameraMatrix);
        }
        let sensor = ImageSize::new(info.width, info.height);
        let (size, [fx, skew, cx, fy, cy]) = info.region.captured(sensor, [fx, skew, cx, fy, cy])?;
        let ImageSize { width, height } = size;
        let intrinsics = Intrinsics::new(fx, fy, cx, cy, width, height)
            .map_err(|source| CalibrationError::Intrinsics { width, height, source })?;
        if skew.abs() > MAX_IGNORED_SKEW * fx {
            return Err(CalibrationError::Skew { skew_px: skew, fx_px: fx });
        }
        let distortion = Distortion::from_ros(info.distortion_model, info.d)?;
        let ignored_skew = (skew != 0.0).then_some(IgnoredSkew { skew_px: skew, fx_px: fx });
        let assumed_model = Distortion::model_of(info.d).filter(|_| info.distortion_model.is_empty());
        Ok(Self { camera: Camera { intrinsics, distortion }, ignored_skew, assumed_model, scale: None })
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

    /// The lens model that the count of coefficients means, where none is named.
    #[must_use]
    pub fn assumed_model(&self) -> Option<&'static str> {
        self.assumed_model
    }

    /// The factor of depth that was measured with this camera, where the file has one.
    #[must_use]
    pub fn scale(&self) -> Option<CalibratedScale> {
        self.scale
    }

    /// The camera when its images are resized to `width` x `height` pixels.
    ///
    /// # Errors
    /// A size of another aspect ratio, by more than the rounding to whole pixels: such an image was cropped
    /// or stretched, and the calibration does not say where.
    pub fn at_size(&self, width: u32, height: u32) -> Result<Camera, CameraError> {
        self.camera.fitted_to(width, height)
    }
}

/// Other formats of calibrations, with their conversion.
fn other_format(text: &str) -> Option<&'static str> {
    if text.lines().any(|line| line.trim() == "[image]") {
        return Some(
            "it is an INI file; convert it to YAML, as ROS's `camera_calibration_parsers convert` does",
        );
    }
    if text.contains('\0') {
        return Some("it is no text in UTF-8; if an editor or a shell wrote it as UTF-16, save it as UTF-8");
    }
    text.trim_start().starts_with("<?xml").then_some("it is XML; let OpenCV write it to a file named .yaml")
}

fn check_finite(key: &'static str, values: &[f64]) -> Result<(), CalibrationError> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(place) => Err(CalibrationError::NotFinite { key, place: place + 1, value: values[place] }),
        None => Ok(()),
    }
}
