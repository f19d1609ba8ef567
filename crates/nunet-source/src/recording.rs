//! Images of a recording, in the order in which they were recorded.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use nunet_core::camera::{Calibration, Camera, RosCameraInfo};
use nunet_core::frame::PixelFormat;
use nunet_ipc::Clock;
use nunet_mcap::{
    BayerPattern, CameraDescription, ImageEncoding, Next, RecordedImage, Recording, RecordingError,
    RecordingErrorKind,
};
use nunet_types::{Hint as _, ImageSize, SensorRegion};
use tracing::warn;

use crate::bit_depth::BitDepthCheck;
use crate::convert::{self, Bayer, RawImageView, RawLayout};
use crate::error::{SourceError, SourceErrorKind};
use crate::files::nothing_to_repeat;
use crate::orientation::oriented_camera;
use crate::source::Fused;
use crate::source_type::{Properties, SourceType};
use crate::{CaptureTime, Fill, Frame, OpenOptions, Source, decode_file};

/// The orientation of an image that was not rotated.
const UPRIGHT: image::metadata::Orientation = image::metadata::Orientation::NoTransforms;

/// An MCAP file, or the folder of a bag.
pub(crate) struct RecordingFile;

impl SourceType for RecordingFile {
    fn is_named(&self, name: &str) -> bool {
        name.ends_with(".mcap") || nunet_mcap::is_recording(Path::new(name))
    }

