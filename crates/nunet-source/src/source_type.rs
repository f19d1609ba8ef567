//! Properties of a kind of source.

use std::path::{Path, PathBuf};

use crate::error::SourceError;
use crate::{Fill, Frame, OpenOptions, Source};

/// A kind of source: its names, its options, and how it is opened.
pub trait SourceType: Sync {
    /// Whether `name` is a source of this kind.
    fn is_named(&self, name: &str) -> bool;

    /// The properties of this kind.
    fn properties(&self) -> Properties;

    /// Opens a source.
    ///
    /// # Errors
    /// Nothing of that name, or nothing that can be read.
    fn open(&self, name: &str, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError>;

    /// Checks a name as far as that is possible without opening anything.
    ///
    /// # Errors
    /// Nothing can have it.
    fn check(&self, name: &str) -> Result<(), SourceError> {
        let _ = name;
        Ok(())
    }

    /// The existing files and folders that are read; none if the source is not a file.
    fn files(&self, name: &str) -> Vec<PathBuf> {
        let _ = name;
        Vec::new()
    }

    /// Whether a file at `path`, an absolute path, would be a part of the source once it is written.
    fn would_read(&self, name: &str, path: &Path) -> bool {
        let _ = (name, path);
        false
    }

    /// The placeholder for a source that cannot be opened because of `error`, if others can. It fails
    /// at its first frame. For a camera, the placeholder waits until it is plugged in.
    fn stand_in(&self, name: &str, options: OpenOptions<'_>, error: SourceError) -> Box<dyn Source> {
        let _ = (name, options);
        Box::new(Unopened(Some(error)))
    }
}

/// The properties of a kind of source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct Properties {
    /// A resource that only one camera of a process can use.
    pub exclusive: Option<Exclusive>,
    /// Why neither a rate nor a loop can be chosen, if another process publishes the frames at its own pace.
    pub own_pace: Option<&'static str>,
    /// Whether reading starts a program: a mere check must not.
    pub is_started: bool,
    /// Whether opening it connects to a network: a mere check must not.
    pub is_on_network: bool,
    /// Whether its frames are in shared memory already, where `feed` would publish them.
    pub is_published: bool,
    /// Whether its images state their coordinate frame. Their publisher also publishes the transform of that
    /// frame.
    pub states_frame_id: bool,
    /// Whether it can contain the attitude of the robot.
    pub has_attitude: bool,
    /// Whether it has topics to choose from.
    pub has_topics: bool,
    /// The use of a size and a format.
    pub size: SizeUse,
    /// Whether exposure and gain can be set.
    pub has_settings: bool,
    /// Why it cannot be repeated; `None` if it can.
    pub no_repeat: Option<&'static str>,
    /// The usual name of the camera.
    pub camera: &'static str,
    /// The usual size, as a user writes it.
    pub default_size: Option<&'static str>,
    /// The usual rate, as a user writes it.
    pub default_rate: Option<&'static str>,
}

impl Properties {
    /// Whether frames come by themselves, so that the first one may be long in coming.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.exclusive.is_some() || self.own_pace.is_some() || self.is_started
    }
}

/// A resource that two cameras of one process cannot share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exclusive {
    /// Standard input.
    StandardInput,
    /// A device, by its path.
    Device,
}

/// The use of a size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SizeUse {
    /// None: the source states its size.
    #[default]
    None,
    /// It describes raw images, together with a format.
    Raw,
    /// It is requested.
    Requested,
}

/// A source that could not be opened.
struct Unopened(Option<SourceError>);

impl Source for Unopened {
    fn fill(&mut self, _frame: &mut Frame) -> Fill {
        self.0.take().map_or(Fill::End, Fill::Broken)
    }
}
