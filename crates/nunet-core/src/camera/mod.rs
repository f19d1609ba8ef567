//! The camera: intrinsics in pixels at a stated size, the lens, and the table of rays computed once from both.

mod intrinsics;
mod rays;

pub use intrinsics::{CameraError, Intrinsics, IntrinsicsSpec};
pub use rays::RayTable;

/// How the lens bends rays before they reach the picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Distortion {
    /// Pinhole: straight lines stay straight.
    #[default]
    None,
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

    /// The same camera with its picture stretched to `width` x `height` pixels; the lens does not change.
    ///
    /// # Errors
    /// A side of 0 pixels.
    pub fn scaled_to(&self, width: u32, height: u32) -> Result<Self, CameraError> {
        Ok(Self { intrinsics: self.intrinsics.scaled_to(width, height)?, distortion: self.distortion })
    }
}
