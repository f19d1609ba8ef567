//! Images of a recording, in the order in which they were recorded.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use nunet_ipc::Clock;
use nunet_mcap::{Next, RecordedImage, Recording, RecordingError, RecordingErrorKind};
use nunet_types::Hint as _;

use crate::error::{SourceError, SourceErrorKind};
use crate::files::nothing_to_repeat;
use crate::recorded_image::ImageConverter;
use crate::source::Fused;
use crate::source_type::{Properties, SourceType};
use crate::{CaptureTime, Fill, Frame, OpenOptions, Source};

/// An MCAP file, or the folder of a bag.
pub(crate) struct RecordingFile;

impl SourceType for RecordingFile {
    fn is_named(&self, name: &str) -> bool {
        name.ends_with(".mcap") || nunet_mcap::is_recording(Path::new(name))
    }

    fn properties(&self) -> Properties {
        Properties {
            has_attitude: true,
            has_topics: true,
            camera: "camera",
            default_rate: Some("max"),
            ..Properties::default()
        }
    }

    fn files(&self, name: &str) -> Vec<PathBuf> {
        nunet_mcap::files(Path::new(name))
    }

    fn open(&self, name: &str, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        Ok(Box::new(Fused::new(RecordingSource::open(Path::new(name), options)?)))
    }
}

/// Reads a recording. The capture clock is its log time; the messages' stamps are the unix time.
pub struct RecordingSource {
    recording: Recording,
    image: RecordedImage,
    sequence: u64,
    segment: u64,
    repeat: bool,
    /// Whether any image of this round could be read.
    any_good: bool,
    converter: ImageConverter,
}

impl RecordingSource {
    /// Opens a recording.
    ///
    /// # Errors
    /// Not a recording, no topic with images, several of them without a choice, no topic of the requested
    /// name, or one whose images cannot be used.
    pub fn open(path: &Path, options: OpenOptions<'_>) -> Result<Self, SourceError> {
        let recording = Recording::open_unless(path, options.topic, &|| options.is_given_up())
            .map_err(from_recording_error)?;
        Ok(Self {
            recording,
            image: RecordedImage::default(),
            sequence: 0,
            segment: 0,
            repeat: options.repeat,
            any_good: false,
            converter: ImageConverter::default(),
        })
    }

    /// The coordinate frame of the last image.
    #[must_use]
    pub fn frame_id(&self) -> &str {
        &self.image.frame_id
    }

    /// The topic whose images are read.
    #[must_use]
    pub fn topic(&self) -> &str {
        self.recording.topic()
    }

    /// How many images the recording has, if its index states it.
    #[must_use]
    pub fn image_count(&self) -> Option<u64> {
        self.recording.image_count()
    }

    fn begin_again(&mut self, frame: &mut Frame) -> Fill {
        if self.sequence == 0 {
            let message = format!("topic `{}` has no message", self.recording.topic());
            let error = SourceError::new(SourceErrorKind::NothingReadable, message);
            return Fill::Broken(error.with_hint("check whether the camera ran while it was recorded"));
        }
        if !self.repeat {
            return Fill::End;
        }
        if !self.any_good {
            return nothing_to_repeat();
        }
        self.any_good = false;
        self.segment += 1;
        match self.recording.rewind().map(|()| self.take(frame)) {
            // Another file has replaced the recording.
            Ok(Fill::End) => nothing_to_repeat(),
            Ok(fill) => fill,
            Err(error) => Fill::Broken(from_recording_error(error)),
        }
    }

    fn take(&mut self, frame: &mut Frame) -> Fill {
        let next = self.recording.next(&mut self.image);
        frame.sequence = self.sequence;
        match next {
            Next::Image => {
                self.sequence += 1;
                match self.fill_frame(frame) {
                    Ok(()) => {
                        self.any_good = true;
                        Fill::Frame
                    }
                    Err(error) => Fill::Failed(error),
                }
            }
            Next::Bad(error) => {
                self.sequence += 1;
                Fill::Failed(from_recording_error(error))
            }
            Next::Nothing => Fill::Nothing,
            Next::End => Fill::End,
            Next::Cut(error) => Fill::Cut(from_recording_error(error)),
        }
    }

    fn fill_frame(&mut self, frame: &mut Frame) -> Result<(), SourceError> {
        let Self { recording, image, converter, .. } = self;
        let log_nanos = i64::try_from(image.log_nanos).unwrap_or(i64::MAX);
        frame.capture = CaptureTime { nanos: log_nanos, clock: Clock::Unix, unix_nanos: image.unix_nanos() };
        frame.segment = self.segment;
        frame.roll_pitch_rad = image.roll_pitch_rad;
        converter.fill(frame, image, recording.topic(), recording.camera())
    }
}

impl Source for RecordingSource {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        match self.take(frame) {
            Fill::End => self.begin_again(frame),
            fill => fill,
        }
    }
}

