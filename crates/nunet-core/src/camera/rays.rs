//! Where each pixel looks: the table that turns depth into points.

use super::Camera;

/// For each pixel the direction it sees, as the point of its ray at depth 1: `[x / z, y / z]`.
///
/// `[height][width]`, camera's optical frame (x right, y down, z forward). A pixel that sees no point in front of the
/// camera has NaN. A lens with distortion fills the same table, so that nothing after it knows of lenses.
#[derive(Debug, Clone, PartialEq)]
pub struct RayTable {
    width: u32,
    height: u32,
    rays: Vec<[f32; 2]>,
}

impl RayTable {
    /// The rays of all pixels of `camera`, at the size of its intrinsics.
    #[must_use]
    pub fn new(camera: &Camera) -> Self {
        todo!("{camera:?}")
    }

    /// Pixels from left to right.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels from top to bottom.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All rays, row after row from the top.
    #[must_use]
    pub fn rays(&self) -> &[[f32; 2]] {
        &self.rays
    }
}
