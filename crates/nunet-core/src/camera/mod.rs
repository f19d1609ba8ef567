//! The camera: intrinsics in pixels at a stated size, the lens, and the table of rays computed once from both.

mod brown_conrady;
mod calibration;
mod coefficients;
mod info;
mod intrinsics;
mod kannala_brandt;
mod rays;
mod roots;

#[cfg(test)]
mod tests;

pub use brown_conrady::BrownConrady;
pub use calibration::{Calibration, CalibrationError};
pub use coefficients::MAX_COEFFICIENTS;
pub use intrinsics::{CameraError, Intrinsics, IntrinsicsSpec};
pub use kannala_brandt::KannalaBrandt;
pub use rays::RayTable;

use std::num::NonZeroU32;

use nalgebra::Point2;

/// How the lens bends rays before they reach the picture.
///
/// Not `non_exhaustive`: whoever passes lenses on must not compile until it knows a new one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Distortion {
    /// Pinhole: straight lines stay straight.
    #[default]
    None,
    /// Rings pulled in or out, and small errors of the lens's making.
    BrownConrady(BrownConrady),
    /// Fisheye.
    KannalaBrandt(KannalaBrandt),
}

impl Distortion {
    /// The lens's coefficients in its model's order, zeros behind them.
    #[must_use]
    pub fn coefficients(&self) -> [f64; MAX_COEFFICIENTS] {
        match self {
            Self::None => [0.0; MAX_COEFFICIENTS],
            Self::BrownConrady(lens) => *lens.coefficients(),
            Self::KannalaBrandt(lens) => lens.coefficients(),
        }
    }

    /// Where the lens throws a ray, both as points on the plane at depth 1; `None` for a ray that it folds back.
    fn thrown(&self, ray: Point2<f64>) -> Option<Point2<f64>> {
        match self {
            Self::None => Some(ray),
            Self::BrownConrady(lens) => lens.thrown(ray),
            Self::KannalaBrandt(lens) => lens.thrown(ray),
        }
    }

    /// The ray that the lens throws on `seen`; `None` where it throws none that is in front of the camera.
    fn ray(&self, seen: Point2<f64>) -> Option<Point2<f64>> {
        match self {
            Self::None => Some(seen),
            Self::BrownConrady(lens) => lens.ray(seen),
            Self::KannalaBrandt(lens) => lens.ray(seen),
        }
    }
}

/// What is known of a camera: where its rays go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Focal lengths and principal point, pixels at the stated size.
    pub intrinsics: Intrinsics,
    /// The lens.
    pub distortion: Distortion,
}

impl Camera {
    /// A camera without distortion.
    #[must_use]
    pub fn pinhole(intrinsics: Intrinsics) -> Self {
        Self { intrinsics, distortion: Distortion::None }
    }

    /// The same camera for a picture of another size and the same shape: what a calibration says of it.
    ///
    /// # Errors
    /// A size whose sides have another ratio, by more than the rounding to whole pixels: such a picture was cropped or
    /// stretched, and nobody said where.
    pub fn fitted_to(&self, width: u32, height: u32) -> Result<Self, CameraError> {
        Ok(Self { intrinsics: self.intrinsics.fitted_to(width, height)?, distortion: self.distortion })
    }

    /// The same camera with its picture stretched to `width` x `height` pixels; the lens does not change.
    ///
    /// # Errors
    /// A side of 0 pixels.
    pub fn scaled_to(&self, width: u32, height: u32) -> Result<Self, CameraError> {
        Ok(Self { intrinsics: self.intrinsics.scaled_to(width, height)?, distortion: self.distortion })
    }

    /// The camera of the picture made of columns and rows 0, `stride`, 2 `stride`, ...; the lens does not change.
    #[must_use]
    pub fn decimated(&self, stride: NonZeroU32) -> Self {
        Self { intrinsics: self.intrinsics.decimated(stride), distortion: self.distortion }
    }

    /// The camera of the picture in which each whole block of `factor` x `factor` pixels is one; the lens does not change.
    #[must_use]
    pub fn binned(&self, factor: NonZeroU32) -> Self {
        Self { intrinsics: self.intrinsics.binned(factor), distortion: self.distortion }
    }

    /// Column and row where a point `[x, y, z]` of the camera's optical frame (metres or any unit) appears.
    ///
    /// `None` for a point that is not in front of the camera, or so far aside that the lens model says nothing of it.
    /// The pixel may lie outside of the picture.
    ///
    /// # Example: a fisheye draws the edge of the view nearer to the centre than a pinhole would
    /// ```
    /// # use nunet_core::camera::{Camera, CameraError, Distortion, Intrinsics, KannalaBrandt};
    /// let intrinsics = Intrinsics::new(300.0, 300.0, 320.0, 240.0, 640, 480)?;
    /// let fisheye = Distortion::KannalaBrandt(KannalaBrandt::new(&[0.0; 4])?);
    /// let aside = [2.0, 0.0, 2.0]; // 45 degrees to the right
    /// let pinhole = Camera::pinhole(intrinsics).project(aside).unwrap();
    /// let fisheye = Camera { intrinsics, distortion: fisheye }.project(aside).unwrap();
    /// assert_eq!(pinhole, [620.0, 240.0]);
    /// assert!((fisheye[0] - (320.0 + 300.0 * 0.7854)).abs() < 0.01, "the angle in radians");
    /// # Ok::<(), CameraError>(())
    /// ```
    #[must_use]
    pub fn project(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
        let Intrinsics { fx_px, fy_px, cx_px, cy_px, .. } = self.intrinsics;
        let in_front = z > 0.0;
        let seen = self.distortion.thrown(in_front.then(|| Point2::new(x / z, y / z))?)?;
        Some([fx_px * seen.x + cx_px, fy_px * seen.y + cy_px])
    }
}
