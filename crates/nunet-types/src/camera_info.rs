//! A camera's intrinsics and lens, as messages carry them.

use crate::image_size::ImageSize;
use crate::vocabulary::vocabulary;

/// How many coefficients a distortion model can have.
pub const MAX_COEFFICIENTS: usize = 14;

vocabulary! {
    /// The lens model that the distortion coefficients belong to.
    DistortionModel as "distortion_model" {
        /// A pinhole: no coefficients.
        None = 0 "none",
        /// Brown-Conrady: k1 k2 p1 p2 k3 k4 k5 k6, then s1 to s4 and the two tilts.
        BrownConrady = 1 "brown_conrady",
        /// Kannala-Brandt (fisheye): k1 to k4.
        KannalaBrandt = 2 "kannala_brandt",
    }
}

impl DistortionModel {
    /// How many coefficients the model has at most.
    #[must_use]
    pub const fn max_coefficients(self) -> usize {
        match self {
            Self::None => 0,
            Self::BrownConrady => MAX_COEFFICIENTS,
            Self::KannalaBrandt => 4,
        }
    }
}

/// A camera's intrinsics and lens as plain numbers, at one image size. The numbers are unchecked: the crate
/// that computes with a camera does that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraInfo {
    /// The image size that the other fields hold for.
    pub size: ImageSize,
    /// Focal length in pixels, horizontally.
    pub fx_px: f64,
    /// Focal length in pixels, vertically.
    pub fy_px: f64,
    /// Principal point in pixels, horizontally; the center of the first pixel is 0.
    pub cx_px: f64,
    /// Principal point in pixels, vertically.
    pub cy_px: f64,
    /// The lens model.
    pub distortion_model: DistortionModel,
    /// The coefficients of the lens model, followed by zeros.
    pub distortion: [f64; MAX_COEFFICIENTS],
}
