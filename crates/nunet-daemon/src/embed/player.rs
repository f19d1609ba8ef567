//! A recording through a model, one picture after the other.

use std::path::Path;

use nunet_core::camera::Camera;

use super::{Inferred, Model};
use crate::source::{Fill, Frame, Opening, RecordingSource, Source as _};
use crate::stream::Continuity;

/// A recording that is read from its beginning.
pub struct Player {
    source: RecordingSource,
    camera: Option<Camera>,
    continuity: Continuity,
    frame: Frame,
    /// The model's count of runs after the last frame: another one means that somebody else used it in between.
    left_at: Option<u64>,
}

/// A picture of a recording, with its results.
#[derive(Debug)]
pub struct Played {
    /// The results.
    pub inferred: Inferred,
    /// Counts the recording's pictures from 0, readable or not.
    pub sequence: u64,
    /// The picture's own stamp, nanoseconds since 1970.
    pub capture_unix_nanos: i64,
    /// The picture's coordinate frame.
    pub frame_id: String,
    /// Width and height as recorded, pixels.
    pub frame_size: (u32, u32),
}

/// What came next.
#[derive(Debug)]
pub enum Step {
    /// A picture's results.
    Played(Box<Played>),
    /// A picture that is lost; the next one may be good.
    Lost {
        /// Its place, from 0.
        sequence: u64,
        /// Why.
        error: anyhow::Error,
    },
    /// No picture for a while; ask again.
    Nothing,
    /// The recording is over.
    End,
}

impl Player {
    /// Opens a recording: the pictures on `topic`, where it has several, taken with `camera` where it is not what the
    /// recording says.
    ///
    /// # Errors
    /// No file, no MCAP, no topic or several topics with pictures.
    pub fn open(path: &Path, topic: Option<&str>, camera: Option<Camera>) -> anyhow::Result<Self> {
        let source = RecordingSource::open(path, Opening { topic, ..Opening::default() })?;
        let (continuity, frame) = (Continuity::default(), Frame::default());
        Ok(Self { source, camera, continuity, frame, left_at: None })
    }

    /// The topic whose pictures are read.
    #[must_use]
    pub fn topic(&self) -> &str {
        self.source.topic()
    }

    /// How many pictures there are, where the file's index says so.
    #[must_use]
    pub fn pictures(&self) -> Option<u64> {
        self.source.pictures()
    }

    /// Reads up to the next picture and takes it through `model`.
    ///
    /// # Errors
    /// The file is damaged or cut off here; everything before was given.
    pub fn step(&mut self, model: &mut Model) -> anyhow::Result<Step> {
        let sequence = |frame: &Frame| frame.sequence;
        match self.source.fill(&mut self.frame) {
            Fill::Frame => Ok(match self.take_through(model) {
                Ok(played) => Step::Played(Box::new(played)),
                Err(error) => Step::Lost { sequence: sequence(&self.frame), error },
            }),
            Fill::Failed(error) => Ok(Step::Lost { sequence: sequence(&self.frame), error }),
            Fill::Nothing | Fill::Crowded => Ok(Step::Nothing),
            Fill::End => Ok(Step::End),
            Fill::Cut(error) | Fill::Broken(error) => Err(error),
        }
    }

    fn take_through(&mut self, model: &mut Model) -> anyhow::Result<Played> {
        let frame = &self.frame;
        let (width, height) = frame.size;
        let named = self.camera.map(|camera| camera.fitted_to(width, height)).transpose()?;
        let keep_state = self.continuity.jump_to(frame).is_none() && self.left_at == Some(model.runs());
        let inferred = model.infer(&frame.view()?, named.or(frame.camera), keep_state)?;
        self.continuity.took(frame);
        self.left_at = Some(model.runs());
        Ok(Played {
            inferred,
            sequence: frame.sequence,
            capture_unix_nanos: frame.capture.unix_nanos,
            frame_id: self.source.frame_id().to_owned(),
            frame_size: frame.size,
        })
    }
}