/// Converts an error, and separates errors that other arguments would fix from errors of the file.
#[must_use]
pub fn from_recording_error(error: RecordingError) -> SourceError {
    let kind = match (error.kind(), &error) {
        (RecordingErrorKind::Topic, _) | (_, RecordingError::NotARecordingFolder { .. }) => {
            SourceErrorKind::Argument
        }
        (_, RecordingError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
            SourceErrorKind::Argument
        }
        (RecordingErrorKind::Message, _) => SourceErrorKind::BadFrame,
        (RecordingErrorKind::Damaged, _) => SourceErrorKind::CutOff,
        (RecordingErrorKind::NothingToRead, _) => SourceErrorKind::NothingReadable,
        _ => SourceErrorKind::Unavailable,
    };
    let converted = SourceError::new(kind, error.to_string());
    let converted = match error.hint() {
        Some(hint) => converted.with_hint(hint).with_setting(error.setting()),
        None => converted,
    };
    match error {
        // The cause is kept, because programs that embed this crate check it.
        RecordingError::Io { source, .. } if kind == SourceErrorKind::Argument => {
            converted.with_hint("name an existing MCAP file").with_cause(source)
        }
        RecordingError::Io { source, .. } => converted.with_cause(source),
        RecordingError::Write { source, .. } => converted.with_cause(source),
        _ => converted,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use nunet_mcap::{DepthRecord, EncodedImage, FrameRecord, RecordingWriter, ScaleRecord, WriterOptions};

    use super::*;

    /// A recording of one frame per nanosecond, with a PNG file or without one.
    fn write_recording(path: &Path, frame_id: &str, images: &[Option<&[u8]>]) {
        let options = WriterOptions {
            camera: "front".into(),
            frame_id: frame_id.into(),
            mount: None,
            about: BTreeMap::new(),
            force: false,
        };
        let mut writer = RecordingWriter::create(path, options).unwrap();
        for (log_nanos, image) in (1..).zip(images) {
            let frame = FrameRecord {
                log_nanos,
                stamp_nanos: 1,
                image: image.map(|data| EncodedImage { format: "png", data }),
                camera: None,
                depth: DepthRecord { scale: ScaleRecord::default(), width: 1, height: 1, bytes: &[0; 4] },
                depth_camera: None,
                labels: None,
                confidence: None,
                cloud: None,
            };
            writer.write(&frame).unwrap();
        }
        writer.finish().unwrap();
    }

    /// `--record drive` writes such a file.
    #[test]
    fn a_recording_is_a_source_whatever_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("drive");
        let mut png = std::io::Cursor::new(Vec::new());
        image::RgbImage::new(2, 2).write_to(&mut png, image::ImageFormat::Png).unwrap();
        write_recording(&path, "eye", &[Some(png.get_ref().as_slice())]);
        let source = crate::SourceName::parse(path.to_str().unwrap());
        assert!(source.properties().has_attitude && source.files() == [path]);
        let mut opened = source.open(OpenOptions::default()).unwrap();
        assert!(matches!(opened.fill(&mut Frame::default()), Fill::Frame));
    }

    #[test]
    fn a_loop_ends_after_a_round_without_an_image() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let broken: &[u8] = b"\x89PNG\r\n\x1a\n no more";
        write_recording(&path, "eye", &[Some(broken), Some(broken)]);
        let how = OpenOptions { repeat: true, ..OpenOptions::default() };
        let (mut source, mut frame) = (RecordingSource::open(&path, how).unwrap(), Frame::default());
        for _ in 0..2 {
            assert!(matches!(source.fill(&mut frame), Fill::Failed(_)));
        }
        assert!(matches!(source.fill(&mut frame), Fill::Broken(_)), "there is nothing to repeat");
    }

    #[test]
    fn a_topic_without_a_message_is_a_failure() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let broken: &[u8] = b"\x89PNG\r\n\x1a\n no more";
        write_recording(&path, "eye", &[Some(broken)]);
        let mut source = RecordingSource::open(&path, OpenOptions::default()).unwrap();
        let mut frame = Frame::default();
        assert!(matches!(source.fill(&mut frame), Fill::Failed(_)), "its only image is damaged");
        assert!(matches!(source.fill(&mut frame), Fill::End));
        source.sequence = 0;
        assert!(matches!(source.fill(&mut frame), Fill::Broken(_)));
    }

    #[test]
    fn depth_is_refused_as_images_at_the_start() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        write_recording(&path, "eye", &[None]);
        for (topic, kind) in [
            (None, SourceErrorKind::NothingReadable),
            (Some("/front/depth/image_raw"), SourceErrorKind::Argument),
        ] {
            let error = RecordingSource::open(&path, OpenOptions { topic, ..OpenOptions::default() }).err();
            assert_eq!(error.map(|error| error.kind()), Some(kind), "{topic:?}");
        }
    }
}
