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

pub(crate) use files::{Numbers, decode, decode_file, decode_numbers};
pub use frame::{Capture, Frame, Pixels, Reuse};
pub use pipe::{PictureSize, RawLayout};
pub use rate::{Pacer, Rate};
pub(crate) use recording::{RecordingSource, sorted};

use std::path::PathBuf;

use anyhow::bail;

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
            _ if text.ends_with(".mcap") => Self::Recording(text.into()),
            _ => Self::Files(text.to_owned()),
        }
    }

    /// The camera's name where the user gives none.
    pub fn default_camera(&self) -> &'static str {
        if *self == Self::Demo { "demo" } else { "camera" }
    }
}

/// How a source is opened.
#[derive(Debug, Clone, Copy, Default)]
pub struct Opening<'a> {
    /// Frames of files and recordings begin again at the end.
    pub repeat: bool,
    /// The recording's topic, where several carry pictures.
    pub topic: Option<&'a str>,
    /// What pictures on stdin are; Y4M otherwise.
    pub layout: Option<RawLayout>,
}

/// Opens a source.
///
/// # Errors
/// Nothing of that name, no pictures in a folder or a recording, a glob that is none, a topic for what has none.
pub fn open(kind: &Kind, how: Opening<'_>) -> anyhow::Result<Box<dyn Source>> {
    if let (Some(topic), false) = (how.topic, matches!(kind, Kind::Recording(_))) {
        bail!(BadArguments(format!("--topic {topic} is for recordings: no other source has topics")));
    }
    if how.layout.is_some() && *kind != Kind::Pipe {
        bail!(BadArguments(
            "--size and --format are for raw pictures on stdin: every other source says them itself".into()
        ));
    }
    if how.repeat && *kind == Kind::Pipe {
        bail!(BadArguments("--loop: stdin cannot begin again".into()));
    }
    Ok(match kind {
        Kind::Pipe => Box::new(pipe::Pipe::open(std::io::stdin(), how.layout)?),
        Kind::Demo => Box::new(scene::Scene::default()),
        Kind::Files(pattern) => Box::new(files::Files::open(pattern, how.repeat)?),
        Kind::Recording(path) => Box::new(recording::RecordingSource::open(path, how)?),
        Kind::SharedMemory(camera) => Box::new(shm::SharedMemory::open(camera)?),
    })
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
    fn the_demo_scene_has_a_camera_name_of_its_own() {
        assert_eq!(Kind::Demo.default_camera(), "demo");
        assert_eq!(Kind::parse("drive/").default_camera(), "camera");
    }
}
