//! The lost images of a damaged chunk. They are counted by the message index after the chunk and reported one
//! by one.

use std::path::{Path, PathBuf};

use crate::RecordingError;

/// The lost images of a damaged chunk.
#[derive(Debug, Default)]
pub(crate) struct Damage {
    path: PathBuf,
    reason: String,
    /// Lost images that were not reported yet.
    pending: u64,
    /// Whether no index has stated the number of images yet.
    is_uncounted: bool,
    /// An error that came before the lost images were reported.
    deferred: Option<RecordingError>,
}

impl Damage {
    /// A damaged chunk. Returns the lost image of one before it that had no index: it was one image at least.
    pub(crate) fn begin(&mut self, path: &Path, reason: &str) -> Option<RecordingError> {
        self.close();
        let before = self.report();
        let (path, reason) = (path.to_owned(), reason.to_owned());
        *self = Self { path, reason, is_uncounted: true, ..Self::default() };
        before
    }

    /// Adds the images in the index of one channel.
    pub(crate) fn count(&mut self, images: u64) {
        if !self.reason.is_empty() {
            self.pending = self.pending.saturating_add(images);
            self.is_uncounted = false;
        }
    }

    /// Ends the count at any other record. Without an index, at least one image was lost.
    pub(crate) fn close(&mut self) {
        if self.is_uncounted {
            (self.pending, self.is_uncounted) = (1, false);
        } else if self.pending == 0 {
            self.reason.clear();
        }
    }

    pub(crate) fn is_pending(&self) -> bool {
        self.pending > 0
    }

    /// Keeps an error until the lost images are reported.
    pub(crate) fn defer(&mut self, error: RecordingError) {
        self.deferred = Some(error);
    }

    pub(crate) fn take_deferred(&mut self) -> Option<RecordingError> {
        self.deferred.take()
    }

    /// The next lost image.
    pub(crate) fn report(&mut self) -> Option<RecordingError> {
        self.pending = self.pending.checked_sub(1)?;
        Some(RecordingError::DamagedChunk { path: self.path.clone(), reason: self.reason.clone() })
    }
}
