//! The camera of a stream's frames, with the errors and warnings of the command line.

use nunet_core::camera::{Camera, CameraError};
use nunet_core::pipeline::Pipeline;
use tracing::warn;

use crate::exit::source_error;
use crate::source::{self, CameraGeometry, Frame};

/// Finds the camera that took a frame, see [`source::CameraResolver`].
#[derive(Debug, Default)]
pub(crate) struct CameraResolver(source::CameraResolver);

impl CameraResolver {
    pub(crate) fn new(geometry: &CameraGeometry) -> anyhow::Result<Self> {
        source::CameraResolver::new(geometry).map(Self).map_err(source_error)
    }

    pub(crate) fn camera_of(&self, frame: &Frame) -> Result<Option<Camera>, CameraError> {
        self.0.camera_of(frame)
    }

    pub(crate) fn resolve(&mut self, frame: &Frame) -> anyhow::Result<Option<Camera>> {
        self.0.resolve(frame).map_err(source_error)
    }

    /// Passes the camera to the pipeline if it changed. Warns once if the camera is unknown.
    pub(crate) fn update(&mut self, frame: &Frame, pipeline: &mut Pipeline) -> anyhow::Result<()> {
        if let Some(assumption) = self.0.update(frame, pipeline).map_err(source_error)? {
            warn_of_unknown_camera(assumption);
        }
        Ok(())
    }
}

/// Says what is assumed about a camera without intrinsics.
pub(crate) fn warn_of_unknown_camera(assumption: &str) {
    warn!("no intrinsics: {assumption}\nhint: --intrinsics fx,fy,cx,cy or --calibration FILE.yaml");
}
