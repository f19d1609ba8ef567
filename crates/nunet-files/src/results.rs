//! The results of one frame.

use nunet_types::{CloudPoint, ImageSize};

/// One frame's results.
#[derive(Debug, Clone, Copy)]
pub struct ResultArrays<'a> {
    /// The size of `depth`, `labels` and `confidence`.
    pub size: ImageSize,
    /// `[H, W]`, rows from the top; meters if `metric`, NaN = no measurement.
    pub depth: &'a [f32],
    /// Whether `depth` is in meters.
    pub metric: bool,
    /// `[H, W]`, class indices.
    pub labels: Option<&'a [u8]>,
    /// `[H, W]`, 255 = certain.
    pub confidence: Option<&'a [u8]>,
    /// Organized points in the optical frame, in the unit of `depth`.
    pub cloud: Option<&'a [CloudPoint]>,
}
