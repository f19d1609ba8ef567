//! The parts of a recording that can be read, and what is missing.

use std::path::{Path, PathBuf};

use crate::channels::Channels;
use crate::{RecordingError, parts};

/// A recording of one file or several.
#[derive(Debug)]
pub(crate) struct Bag {
    /// At least one, in the order in which they were recorded.
    pub(crate) parts: Vec<RecordingFile>,
    /// Parts that are missing or cannot be read, while others can.
    pub(crate) missing: Vec<RecordingError>,
}

/// A file of a recording.
#[derive(Debug)]
pub(crate) struct RecordingFile {
    pub(crate) path: PathBuf,
    pub(crate) channels: Channels,
}

impl Bag {
    /// Finds the parts and their channels. `given_up` is asked at each record that has to be read for it.
    pub(crate) fn open(path: &Path, given_up: &dyn Fn() -> bool) -> Result<Self, RecordingError> {
        let files = parts::parts(path)?;
        let (mut parts, mut missing) = (Vec::new(), Vec::new());
        for path in &files {
            match Channels::of_file(path, given_up) {
                Ok(channels) => parts.push(RecordingFile { path: path.clone(), channels }),
                Err(error @ RecordingError::GivenUp { .. }) => return Err(error),
                Err(error) => missing.push(error),
            }
        }
        if parts.is_empty() && !missing.is_empty() {
            return Err(missing.swap_remove(0));
        }
        missing.extend(parts::gaps(&files));
        // A list in another order, as tools that merge bags write it.
        if parts.iter().all(|part| part.channels.start_nanos().is_some()) {
            parts.sort_by_key(|part| part.channels.start_nanos());
        }
        Ok(Self { parts, missing })
    }
}