    fn properties(&self) -> Properties {
        Properties {
            is_recording: true,
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
    cameras: CameraCache,
    bit_depth: BitDepthCheck,
}

impl RecordingSource {
    /// Opens a recording.
    ///
    /// # Errors
    /// Not a recording, no topic with images, several of them without a choice, or no topic of the requested
    /// name.
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
            cameras: CameraCache::default(),
            bit_depth: BitDepthCheck::default(),
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
        let image = &mut self.image;
        let log_nanos = i64::try_from(image.log_nanos).unwrap_or(i64::MAX);
        frame.capture = CaptureTime { nanos: log_nanos, clock: Clock::Unix, unix_nanos: image.unix_nanos() };
        frame.segment = self.segment;
        let mut orientation = UPRIGHT;
        if image.encoding == Some(ImageEncoding::File) {
            std::mem::swap(&mut frame.file, &mut image.data);
            orientation = decode_file(frame)?;
        } else {
            frame.file.clear();
            let topic = self.recording.topic();
            let layout = layout(image.encoding).ok_or_else(|| {
                SourceError::bad_frame(format!("topic `{topic}` carries depth"))
                    .with_hint("name a topic with images")
            })?;
            let size = ImageSize::new(image.width, image.height);
            let raw = RawImageView { layout, size, row_stride: image.row_stride, bytes: &image.data };
            if let Some(maximum) = self.bit_depth.dim_maximum(&raw) {
                let hint = "scale the values to 16 bits before recording: 10 bits by 64, 12 bits by 16";
                warn!(
                    hint,
                    "the 16-bit images on topic `{topic}` are almost black: at most {maximum} of 65535"
                );
            }
            if !convert::fill(frame, raw) {
                return Err(SourceError::bad_frame(format!("an image on topic `{topic}` has too few bytes")));
            }
        }
        frame.camera = self.cameras.camera(&self.recording, frame.size, orientation);
        Ok(())
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

/// The camera of a recording, computed when its description changes.
#[derive(Default)]
struct CameraCache {
    made_of: Option<(CameraDescription, ImageSize, u8)>,
    camera: Option<Camera>,
}

impl CameraCache {
    /// The camera at the image's size. An invalid one is reported once and not used.
    fn camera(
        &mut self,
        recording: &Recording,
        size: ImageSize,
        orientation: image::metadata::Orientation,
    ) -> Option<Camera> {
        let described = recording.camera()?;
        let is_same = |(made_of, its_size, its_turn): &(CameraDescription, ImageSize, u8)| {
            made_of == described && *its_size == size && *its_turn == orientation.to_exif()
        };
        if !self.made_of.as_ref().is_some_and(is_same) {
            self.made_of = Some((described.clone(), size, orientation.to_exif()));
            self.camera = camera(described, size, orientation)
                .inspect_err(|error| {
                    warn!("the recording's camera for `{}` is not used: {error}", recording.topic());
                })
                .ok();
        }
        self.camera
    }
}

/// Converts an error, and separates errors that other arguments would fix from errors of the file.
#[must_use]
pub fn from_recording_error(error: RecordingError) -> SourceError {
    let kind = match (error.kind(), &error) {
        (RecordingErrorKind::Topic, _) | (_, RecordingError::NotARecordingFolder { .. }) => {
            SourceErrorKind::BadArguments
        }
        (_, RecordingError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
            SourceErrorKind::BadArguments
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
        RecordingError::Io { source, .. } if kind == SourceErrorKind::BadArguments => {
            converted.with_hint("name an existing MCAP file").with_cause(source)
        }
        RecordingError::Io { source, .. } => converted.with_cause(source),
        RecordingError::Write { source, .. } => converted.with_cause(source),
        _ => converted,
    }
}

/// `None` for depth and for a file that is to be decoded.
fn layout(encoding: Option<ImageEncoding>) -> Option<RawLayout> {
    let channels = |format, channels, bytes| Some(RawLayout::Channels { format, channels, bytes });
    let bayer = |pattern| match pattern {
        BayerPattern::Rggb => Bayer::RGGB,
        BayerPattern::Bggr => Bayer::BGGR,
        BayerPattern::Gbrg => Bayer::GBRG,
        BayerPattern::Grbg => Bayer::GRBG,
    };
    match encoding? {
        ImageEncoding::Rgb8 => Some(RawLayout::Direct(PixelFormat::Rgb8)),
        ImageEncoding::Bgr8 => Some(RawLayout::Direct(PixelFormat::Bgr8)),
        ImageEncoding::Mono8 => Some(RawLayout::Direct(PixelFormat::Mono8)),
        ImageEncoding::Yuyv => Some(RawLayout::Direct(PixelFormat::Yuyv)),
        ImageEncoding::Nv12 => Some(RawLayout::Direct(PixelFormat::Nv12)),
        ImageEncoding::Rgba8 => channels(PixelFormat::Rgb8, 4, 1),
        ImageEncoding::Bgra8 => channels(PixelFormat::Bgr8, 4, 1),
        ImageEncoding::Rgb16 => channels(PixelFormat::Rgb8, 3, 2),
        ImageEncoding::Bgr16 => channels(PixelFormat::Bgr8, 3, 2),
        ImageEncoding::Rgba16 => channels(PixelFormat::Rgb8, 4, 2),
        ImageEncoding::Bgra16 => channels(PixelFormat::Bgr8, 4, 2),
        ImageEncoding::Mono16 => channels(PixelFormat::Mono8, 1, 2),
        ImageEncoding::Uyvy => Some(RawLayout::Uyvy),
        ImageEncoding::Nv21 => Some(RawLayout::Nv21),
        ImageEncoding::I420 => Some(RawLayout::Planes { v_first: false }),
        ImageEncoding::Yv12 => Some(RawLayout::Planes { v_first: true }),
        ImageEncoding::Bayer8(pattern) => Some(RawLayout::Mosaic { pattern: bayer(pattern), bytes: 1 }),
        ImageEncoding::Bayer16(pattern) => Some(RawLayout::Mosaic { pattern: bayer(pattern), bytes: 2 }),
        _ => None,
    }
}

/// The camera of an image of `size` that was turned as `orientation` states. The description is that of the
/// stored image.
fn camera(
    described: &CameraDescription,
    size: ImageSize,
    orientation: image::metadata::Orientation,
) -> Result<Camera, String> {
    if let Some(fault) = &described.fault {
        return Err(fault.clone());
    }
    let [fx, fy, cx, cy] = described.intrinsics;
    // Four zeros of a fisheye are an ideal fisheye, not a pinhole.
    let straight = described.coefficients.iter().all(|&coefficient| coefficient == 0.0);
    let is_pinhole = described.coefficients.is_empty() || (straight && !described.is_fisheye());
    let (distortion_model, d): (&str, &[f64]) =
        if is_pinhole { ("", &[]) } else { (&described.distortion_model, &described.coefficients) };
    let k = [fx, described.skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    let (width, height, region) = (described.width, described.height, SensorRegion::default());
    let info = RosCameraInfo { width, height, k: &k, distortion_model, d, region };
    let calibration = Calibration::from_ros(&info).map_err(|error| error.to_string())?;
    if let Some(skew) = calibration.ignored_skew() {
        warn!("{skew}");
    }
    if let Some(model) = calibration.assumed_model() {
        warn!(
            "the recording's camera names no distortion model: its {} coefficients are read as `{model}`",
            d.len()
        );
    }
    let camera = oriented_camera(&calibration.camera(), orientation)?;
    camera.fitted_to(size.width, size.height).map_err(|error| error.to_string())
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
                cloud: None,
            };
            writer.write(&frame).unwrap();
        }
        writer.finish().unwrap();
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
        write_recording(&path, "eye", &[None]);
        let how = OpenOptions { topic: Some("/front/depth/image_raw"), ..OpenOptions::default() };
        let (mut source, mut frame) = (RecordingSource::open(&path, how).unwrap(), Frame::default());
        assert!(matches!(source.fill(&mut frame), Fill::Failed(_)), "its only message is depth");
        assert!(matches!(source.fill(&mut frame), Fill::End));
        let Err(error) = RecordingSource::open(&path, OpenOptions::default()) else {
            panic!("it has depth only")
        };
        assert_eq!(error.kind(), SourceErrorKind::NothingReadable);
        source.sequence = 0;
        assert!(matches!(source.fill(&mut frame), Fill::Broken(_)));
    }

    #[test]
    fn a_camera_without_a_distortion_model_has_the_one_of_its_coefficients() {
        let lens = |coefficients: &[f64]| {
            let described = CameraDescription {
                width: 640,
                height: 480,
                intrinsics: [500.0, 500.0, 320.0, 240.0],
                coefficients: coefficients.to_vec(),
                ..CameraDescription::default()
            };
            camera(&described, ImageSize::new(640, 480), UPRIGHT).map(|camera| camera.distortion.to_ros())
        };
        let (barrel, none) = ([-0.3, 0.1, 0.001, 0.0005, 0.02], ("plumb_bob", vec![0.0; 5]));
        assert_eq!(lens(&barrel), Ok(("plumb_bob", barrel.to_vec())));
        assert_eq!((lens(&[]), lens(&[0.0; 5])), (Ok(none.clone()), Ok(none)));
        assert!(lens(&[0.1; 3]).is_err());
    }

    #[test]
    fn a_contradictory_camera_is_ignored_with_a_warning() {
        let described = CameraDescription {
            width: 640,
            height: 480,
            intrinsics: [500.0, 500.0, 320.0, 240.0],
            ..CameraDescription::default()
        };
        assert_eq!(camera(&described, ImageSize::new(320, 240), UPRIGHT).unwrap().intrinsics.fx_px, 250.0);
        let faulty = CameraDescription { fault: Some("its region of interest is none".into()), ..described };
        let error = camera(&faulty, ImageSize::new(320, 240), UPRIGHT).unwrap_err();
        assert_eq!(error, "its region of interest is none");
    }
}
