//! Pictures of a recording, in the order in which they were recorded.

use std::io::ErrorKind;
use std::path::Path;

use anyhow::bail;
use nunet_core::camera::{Camera, Distortion, Intrinsics};
use nunet_core::frame::PixelFormat;
use nunet_ipc::Clock;
use nunet_mcap::{CameraDescription, Encoding, Next, Picture, Recording, RecordingError};
use tracing::warn;

use super::files::nothing_good_to_repeat;
use super::{Capture, Fill, Frame, Opening, Source, decode_file};
use crate::exit::BadArguments;

/// An MCAP file. Its log time is the clock, its messages' stamps are unix time.
pub(crate) struct RecordingSource {
    recording: Recording,
    picture: Picture,
    sequence: u64,
    stretch: u64,
    repeat: bool,
    /// Whether any picture of this round could be read.
    any_good: bool,
    /// What `camera` was made of, and for which size.
    described: Option<(CameraDescription, (u32, u32))>,
    camera: Option<Camera>,
}

impl RecordingSource {
    pub(crate) fn open(path: &Path, how: Opening<'_>) -> anyhow::Result<Self> {
        if path.is_dir() {
            bail!(BadArguments(no_recording(path)));
        }
        let recording = Recording::open_unless(path, how.topic, &|| how.is_given_up()).map_err(sorted)?;
        let picture = Picture::default();
        let (described, camera, repeat) = (None, None, how.repeat);
        Ok(Self { recording, picture, sequence: 0, stretch: 0, repeat, any_good: false, described, camera })
    }

    /// The coordinate frame of the last picture.
    pub(crate) fn frame_id(&self) -> &str {
        &self.picture.frame_id
    }

    /// The topic whose pictures are read.
    pub(crate) fn topic(&self) -> &str {
        self.recording.topic()
    }

    /// How many pictures the recording has, where its index says so.
    pub(crate) fn pictures(&self) -> Option<u64> {
        self.recording.picture_count()
    }

    fn begin_again(&mut self, frame: &mut Frame) -> Fill {
        if !self.repeat || self.sequence == 0 {
            return Fill::End;
        }
        if !self.any_good {
            return nothing_good_to_repeat();
        }
        self.any_good = false;
        self.stretch += 1;
        match self.recording.rewind().map(|()| self.take(frame)) {
            // Another file has the recording's name by now.
            Ok(Fill::End) => nothing_good_to_repeat(),
            Ok(fill) => fill,
            Err(error) => Fill::Broken(error.into()),
        }
    }

    fn take(&mut self, frame: &mut Frame) -> Fill {
        let next = self.recording.next(&mut self.picture);
        frame.sequence = self.sequence;
        match next {
            Next::Picture => {
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
                Fill::Failed(error.into())
            }
            Next::Nothing => Fill::Nothing,
            Next::End => Fill::End,
            Next::Cut(error) => Fill::Cut(error.into()),
        }
    }

    fn fill_frame(&mut self, frame: &mut Frame) -> anyhow::Result<()> {
        let picture = &mut self.picture;
        if picture.encoding.is_some_and(Encoding::is_depth) {
            bail!("topic `{}` carries depth\nhint: --topic names one with pictures", self.recording.topic());
        }
        let log_nanos = i64::try_from(picture.log_nanos).unwrap_or(i64::MAX);
        let unix_nanos = picture.unix_nanos();
        frame.capture = Capture { nanos: log_nanos, clock: Clock::Unix, unix_nanos };
        frame.stretch = self.stretch;
        match pixel_format(picture.encoding) {
            Some(format) => {
                frame.file.clear();
                frame.buffer(picture.data.len()).copy_from_slice(&picture.data);
                frame.format = Some(format);
                frame.size = (picture.width, picture.height);
                frame.row_stride = picture.row_stride;
            }
            None => {
                std::mem::swap(&mut frame.file, &mut picture.data);
                decode_file(frame)?;
            }
        }
        frame.camera = self.camera_of(frame.size);
        Ok(())
    }

