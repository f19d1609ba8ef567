//! A build without the server.

use nunet_ros2::CameraOptions;
use nunet_sink::sink::Sink;

use crate::FoxgloveConfig;
use crate::error::FoxgloveServerError;

/// There is none.
#[derive(Debug)]
pub enum FoxgloveServer {}

impl FoxgloveServer {
    /// Fails.
    ///
    /// # Errors
    /// Always.
    pub fn open(_config: FoxgloveConfig, _cameras: usize) -> Result<Self, FoxgloveServerError> {
        Err(FoxgloveServerError::NotBuilt)
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> std::net::SocketAddr {
        match *self {}
    }

    /// A camera.
    ///
    /// # Errors
    /// None.
    pub fn add_camera(&self, _camera: &CameraOptions<'_>) -> Result<Box<dyn Sink>, FoxgloveServerError> {
        match *self {}
    }
}
