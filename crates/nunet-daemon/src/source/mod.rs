//! Where frames come from. One file a kind of source; a new one implements [`Source`] and is named in
//! [`Kind::parse`] and [`open`].

pub mod demo;
mod files;
mod frame;
mod pipe;
mod rate;
mod recording;
mod scene;
mod shm;
mod v4l2;

pub(crate) use files::{Numbers, PICTURE_ENDINGS, decode, decode_file, decode_numbers, glance, list};
pub use frame::{Capture, Frame, Pixels, Reuse};
pub use pipe::PictureSize;
pub use rate::{Pacer, Rate};
#[cfg(test)]
pub(crate) use recording::tests::write_recording;
pub(crate) use recording::{RecordingSource, sorted};
pub(crate) use shm::camera_in;
pub(crate) use v4l2::cameras;

use std::io::Read;
use std::os::unix::fs::FileTypeExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use nunet_core::frame::PixelFormat;

use self::pipe::RawLayout;
use self::v4l2::Wish;
use crate::exit::BadArguments;

/// What happened when a source was asked for a frame.
#[derive(Debug)]
pub enum Fill {
    /// The frame is filled.
    Frame,
    /// There was a frame, but it is unreadable; the next one may be good.
    Failed(anyhow::Error),
    /// Nothing yet; ask again.
    Nothing,
    /// The source lends its memory and has no more to lend: give frames back first.
    Crowded,
    /// There will be no more frames.
    End,
    /// There will be no more frames, because the rest of the source is lost; those before were good.
    Cut(anyhow::Error),
    /// There will be no more frames, and that is a failure.
    Broken(anyhow::Error),
}

impl Fill {
    /// Whether there was a frame, readable or not: what a schedule of frames counts.
    pub(crate) fn had_frame(&self) -> bool {
        matches!(self, Self::Frame | Self::Failed(_))
    }
}

/// A source of frames. It runs on a thread of its own and is asked for one frame after the other.
pub trait Source: Send {
    /// Fills `frame` with the next picture, reusing its memory.
    ///
    /// Returns within a fraction of a second even when nothing comes, so that a stop is seen.
    fn fill(&mut self, frame: &mut Frame) -> Fill;

    /// Whether frames come by themselves (a camera). Of a live source the latest frame wins; of another one every
    /// frame is taken, unless a rate is asked for.
    fn is_live(&self) -> bool {
        false
    }

    /// Whether what gives the frames is away and waited for.
    fn is_waiting(&self) -> bool {
        false
    }
}

/// A source that could not be opened, among others that could: it fails when it is asked for its first frame.
struct Unopened(Option<anyhow::Error>);

impl Source for Unopened {
    fn fill(&mut self, _frame: &mut Frame) -> Fill {
        self.0.take().map_or(Fill::End, Fill::Broken)
    }
}

/// What `--source` names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Kind {
    /// The built-in ray-cast room.
    Demo,
    /// Pictures of a folder, or those that a glob matches.
    Files(String),
    /// Pictures on stdin.
    Pipe,
    /// A recording's pictures.
    Recording(PathBuf),
    /// A camera of this machine.
    Video(PathBuf),
    /// Another process publishes frames in shared memory under this camera's name.
    SharedMemory(String),
}

impl Kind {
    /// Tells the kinds apart by their spelling.
    pub fn parse(text: &str) -> Self {
        match text.split_once(':') {
            Some(("shm", camera)) => Self::SharedMemory(camera.to_owned()),
            None if text == "demo" => Self::Demo,
            None if text == "-" => Self::Pipe,
            _ if is_device(text) => Self::Video(text.into()),
            _ if text.ends_with(".mcap") => Self::Recording(text.into()),
            _ => Self::Files(text.to_owned()),
        }
    }

    /// The rate where the user gives none, as a flag says it; `None` where there is none to give.
    pub(crate) fn default_rate(&self) -> Option<String> {
        match self {
            Self::Demo | Self::Files(_) | Self::Pipe | Self::Recording(_) => Some("max".to_owned()),
            Self::Video(_) => Some(Wish::default().hz.to_string()),
            Self::SharedMemory(_) => None,
        }
    }

    /// The size that is wished of a camera where the user gives none, as a flag says it.
    pub(crate) fn default_size(&self) -> Option<String> {
        let (width, height) = Wish::default().size;
        matches!(self, Self::Video(_)).then(|| format!("{width}x{height}"))
    }