    /// The camera of the recording, at the picture's size. One that makes no sense is told once and not used.
    fn camera_of(&mut self, size: (u32, u32)) -> Option<Camera> {
        let described = self.recording.camera();
        let known = self.described.as_ref().map(|(described, size)| (described, *size));
        if described.map(|described| (described, size)) != known {
            self.described = described.cloned().map(|described| (described, size));
            self.camera = self.described.as_ref().and_then(|(described, size)| {
                camera(described, *size)
                    .inspect_err(|error| {
                        warn!("the recording's camera on `{}` is not used: {error}", self.recording.topic());
                    })
                    .ok()
            });
        }
        self.camera
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

/// What the user can mend by other arguments is told apart from what is wrong with the file.
pub(crate) fn sorted(error: RecordingError) -> anyhow::Error {
    match error {
        RecordingError::SeveralTopics { .. }
        | RecordingError::SeveralDepths { .. }
        | RecordingError::NoSuchTopic { .. }
        | RecordingError::NotAPicture { .. } => BadArguments(error.to_string()).into(),
        // The cause stays beneath: programs that this one is a part of look for it.
        RecordingError::Io { path, source, .. } if source.kind() == ErrorKind::NotFound => {
            let text = format!(
                "cannot open the recording `{}`\nhint: name an MCAP file that is there",
                path.display()
            );
            anyhow::Error::from(source).context(BadArguments(text))
        }
        error => error.into(),
    }
}

/// What to say of a folder that was named as a recording.
fn no_recording(folder: &Path) -> String {
    let hint = recordings_in(folder).unwrap_or_else(|| "name an MCAP file".to_owned());
    format!("`{}` is a folder and no recording\nhint: {hint}", folder.display())
}

/// The hint for a folder of recordings, as `ros2 bag record` makes them; `None` of any other.
pub(super) fn recordings_in(folder: &Path) -> Option<String> {
    let paths = folder.read_dir().ok()?.flatten().map(|entry| entry.path());
    let first = paths.filter(|path| path.extension().is_some_and(|ending| ending == "mcap")).min()?;
    Some(format!("name the .mcap file in it: {}", first.display()))
}

/// `None` of a file that is to be decoded.
fn pixel_format(encoding: Option<Encoding>) -> Option<PixelFormat> {
    match encoding? {
        Encoding::File | Encoding::DepthMetres | Encoding::DepthMillimetres => None,
        Encoding::Rgb8 => Some(PixelFormat::Rgb8),
        Encoding::Bgr8 => Some(PixelFormat::Bgr8),
        Encoding::Mono8 => Some(PixelFormat::Mono8),
        Encoding::Yuyv => Some(PixelFormat::Yuyv),
        Encoding::Nv12 => Some(PixelFormat::Nv12),
    }
}

fn camera(described: &CameraDescription, (width, height): (u32, u32)) -> anyhow::Result<Camera> {
    if let Some(fault) = &described.fault {
        bail!("{fault}\nhint: --calibration FILE.yaml or --intrinsics fx,fy,cx,cy says what the camera is");
    }
    let [fx, fy, cx, cy] = described.intrinsics;
    let intrinsics = Intrinsics::new(fx, fy, cx, cy, described.width, described.height)?;
    // Four zeros of a fisheye are an ideal fisheye, not a pinhole.
    let straight = described.coefficients.iter().all(|&coefficient| coefficient == 0.0);
    let distortion = if described.coefficients.is_empty() || (straight && !described.is_fisheye()) {
        Distortion::None
    } else {
        Distortion::from_ros(&described.distortion_model, &described.coefficients)?
    };
    Ok(Camera { intrinsics, distortion }.fitted_to(width, height)?)
}

#[cfg(test)]
pub(crate) mod tests {
    use std::collections::BTreeMap;

    use nunet_mcap::{DepthRecord, EncodedPicture, FrameRecord, RecordingWriter, WriterOptions};

    use super::*;

    /// A recording with a frame a nanosecond, with the file of a PNG picture or without one.
    pub(crate) fn write_recording(path: &Path, frame_id: &str, pictures: &[Option<&[u8]>]) {
        let options = WriterOptions {
            camera: "front".into(),
            frame_id: frame_id.into(),
            mount: None,
            about: BTreeMap::new(),
            force: false,
        };
        let mut writer = RecordingWriter::create(path, options).unwrap();
        for (log_nanos, picture) in (1..).zip(pictures) {
            let frame = FrameRecord {
                log_nanos,
                stamp_nanos: 1,
                picture: picture.map(|data| EncodedPicture { format: "png", data }),
                camera: None,
                depth: DepthRecord { scale: ["metre", "metric"], width: 1, height: 1, bytes: &[0; 4] },
                depth_camera: None,
                labels: None,
                cloud: None,
            };
            writer.write(&frame).unwrap();
        }
        writer.finish().unwrap();
    }

    #[test]
    fn a_loop_ends_with_a_round_without_a_picture() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let broken: &[u8] = b"\x89PNG\r\n\x1a\n no more";
        write_recording(&path, "eye", &[Some(broken), Some(broken)]);
        let how = Opening { repeat: true, ..Opening::default() };
        let (mut source, mut frame) = (RecordingSource::open(&path, how).unwrap(), Frame::default());
        for _ in 0..2 {
            assert!(matches!(source.fill(&mut frame), Fill::Failed(_)));
        }
        assert!(matches!(source.fill(&mut frame), Fill::Broken(_)), "there is nothing to repeat");
    }

    #[test]
    fn a_camera_that_contradicts_itself_is_not_used_and_says_why() {
        let described = CameraDescription {
            width: 640,
            height: 480,
            intrinsics: [500.0, 500.0, 320.0, 240.0],
            ..CameraDescription::default()
        };
        assert_eq!(camera(&described, (320, 240)).unwrap().intrinsics.fx_px, 250.0);
        let faulty = CameraDescription { fault: Some("its region of interest is none".into()), ..described };
        let error = camera(&faulty, (320, 240)).unwrap_err().to_string();
        assert!(error.starts_with("its region of interest is none\nhint: --calibration"), "{error}");
    }
}
