//! Writes copies of frames into an MCAP file.

use std::path::{Path, PathBuf};

use nunet_core::pipeline::Pipeline;
use nunet_ipc::Clock;
use nunet_mcap::{CameraMount, FrameRecord, RecordingWriter, WriterOptions};

use crate::archive::Archive;
use crate::image_encoder::ImageEncoder;
use crate::record::{RecordedFrame, describe};

/// The settings of a recording before its first frame.
pub struct RecordingOptions<'a> {
    /// The camera's name, the first part of the topics' names.
    pub camera: &'a str,
    /// The coordinate frame of images and depth, unless frames state another.
    pub frame_id: &'a str,
    /// The pose of the camera on the robot, if known.
    pub mount: Option<CameraMount>,
    /// The model's file name.
    pub model: &'a str,
    /// The model file's SHA-256, hexadecimal.
    pub model_sha256: &'a str,
    /// The execution provider.
    pub provider: &'a str,
    /// From [`settings`].
    pub settings: [(&'static str, String); 2],
    /// Overwrite an existing file.
    pub force: bool,
    /// Raw images become PNG instead of JPEG.
    pub lossless: bool,
}

impl RecordingOptions<'_> {
    fn writer_options(&self) -> WriterOptions {
        let about = [
            ("model", self.model.to_owned()),
            ("model_sha256", self.model_sha256.to_owned()),
            ("provider", self.provider.to_owned()),
        ];
        let about = about.into_iter().chain(self.settings.clone());
        WriterOptions {
            camera: self.camera.to_owned(),
            frame_id: self.frame_id.to_owned(),
            mount: self.mount,
            about: about.map(|(key, value)| (key.to_owned(), value)).collect(),
            force: self.force,
        }
    }
}

/// The settings besides the model that change depth: the filters in their order, and the stages that do not
/// run for each frame.
#[must_use]
pub fn settings(pipeline: &Pipeline) -> [(&'static str, String); 2] {
    let filters: Vec<_> = pipeline.filters().specs().map(|filter| filter.to_string()).collect();
    let stages = pipeline.graph().stages().iter().filter(|stage| stage.every > 1);
    let every: Vec<_> = stages.map(|stage| format!("{}={}", stage.name, stage.every)).collect();
    [("filters", filters.join(" ")), ("every", every.join(" "))]
}

/// An MCAP file that is being written.
pub struct FrameWriter {
    path: PathBuf,
    writer: RecordingWriter,
    images: ImageEncoder,
}

impl FrameWriter {
    /// Creates the file.
    ///
    /// # Errors
    /// It exists and must not be overwritten, or cannot be created.
    pub fn create(path: &Path, options: &RecordingOptions<'_>) -> anyhow::Result<Self> {
        let writer = RecordingWriter::create(path, options.writer_options())?;
        Ok(Self { path: path.to_owned(), writer, images: ImageEncoder::new(options.lossless) })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// The image cannot be encoded, or the file cannot be written.
    pub fn write(&mut self, record: &RecordedFrame) -> anyhow::Result<()> {
        let frame = &record.frame;
        let capture = frame.capture;
        // A replayed frame keeps its log time; the log time of a camera's frame is its capture time.
        let log_nanos = if capture.clock == Clock::Unix { capture.nanos } else { capture.unix_nanos };
        let camera = record.camera.as_ref().map(describe);
        let depth_camera = record.depth_camera.as_ref().map(describe);
        let log_nanos = log_nanos.try_into().unwrap_or_default();
        if !frame.frame_id.is_empty() {
            self.writer.set_frame_id(&frame.frame_id);
        }
        if let Some(roll_pitch_rad) = record.roll_pitch_rad() {
            self.writer.write_attitude(roll_pitch_rad, log_nanos, capture.unix_nanos)?;
        }
        if let Some(obstacles) = record.obstacles() {
            self.writer.write_obstacles(&obstacles, log_nanos, capture.unix_nanos)?;
        }
        self.writer.write(&FrameRecord {
            log_nanos,
            stamp_nanos: capture.unix_nanos,
            image: Some(self.images.encoded(frame)?),
            camera: camera.as_ref(),
            depth: record.depth(),
            depth_camera: depth_camera.as_ref(),
            labels: record.labels(),
            confidence: record.confidence(),
            cloud: record.cloud(),
        })?;
        Ok(())
    }

    /// Makes everything written so far durable.
    ///
    /// # Errors
    /// The disk did not confirm it.
    pub fn sync(&mut self) -> anyhow::Result<()> {
        Ok(self.writer.sync()?)
    }

    /// Writes the end of the file.
    ///
    /// # Errors
    /// It could not be written.
    pub fn finish(self) -> anyhow::Result<()> {
        Ok(self.writer.finish()?)
    }
}

impl Archive for FrameWriter {
    fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, record: &RecordedFrame) -> anyhow::Result<()> {
        Self::write(self, record)
    }

    fn sync(&mut self) -> anyhow::Result<()> {
        Self::sync(self)
    }

    fn finish(self: Box<Self>) -> anyhow::Result<()> {
        Self::finish(*self)
    }
}
