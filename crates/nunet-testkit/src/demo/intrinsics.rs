//! The camera in the room.

/// Focal lengths and principal point, pixels at the stated size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoomIntrinsics {
    /// Focal length along rows.
    pub fx_px: f64,
    /// Focal length along columns.
    pub fy_px: f64,
    /// Column of the principal point.
    pub cx_px: f64,
    /// Row of the principal point.
    pub cy_px: f64,
    /// Pixels from left to right.
    pub width: u32,
    /// Pixels from top to bottom.
    pub height: u32,
}

impl RoomIntrinsics {
    /// The Kinect of NYU Depth V2, which most networks for rooms were trained on, for images of another size.
    pub(super) fn nyu(width: u32, height: u32) -> Self {
        let (scale_x, scale_y) = (f64::from(width) / 640.0, f64::from(height) / 480.0);
        Self {
            fx_px: 518.858 * scale_x,
            fy_px: 519.470 * scale_y,
            cx_px: (325.582 + 0.5) * scale_x - 0.5,
            cy_px: (253.736 + 0.5) * scale_y - 0.5,
            width,
            height,
        }
    }
}
