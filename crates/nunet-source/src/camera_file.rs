//! `camera.json`: the camera of a folder of rendered images.

use nunet_core::camera::{Camera, CameraError, Intrinsics};
use serde::Deserialize;

/// The content of `camera.json`: pinhole intrinsics in pixels, and the image size that they are for.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct CameraFile {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    /// The frame rate, if the images are consecutive.
    #[serde(default)]
    pub frames_per_second: Option<f64>,
}

impl CameraFile {
    /// The longest file: a hundred times the usual length.
    pub const MAX_BYTES: u64 = 16 * 1024;

    /// The camera.
    ///
    /// # Errors
    /// Invalid intrinsics.
    pub fn camera(&self) -> Result<Camera, CameraError> {
        let intrinsics = Intrinsics::new(self.fx, self.fy, self.cx, self.cy, self.width, self.height)?;
        Ok(Camera::pinhole(intrinsics))
    }
}
