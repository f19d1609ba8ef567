//! A depth map with the results that belong to it.

/// A depth map with its labels and confidence, `[H, W]` each, of one size.
#[derive(Debug, Clone, Copy)]
pub struct DepthImage<'a> {
    /// Meters along the optical axis; NaN where nothing was measured.
    pub depth_m: &'a [f32],
    /// Class indices. Without labels, the detector of obstacles recognizes floor by its position alone, and
    /// does not recognize glass.
    pub labels: Option<&'a [u8]>,
    /// Confidence of depth, 255 = certain. Without it no depth counts as uncertain, and labels do not show
    /// where things stand.
    pub confidence: Option<&'a [u8]>,
}
