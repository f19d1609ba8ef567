//! A recording run through a model, image by image.

use std::path::Path;

use nunet_core::camera::{CalibratedScale, Camera, CameraError};
use nunet_engine::{Inferred, Model};
use nunet_source::{Continuity, Fill, Frame, OpenOptions, RecordingSource, Rotated, Rotation, Source as _};

/// A recording, read from its beginning.
pub(crate) struct ImageReplay {
    source: Rotated<RecordingSource>,
    is_rotated: bool,
    camera: Option<Camera>,
    scale: Option<CalibratedScale>,
    /// Whether the camera fitted an image.
    fits: bool,
    continuity: Continuity,
    frame: Frame,
    /// The model's count of runs after the last frame. If it differs, the model ran on something else in
    /// between.
    left_at: Option<u64>,
}

/// An image of a recording, with its results.
#[derive(Debug)]
pub(crate) struct ReplayedImage {
    /// The results.
    pub(crate) inferred: Inferred,
    /// `false` if the camera's factor of depth is for another model.
    pub(crate) uses_factor: bool,
    /// The image's index in the recording, from 0. Unreadable images count.
    pub(crate) sequence: u64,
    /// The image's time stamp, nanoseconds since 1970.
    pub(crate) capture_unix_nanos: i64,
    /// The image's coordinate frame; `None` if the image was rotated.
    pub(crate) frame_id: Option<String>,
}

/// The outcome of [`ImageReplay::step`].
#[derive(Debug)]
pub(crate) enum ReplayedStep {
    /// The results of an image.
    Image(Box<ReplayedImage>),
    /// An image that cannot be read or processed. The next one may be good.
    Lost {
        /// Its index, from 0.
        sequence: u64,
        /// `false` if the recording's data are at fault.
        was_read: bool,
        /// The reason.
        error: anyhow::Error,
    },
    /// No image yet: call again.
    Nothing,
    /// The recording has ended.
    End,
}

impl ImageReplay {
    /// Opens a recording. `topic` selects one of several image topics, and `camera` overrides the recording's
    /// own; it describes the images before they are rotated.
    ///
    /// # Errors
    /// The file does not exist or is not MCAP, or has no or several image topics.
    pub(crate) fn open(
        path: &Path,
        topic: Option<&str>,
        rotation: Option<Rotation>,
        camera: Option<Camera>,
        scale: Option<CalibratedScale>,
    ) -> anyhow::Result<Self> {
        let source = RecordingSource::open(path, OpenOptions { topic, ..OpenOptions::default() })?;
        let source = Rotated::new(source, rotation);
        let rotated = |camera: Camera| rotation.map_or(Ok(camera), |rotation| rotation.camera(&camera));
        let camera = camera.map(rotated).transpose()?;
        let is_rotated = rotation.is_some();
        let (continuity, frame) = (Continuity::default(), Frame::default());
        Ok(Self { source, is_rotated, camera, scale, fits: false, continuity, frame, left_at: None })
    }

    /// The image topic.
    pub(crate) fn topic(&self) -> &str {
        self.source.source().topic()
    }

    /// The number of images; `None` if the recording has no index.
    pub(crate) fn image_count(&self) -> Option<u64> {
        self.source.source().image_count()
    }

    /// Reads the next image and runs it through `model`.
    ///
    /// # Errors
    /// The file is damaged or cut off at this point; all images before were returned. Or the given camera or
    /// its factor cannot be used, which would fail for every image.
    pub(crate) fn step(&mut self, model: &mut Model) -> anyhow::Result<ReplayedStep> {
        match self.source.fill(&mut self.frame) {
            Fill::Frame => {
                let uses_factor = model.set_calibrated_scale(self.scale)?;
                let camera = match self.camera_of_frame() {
                    // It will not fit the next image either.
                    Err(error) if !self.fits => return Err(error.into()),
                    camera => camera.map_err(anyhow::Error::from),
                };
                self.fits = true;
                let played = camera.and_then(|camera| self.process(model, camera, uses_factor));
                Ok(match played {
                    Ok(played) => ReplayedStep::Image(Box::new(played)),
                    Err(error) => ReplayedStep::Lost { sequence: self.frame.sequence, was_read: true, error },
                })
            }
            Fill::Failed(error) => {
                let sequence = self.frame.sequence;
                Ok(ReplayedStep::Lost { sequence, was_read: false, error: error.into() })
            }
            Fill::Nothing | Fill::Crowded => Ok(ReplayedStep::Nothing),
            Fill::End => Ok(ReplayedStep::End),
            Fill::Cut(error) | Fill::Broken(error) => Err(error.into()),
        }
    }

    /// The camera of the frame, at its size.
    fn camera_of_frame(&self) -> Result<Option<Camera>, CameraError> {
        let size = self.frame.size;
        let given = self.camera.map(|camera| camera.fitted_to(size.width, size.height)).transpose()?;
        Ok(given.or(self.frame.camera))
    }

    fn process(
        &mut self,
        model: &mut Model,
        camera: Option<Camera>,
        uses_factor: bool,
    ) -> anyhow::Result<ReplayedImage> {
        let frame = &self.frame;
        let runs = model.runs();
        let keep_state = self.left_at == Some(runs);
        if keep_state && self.continuity.discontinuity_to(frame).is_some() {
            model.reset();
        }
        model.set_frame_nanos(frame.capture.nanos);
        let inferred = model.infer(&frame.view()?, camera, keep_state);
        // A frame that fails in the network does not change its state.
        if model.runs() > runs {
            self.left_at = Some(model.runs());
        }
        let inferred = inferred?;
        self.continuity.took(frame);
        Ok(ReplayedImage {
            inferred,
            uses_factor,
            sequence: frame.sequence,
            capture_unix_nanos: frame.capture.unix_nanos,
            // The coordinate frame of the images is not that of the rotated ones.
            frame_id: (!self.is_rotated).then(|| self.source.source().frame_id().to_owned()),
        })
    }
}
