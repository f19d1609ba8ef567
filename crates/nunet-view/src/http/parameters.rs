//! The parameters in the addresses of videos.

use serde::Deserialize;

use crate::protocol::{RequestError, Watch};

/// The query of `image.mjpeg` and `depth.mjpeg`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct VideoQuery {
    /// Frames per second at most.
    fps: Option<f32>,
    /// Megabits per second at most.
    mbit: Option<f32>,
    /// Wider images are reduced by a whole factor, pixels.
    width: Option<u32>,
    /// Depth of the first color (red); by default, the first percentile of each frame.
    pub(super) near: Option<f32>,
    /// Depth of the last color (blue); by default, the last percentile of each frame.
    pub(super) far: Option<f32>,
    /// Checked before.
    token: Option<String>,
}

impl VideoQuery {
    /// The same limits as those of a WebSocket; by default as wide as the camera.
    pub(super) fn watch(&self, camera: &str) -> Result<Watch, RequestError> {
        let defaults = Watch::camera(camera);
        let watch = Watch {
            max_fps: self.fps.unwrap_or(defaults.max_fps),
            max_mbit_per_s: self.mbit.unwrap_or(defaults.max_mbit_per_s),
            max_width: self.width.unwrap_or(640),
            ..defaults
        };
        watch.check()?;
        for (field, value) in [("near", self.near), ("far", self.far)] {
            if let Some(value) = value.filter(|value| !value.is_finite()) {
                return Err(RequestError::OutOfRange { field, value, expected: "a finite number" });
            }
        }
        Ok(watch)
    }
}
