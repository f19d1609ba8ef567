//! The camera: intrinsics in pixels at a stated size, lens distortion, the table of rays computed from both,
//! and the mount, which is the camera's pose on the robot.
//!
//! Each lens model has a file of its own, which implements `LensModel`, and a line in `lens_models!` below.
//! All other code finds it by its number in messages or by its ROS names.

mod accepted_range;
mod brown_conrady;
mod calibration;
mod coefficients;
mod error;
mod info;
mod intrinsics;
mod intrinsics_spec;
mod kannala_brandt;
mod lens_model;
mod mount;
mod mount_doubt;
mod mount_error;
mod rays;
mod roots;
mod ros;
mod scale_factor;

#[cfg(test)]
mod tests;

pub use brown_conrady::BrownConrady;
pub use calibration::{
    CalibratedScale, Calibration, CalibrationError, IgnoredSkew, RosCalibration, ScaleNote,
};
pub use coefficients::MAX_COEFFICIENTS;
pub use error::CameraError;
pub use intrinsics::Intrinsics;
pub use intrinsics_spec::IntrinsicsSpec;
pub use kannala_brandt::KannalaBrandt;
pub use mount::{Mount, check_pose};
pub use mount_doubt::MountDoubt;
pub use mount_error::MountError;
pub use rays::RayTable;
pub use scale_factor::{MAX_SCALE_FACTOR, MIN_SCALE_FACTOR, check_scale_factor};

use std::num::NonZeroU32;

use lens_model::{LensEntry, LensModel, lens_models};
use nalgebra::Point2;
use nunet_types::{DistortionModel, ImageSize, PixelRect};

// Each model has the name of its number in `DistortionModel`. Neither a model without a number nor a number
// without a model compiles.
lens_models! {
    /// Radial, tangential and thin prism distortion of ordinary lenses.
    BrownConrady,
    /// Fisheye.
    KannalaBrandt,
}

/// A calibrated camera: intrinsics and lens distortion, which give the viewing ray of each pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Focal lengths and principal point, pixels at the stated size.
    pub intrinsics: Intrinsics,
    /// Lens distortion.
    pub distortion: Distortion,
}

impl Camera {
    /// A camera without distortion.
    #[must_use]
    pub fn pinhole(intrinsics: Intrinsics) -> Self {
        Self { intrinsics, distortion: Distortion::None }
    }

    /// The camera for an image of another size and the same aspect ratio.
    ///
    /// # Errors
    /// A size of another aspect ratio, by more than the rounding to whole pixels: such an image was cropped
    /// or stretched, and the intrinsics do not say where.
    pub fn fitted_to(&self, width: u32, height: u32) -> Result<Self, CameraError> {
        Ok(Self { intrinsics: self.intrinsics.fitted_to(width, height)?, distortion: self.distortion })
    }

    /// The camera after its image is resized to `width` x `height` pixels, each axis by its own factor.
    ///
    /// # Errors
    /// A side of 0 pixels.
    pub fn scaled_to(&self, width: u32, height: u32) -> Result<Self, CameraError> {
        Ok(Self { intrinsics: self.intrinsics.scaled_to(width, height)?, distortion: self.distortion })
    }

    /// The camera of a part of the image.
    #[must_use]
    pub fn cropped(&self, part: PixelRect) -> Self {
        Self { intrinsics: self.intrinsics.cropped(part), distortion: self.distortion }
    }

    /// The camera of an image of size `canvas` in which this camera's image lies at `place`, which has its
    /// size.
    #[must_use]
    pub fn padded(&self, place: PixelRect, canvas: ImageSize) -> Self {
        Self { intrinsics: self.intrinsics.padded(place, canvas), distortion: self.distortion }
    }

    /// The camera of the image made of columns and rows 0, `stride`, 2 `stride`, ...
    #[must_use]
    pub fn subsampled(&self, stride: NonZeroU32) -> Self {
        Self { intrinsics: self.intrinsics.subsampled(stride), distortion: self.distortion }
    }

    /// The camera of the image in which each whole block of `factor` x `factor` pixels is one pixel.
    #[must_use]
    pub fn decimated(&self, factor: NonZeroU32) -> Self {
        Self { intrinsics: self.intrinsics.decimated(factor), distortion: self.distortion }
    }

    /// Column and row where a point `[x, y, z]` of the camera's optical frame (meters or any unit) appears.
    ///
    /// `None` for a point that is not in front of the camera, or that is outside the range of the lens model.
    /// The pixel may lie outside the image.
    ///
    /// # Example: through a fisheye, points far from the axis appear nearer to the center
    /// ```
    /// # use nunet_core::camera::{Camera, CameraError, Distortion, Intrinsics, KannalaBrandt};
    /// let intrinsics = Intrinsics::new(300.0, 300.0, 320.0, 240.0, 640, 480)?;
    /// let fisheye = Distortion::KannalaBrandt(KannalaBrandt::new(&[0.0; 4])?);
    /// let point = [2.0, 0.0, 2.0]; // 45 degrees to the right
    /// let pinhole = Camera::pinhole(intrinsics).project(point).unwrap();
    /// let fisheye = Camera { intrinsics, distortion: fisheye }.project(point).unwrap();
    /// assert_eq!(pinhole, [620.0, 240.0]);
    /// assert!((fisheye[0] - (320.0 + 300.0 * 0.7854)).abs() < 0.01, "the angle in radians");
    /// # Ok::<(), CameraError>(())
    /// ```
    #[must_use]
    pub fn project(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
        let Intrinsics { fx_px, fy_px, cx_px, cy_px, .. } = self.intrinsics;
        let in_front = z > 0.0;
        let distorted = self.distortion.distort(in_front.then(|| Point2::new(x / z, y / z))?)?;
        Some([fx_px * distorted.x + cx_px, fy_px * distorted.y + cy_px])
    }
}