    /// The camera's name where the user gives none.
    pub fn default_camera(&self) -> &'static str {
        if *self == Self::Demo { "demo" } else { "camera" }
    }
}

/// Whether it is a camera, plugged in or not. The names below `/dev/v4l` stay the same when numbers change, and so do
/// those of the package's udev rule.
fn is_device(text: &str) -> bool {
    let named = ["/dev/video", "/dev/v4l/", "/dev/nunet/"].iter().any(|start| text.starts_with(start));
    named || Path::new(text).metadata().is_ok_and(|found| found.file_type().is_char_device())
}

/// How a source is opened.
#[derive(Debug, Clone, Copy, Default)]
pub struct Opening<'a> {
    /// Frames of files and recordings begin again at the end.
    pub repeat: bool,
    /// The recording's topic, where several carry pictures.
    pub topic: Option<&'a str>,
    /// Width and height of raw pictures on stdin, or those that are wished of a camera.
    pub size: Option<(u32, u32)>,
    /// What raw pictures on stdin are; Y4M otherwise.
    pub format: Option<PixelFormat>,
    /// The rate that is wished of a camera; of other sources their caller keeps it.
    pub rate: Option<Rate>,
    /// Set when the caller wants the source no longer: opening may take long.
    pub stopped: Option<&'a AtomicBool>,
}

impl Opening<'_> {
    fn wish(&self) -> Wish {
        let usual = Wish::default();
        let hz = self.rate.map_or(usual.hz, |rate| match rate {
            Rate::Max => rate::MAX_HZ,
            Rate::Hz(hz) => hz,
        });
        Wish { size: self.size.unwrap_or(usual.size), hz }
    }

    fn is_given_up(&self) -> bool {
        self.stopped.is_some_and(|stopped| stopped.load(Ordering::Relaxed))
    }

    fn layout(&self) -> Option<RawLayout> {
        self.size.zip(self.format).map(|(size, format)| RawLayout { size, format })
    }

    /// Arguments that the source would not obey are refused, not ignored.
    pub(crate) fn check(&self, kind: &Kind) -> Result<(), BadArguments> {
        let bad = |text: &str| Err(BadArguments(text.into()));
        if let (Some(topic), false) = (self.topic, matches!(kind, Kind::Recording(_))) {
            return bad(&format!("--topic {topic} is for recordings: no other source has topics"));
        }
        match (kind, self.size, self.format) {
            (Kind::Pipe, Some(_), None) => bad("--size without --format: raw pictures on stdin need both"),
            (Kind::Video(_), _, Some(_)) => bad(
                "--format is for raw pictures on stdin: of a camera, nunetd takes the format that fits best",
            ),
            (Kind::Pipe | Kind::Video(_), ..) | (_, None, None) => Ok(()),
            _ => bad(
                "--size is for cameras and raw pictures on stdin, --format for the latter: every other source says \
                 them itself",
            ),
        }?;
        match (self.repeat, kind) {
            (true, Kind::Pipe) => bad("--loop: stdin cannot begin again"),
            (true, Kind::Video(_)) => bad("--loop: a camera has no end to begin again at"),
            _ => Ok(()),
        }
    }
}

/// Opens a source.
///
/// # Errors
/// Nothing of that name, no pictures in a folder or a recording, a glob that is none, a camera that cannot be used,
/// arguments for another kind of source.
pub fn open(kind: &Kind, how: Opening<'_>) -> anyhow::Result<Box<dyn Source>> {
    how.check(kind)?;
    Ok(match kind {
        Kind::Pipe => open_pipe(std::io::stdin(), how)?,
        Kind::Demo => Box::new(scene::Scene::default()),
        Kind::Files(pattern) => Box::new(files::Files::open(pattern, how.repeat)?),
        Kind::Recording(path) => Box::new(recording::RecordingSource::open(path, how)?),
        Kind::Video(path) => Box::new(v4l2::open(path, how.wish())?),
        Kind::SharedMemory(camera) => Box::new(shm::SharedMemory::open(camera)?),
    })
}

