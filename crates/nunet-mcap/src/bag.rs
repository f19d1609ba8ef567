//! The readable parts of a recording, and the missing ones.

use std::path::{Path, PathBuf};

use crate::channels::Channels;
use crate::{RecordingError, parts};

/// A recording of one file or several.
#[derive(Debug)]
pub(crate) struct Bag {
    /// At least one, in the order in which they were recorded.
    pub(crate) parts: Vec<RecordingPart>,
    /// Errors of parts that are missing or cannot be read.
    pub(crate) missing: Vec<RecordingError>,
}

/// A file of a recording.
#[derive(Debug)]
pub(crate) struct RecordingPart {
    pub(crate) path: PathBuf,
    pub(crate) channels: Channels,
}

impl Bag {
    /// Finds the parts and their channels. `given_up` is called at each record that is read.
    pub(crate) fn open(path: &Path, given_up: &dyn Fn() -> bool) -> Result<Self, RecordingError> {
        let files = parts::parts(path)?;
        let (mut parts, mut missing) = (Vec::new(), Vec::new());
        for path in &files {
            match Channels::of_file(path, given_up) {
                Ok(channels) => parts.push(RecordingPart { path: path.clone(), channels }),
                Err(error @ RecordingError::GivenUp { .. }) => return Err(error),
                Err(error) => missing.push(error),
            }
        }
        if parts.is_empty() && !missing.is_empty() {
            return Err(missing.swap_remove(0));
        }
        missing.extend(parts::gaps(&files));
        // Tools that merge bags may list the parts in another order.
        if parts.iter().all(|part| part.channels.start_nanos().is_some()) {
            parts.sort_by_key(|part| part.channels.start_nanos());
        }
        Ok(Self { parts, missing })
    }
}
