//! A source whose frames are rotated.

use crate::frame::{Frame, Pixels};
use crate::rotation::{Rotation, Rotator};
use crate::source::{Fill, Source};

/// A source whose frames are rotated.
pub struct Rotated<S> {
    source: S,
    rotator: Option<Rotator>,
    /// Whether the last frame was in memory of another process. Such a source does not use the frame's own
    /// memory.
    is_lent: bool,
}

impl<S: Source> Rotated<S> {
    /// Rotates the frames of `source`; `None` leaves them unchanged.
    pub fn new(source: S, rotation: Option<Rotation>) -> Self {
        Self { source, rotator: rotation.map(Rotator::new), is_lent: false }
    }

    /// The source.
    pub fn source(&self) -> &S {
        &self.source
    }
}

impl<S: Source> Source for Rotated<S> {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        let Some(rotator) = &mut self.rotator else { return self.source.fill(frame) };
        if self.is_lent
            && let Pixels::Owned(own) = &mut frame.pixels
        {
            rotator.reuse(std::mem::take(own));
        }
        let fill = self.source.fill(frame);
        if !matches!(fill, Fill::Frame) {
            return fill;
        }
        self.is_lent = matches!(frame.pixels, Pixels::Shared(_));
        rotator.rotate(frame).map_or_else(Fill::Failed, |()| Fill::Frame)
    }

    fn is_live(&self) -> bool {
        self.source.is_live()
    }

    fn is_waiting(&self) -> bool {
        self.source.is_waiting()
    }
}
