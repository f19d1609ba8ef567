//! Records into a file, pictures as JPEG or PNG.

use std::path::Path;

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use nunet_core::preprocess::Preprocessor;
use nunet_ipc::Clock;
use nunet_mcap::{EncodedPicture, FrameRecord, Mount, RecordingWriter, WriterOptions};

use super::Record;
use crate::cli::MountArg;
use crate::sink::stats::ModelName;
use crate::source::Frame;

/// Of pictures that did not come as files; losses below are hardly seen and the file is a tenth of the raw picture.
const JPEG_QUALITY: u8 = 92;

/// What is known of a recording before its first frame.
pub(crate) struct About<'a> {
    pub(crate) camera: &'a str,
    pub(crate) frame_id: Option<&'a str>,
    pub(crate) mount: Option<MountArg>,
    pub(crate) model: &'a ModelName,
    pub(crate) provider: &'a str,
    /// Overwrite a file that is there.
    pub(crate) force: bool,
}

impl About<'_> {
    fn options(&self) -> WriterOptions {
        let about = [
            ("model", &self.model.name[..]),
            ("model_sha256", &self.model.hash),
            ("provider", self.provider),
        ];
        let mount = self.mount.map(|mount| Mount {
            translation_m: mount.translation_m,
            roll_pitch_yaw_rad: mount.roll_pitch_yaw_rad,
        });
        WriterOptions {
            camera: self.camera.to_owned(),
            frame_id: self.frame_id.map_or_else(|| format!("{}_optical_frame", self.camera), str::to_owned),
            mount,
            about: about.map(|(key, value)| (key.to_owned(), value.to_owned())).into(),
            force: self.force,
        }
    }
}

/// A file that takes records.
pub(crate) struct FrameWriter {
    writer: RecordingWriter,
    pictures: PictureEncoder,
}

impl FrameWriter {
    pub(crate) fn create(path: &Path, about: &About<'_>) -> anyhow::Result<Self> {
        let writer = RecordingWriter::create(path, about.options())?;
        Ok(Self { writer, pictures: PictureEncoder::default() })
    }

    pub(crate) fn write(&mut self, record: &Record) -> anyhow::Result<()> {
        let frame = &record.frame;
        let capture = frame.capture;
        // What was recorded before keeps its log time; a camera's frame is logged when it was taken.
        let log_nanos = if capture.clock == Clock::Unix { capture.nanos } else { capture.unix_nanos };
        self.writer.write(&FrameRecord {
            log_nanos: log_nanos.try_into().unwrap_or_default(),
            stamp_nanos: capture.unix_nanos,
            picture: Some(self.pictures.encoded(frame)?),
            camera: record.camera.as_ref(),
            depth: record.depth(),
            depth_camera: record.depth_camera.as_ref(),
            labels: record.labels(),
            cloud: record.cloud(),
        })?;
        Ok(())
    }

    pub(crate) fn sync(&mut self) -> anyhow::Result<()> {
        Ok(self.writer.sync()?)
    }

    pub(crate) fn finish(self) -> anyhow::Result<()> {
        Ok(self.writer.finish()?)
    }
}

/// Gives pictures as files: as they came, else as JPEG.
#[derive(Default)]
struct PictureEncoder {
    to_rgb: Option<((u32, u32), Preprocessor)>,
    jpeg: Vec<u8>,
}

impl PictureEncoder {
    fn encoded<'a>(&'a mut self, frame: &'a Frame) -> anyhow::Result<EncodedPicture<'a>> {
        if !frame.file.is_empty() {
            let format = if frame.file.starts_with(&[0xff, 0xd8]) { "jpeg" } else { "png" };
            return Ok(EncodedPicture { format, data: &frame.file });
        }
        let (width, height) = frame.size;
        if self.to_rgb.as_ref().is_none_or(|(size, _)| *size != frame.size) {
            self.to_rgb = Some((frame.size, Preprocessor::new(width, height)));
        }
        self.jpeg.clear();
        if let Some((_, to_rgb)) = &mut self.to_rgb {
            let picture = to_rgb.prepare(&frame.view()?);
            let mut encoder = JpegEncoder::new_with_quality(&mut self.jpeg, JPEG_QUALITY);
            encoder.encode(picture.rgb, width, height, ExtendedColorType::Rgb8)?;
        }
        Ok(EncodedPicture { format: "jpeg", data: &self.jpeg })
    }
}
