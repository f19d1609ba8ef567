//! Which camera a frame was taken with: what the user said, else what the source knows.

use nunet_core::camera::{Camera, CameraError, IntrinsicsSpec};
use nunet_core::depth::ScaleSource;
use nunet_core::pipeline::Pipeline;
use tracing::warn;

use crate::source::Frame;

/// The camera of a stream's frames, followed from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Optics {
    named: Option<IntrinsicsSpec>,
    told: Option<Key>,
    warned: bool,
}

/// What the camera depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Key {
    size: (u32, u32),
    camera: Option<Camera>,
}

impl Optics {
    /// Intrinsics that the user named come before those of the source.
    pub(crate) fn new(named: Option<IntrinsicsSpec>) -> Self {
        Self { named, told: None, warned: false }
    }

    /// The camera that took `frame`, at the frame's size; `None` when nobody knows it.
    ///
    /// # Errors
    /// The named intrinsics do not fit the frame's size.
    pub(crate) fn camera_of(&self, frame: &Frame) -> Result<Option<Camera>, CameraError> {
        let (width, height) = frame.size;
        let named = self.named.as_ref().map(|spec| spec.at_size(width, height)).transpose()?;
        Ok(named.map(Camera::pinhole).or(frame.camera))
    }

    /// Tells the pipeline of a camera that is another than the last frame's, and the user, once, of a guess.
    ///
    /// # Errors
    /// A camera that does not fit the frame's or the network's size; the next frame tries again.
    pub(crate) fn follow(&mut self, frame: &Frame, pipeline: &mut Pipeline) -> anyhow::Result<()> {
        let key = Key { size: frame.size, camera: frame.camera };
        if self.told == Some(key) {
            return Ok(());
        }
        pipeline.set_camera(self.camera_of(frame)?)?;
        self.told = Some(key);
        if pipeline.scale().source == ScaleSource::AssumedCamera && !self.warned {
            self.warned = true;
            warn!(
                "no intrinsics: metres and points assume the training camera\nhint: --intrinsics fx,fy,cx,cy"
            );
        }
        Ok(())
    }
}
