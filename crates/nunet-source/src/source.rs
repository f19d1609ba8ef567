//! The trait of all sources: fills one frame after the other.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use nunet_types::{ImageSize, PixelFormat};

use crate::{CameraSettings, Frame, Rate, Rotation, SourceError};

/// What happened when a source was asked for a frame.
#[derive(Debug)]
pub enum Fill {
    /// The frame is filled.
    Frame,
    /// There was a frame, but it cannot be read; the next one may be good.
    Failed(SourceError),
    /// There is no frame yet; call again.
    Nothing,
    /// All memory that the source lends is in use: release frames first.
    Crowded,
    /// There will be no more frames.
    End,
    /// There will be no more frames, because the rest of the source is lost; those before were good.
    Cut(SourceError),
    /// There will be no more frames, and that is a failure.
    Broken(SourceError),
}

impl Fill {
    /// Whether there was a frame, readable or not. A schedule counts these.
    #[must_use]
    pub fn had_frame(&self) -> bool {
        matches!(self, Self::Frame | Self::Failed(_))
    }
}

/// A source of frames. It runs on a thread of its own and is asked for one frame after the other.
///
/// After [`Fill::End`], [`Fill::Cut`] or [`Fill::Broken`] every further call returns [`Fill::End`].
pub trait Source: Send {
    /// Fills `frame` with the next image and reuses its memory.
    ///
    /// Returns within a fraction of a second even if there is no frame, so that a stop is handled in time.
    fn fill(&mut self, frame: &mut Frame) -> Fill;

    /// Whether frames arrive at their own pace, as from a camera. The newest frame of a live source
    /// replaces older ones. Every frame of another source is processed, unless a rate is requested.
    fn is_live(&self) -> bool {
        false
    }

    /// Whether the source waits for a missing device or publisher.
    fn is_waiting(&self) -> bool {
        false
    }
}

impl<S: Source + ?Sized> Source for Box<S> {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        (**self).fill(frame)
    }

    fn is_live(&self) -> bool {
        (**self).is_live()
    }

    fn is_waiting(&self) -> bool {
        (**self).is_waiting()
    }
}

/// A source whose first frame was filled already.
pub struct StartingWith<'a> {
    first: Option<Fill>,
    source: &'a mut dyn Source,
}

impl<'a> StartingWith<'a> {
    /// `first` is what `source` answered when the frame was filled that is passed first.
    pub fn new(first: Fill, source: &'a mut dyn Source) -> Self {
        Self { first: Some(first), source }
    }
}

impl Source for StartingWith<'_> {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        self.first.take().unwrap_or_else(|| self.source.fill(frame))
    }

    fn is_live(&self) -> bool {
        self.source.is_live()
    }

    fn is_waiting(&self) -> bool {
        self.source.is_waiting()
    }
}

/// The first readable frame; `None` if there is none within 100 calls.
///
/// # Errors
/// The source fails.
pub fn first_frame(source: &mut dyn Source) -> Result<Option<Frame>, SourceError> {
    const MAX_FILLS: usize = 100;
    let mut frame = Frame::default();
    for _ in 0..MAX_FILLS {
        match source.fill(&mut frame) {
            Fill::Frame => return Ok(Some(frame)),
            Fill::Failed(_) | Fill::Nothing => {}
            Fill::Broken(error) => return Err(error),
            Fill::Crowded | Fill::End | Fill::Cut(_) => break,
        }
    }
    Ok(None)
}

/// How a source is opened.
#[derive(Debug, Clone, Copy, Default)]
pub struct OpenOptions<'a> {
    /// Whether files and recordings are repeated.
    pub repeat: bool,
    /// The recording's topic, if several carry images.
    pub topic: Option<&'a str>,
    /// Size of raw images on standard input, or the requested size of a camera.
    pub size: Option<ImageSize>,
    /// Format of raw images on standard input; Y4M without it.
    pub format: Option<PixelFormat>,
    /// The requested rate of a camera; the caller keeps the rate of other sources.
    pub rate: Option<Rate>,
    /// Exposure and gain of a camera.
    pub camera_settings: CameraSettings,
    /// How images are rotated before anything else.
    pub rotation: Option<Rotation>,
    /// Whether the caller chose a coordinate frame: that of the source is not stated then.
    pub has_frame_id: bool,
    /// Set when the caller no longer wants the source: opening may take a long time.
    pub stopped: Option<&'a AtomicBool>,
    /// Folders with the models and the images of the demo.
    pub model_folders: &'a [PathBuf],
}

impl OpenOptions<'_> {
    /// Whether the caller no longer wants the source.
    #[must_use]
    pub fn is_given_up(&self) -> bool {
        self.stopped.is_some_and(|stopped| stopped.load(Ordering::Relaxed))
    }
}

/// Wraps a source so that all calls after its end return [`Fill::End`], like `Iterator::fuse`.
pub(crate) struct Fused<S>(Option<S>);

impl<S: Source> Fused<S> {
    pub(crate) fn new(source: S) -> Self {
        Self(Some(source))
    }
}

impl<S: Source> Source for Fused<S> {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        let Some(source) = &mut self.0 else { return Fill::End };
        let fill = source.fill(frame);
        if matches!(fill, Fill::End | Fill::Cut(_) | Fill::Broken(_)) {
            self.0 = None;
        }
        fill
    }

    fn is_live(&self) -> bool {
        self.0.as_ref().is_some_and(S::is_live)
    }

    fn is_waiting(&self) -> bool {
        self.0.as_ref().is_some_and(S::is_waiting)
    }
}
