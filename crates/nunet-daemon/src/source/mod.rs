//! Where frames come from. One file a kind of source; a new one implements [`Source`] and is named in
//! [`Kind::parse`] and [`open`].

pub mod demo;
mod files;
mod frame;
mod rate;
mod scene;
mod shm;

pub(crate) use files::{Numbers, decode, decode_numbers};
pub use frame::{Capture, Frame, Pixels, Reuse};
pub use rate::{Pacer, Rate};

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
    /// Another process publishes frames in shared memory under this camera's name.
    SharedMemory(String),
}

impl Kind {
    /// Tells the kinds apart by their spelling.
    pub fn parse(text: &str) -> Self {
        match text.split_once(':') {
            Some(("shm", camera)) => Self::SharedMemory(camera.to_owned()),
            None if text == "demo" => Self::Demo,
            _ => Self::Files(text.to_owned()),
        }
    }

    /// The camera's name where the user gives none.
    pub fn default_camera(&self) -> &'static str {
        if *self == Self::Demo { "demo" } else { "camera" }
    }
}

/// Opens a source. Frames of files and of the demo scene repeat where `repeat` says so.
///
/// # Errors
/// Nothing of that name, no pictures in a folder, a glob that is none.
pub fn open(kind: &Kind, repeat: bool) -> anyhow::Result<Box<dyn Source>> {
    Ok(match kind {
        Kind::Demo => Box::new(scene::Scene::default()),
        Kind::Files(pattern) => Box::new(files::Files::open(pattern, repeat)?),
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
        assert_eq!(Kind::parse("drive/*.jpg"), Kind::Files("drive/*.jpg".into()));
    }

    #[test]
    fn the_demo_scene_has_a_camera_name_of_its_own() {
        assert_eq!(Kind::Demo.default_camera(), "demo");
        assert_eq!(Kind::parse("drive/").default_camera(), "camera");
    }
}
