//! Which camera a frame was taken with: what the user said, else what the source knows.

use nunet_core::camera::{Camera, CameraError, IntrinsicsSpec};

use crate::source::Frame;

/// The camera of a stream's frames, followed from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Optics {
    named: Option<IntrinsicsSpec>,
    last: Option<Key>,
}

/// What the camera depends on.
#[derive(Debug, Clone, PartialEq)]
struct Key {
    size: (u32, u32),
    camera: Option<Camera>,
}

/// What the pipeline has to be told before a frame.
#[derive(Debug, PartialEq)]
pub(crate) enum Change {
    /// Nothing: the camera is the last frame's.
    None,
    /// This camera took the frame, at the frame's size; `None` when nobody knows it.
    To(Option<Camera>),
}

impl Optics {
    /// Intrinsics that the user named come before those of the source.
    pub(crate) fn new(named: Option<IntrinsicsSpec>) -> Self {
        Self { named, last: None }
    }

    /// Compares `frame`'s camera with the last one's.
    ///
    /// # Errors
    /// The named intrinsics do not fit the frame's size.
    pub(crate) fn follow(&mut self, frame: &Frame) -> Result<Change, CameraError> {
        let same = |key: &Key| key.size == frame.size && key.camera == frame.camera;
        if self.last.as_ref().is_some_and(same) {
            return Ok(Change::None);
        }
        let (width, height) = frame.size;
        let named = self.named.as_ref().map(|spec| spec.at_size(width, height)).transpose()?;
        self.last = Some(Key { size: frame.size, camera: frame.camera });
        Ok(Change::To(named.map(Camera::pinhole).or(frame.camera)))
    }
}