/// What stands in for a source that could not be opened because of `error`, where others could. A camera may be plugged in
/// later and is waited for; files that are not there do not come by themselves.
pub(crate) fn in_place_of(kind: &Kind, how: Opening<'_>, error: anyhow::Error) -> Box<dyn Source> {
    match kind {
        Kind::Video(path) => Box::new(v4l2::wait_for(path, how.wish())),
        _ => Box::new(Unopened(Some(error))),
    }
}

/// A pipe other than stdin, of the layout that `how` says.
pub(crate) fn open_pipe(
    input: impl Read + Send + 'static,
    how: Opening<'_>,
) -> anyhow::Result<Box<dyn Source>> {
    Ok(Box::new(pipe::Pipe::open(input, how.layout())?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_is_told_by_its_spelling() {
        assert_eq!(Kind::parse("demo"), Kind::Demo);
        assert_eq!(Kind::parse("./demo"), Kind::Files("./demo".into()));
        assert_eq!(Kind::parse("shm:front"), Kind::SharedMemory("front".into()));
        assert_eq!(Kind::parse("-"), Kind::Pipe);
        assert_eq!(Kind::parse("drive.mcap"), Kind::Recording("drive.mcap".into()));
        assert_eq!(Kind::parse("drive/*.jpg"), Kind::Files("drive/*.jpg".into()));
    }

    #[test]
    fn cameras_are_told_by_their_place_or_by_being_devices() {
        for text in
            ["/dev/video7", "/dev/v4l/by-path/pci-0:1.0-video-index0", "/dev/nunet/ACME_42", "/dev/null"]
        {
            assert_eq!(Kind::parse(text), Kind::Video(text.into()), "{text}");
        }
        assert_eq!(Kind::parse("/dev"), Kind::Files("/dev".into()));
        assert_eq!(Kind::parse("video0"), Kind::Files("video0".into()));
    }

    #[test]
    fn arguments_of_another_kind_of_source_are_refused() {
        let size = Some((640, 480));
        let format = Some(PixelFormat::Yuyv);
        let refused = |source: &str, how: Opening<'_>| {
            let error = open(&Kind::parse(source), how).err().expect("it is refused");
            assert!(error.is::<BadArguments>(), "{error:#}");
            error.to_string()
        };
        let sized = Opening { size, ..Opening::default() };
        for source in ["demo", "drive.mcap", "shm:front", "drive/*.jpg"] {
            let error = refused(source, sized);
            assert!(error.starts_with("--size is for cameras and raw pictures on stdin"), "{error}");
        }
        assert!(refused("-", sized).starts_with("--size without --format"));
        let both = Opening { size, format, ..Opening::default() };
        assert!(refused("/dev/video0", both).starts_with("--format is for raw pictures"));
        let repeat = Opening { repeat: true, ..Opening::default() };
        assert!(refused("/dev/video0", repeat).contains("a camera has no end"));
        assert!(refused("-", repeat).contains("stdin cannot begin again"));
    }

    #[test]
    fn a_camera_that_is_not_there_is_waited_for_and_files_are_not() {
        let missing = |source: &str| {
            let kind = Kind::parse(source);
            let error = open(&kind, Opening::default()).err().expect("there is none");
            in_place_of(&kind, Opening::default(), error)
        };
        let mut camera = missing("/dev/video-of-nobody");
        assert!(camera.is_live());
        for _ in 0..2 {
            assert!(matches!(camera.fill(&mut Frame::default()), Fill::Nothing));
            assert!(camera.is_waiting());
        }
        let mut folder = missing("/nonexistent/pictures");
        assert!(matches!(folder.fill(&mut Frame::default()), Fill::Broken(_)));
    }

    #[test]
    fn size_and_rate_are_wishes_of_a_camera() {
        let usual = Opening::default().wish();
        assert_eq!((usual.size, usual.hz), ((640, 480), 30.0));
        let wished = Opening { size: Some((320, 240)), rate: Some(Rate::Hz(15.0)), ..Opening::default() };
        assert_eq!(wished.wish(), Wish { size: (320, 240), hz: 15.0 });
        let fastest = Opening { rate: Some(Rate::Max), ..Opening::default() };
        assert_eq!(fastest.wish().hz, rate::MAX_HZ, "of all rates the highest is the nearest");
    }

    #[test]
    fn the_demo_scene_has_a_camera_name_of_its_own() {
        assert_eq!(Kind::Demo.default_camera(), "demo");
        assert_eq!(Kind::parse("drive/").default_camera(), "camera");
    }
}
