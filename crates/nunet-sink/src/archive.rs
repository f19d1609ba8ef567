//! The recording's thread, the only one that waits for the disk.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tracing::error;

use crate::queue::Writer;
use crate::record::RecordedFrame;

/// At most this much of a recording is lost if the process or the machine dies.
const SYNC_PERIOD: Duration = Duration::from_secs(1);

/// What a recorder writes to.
pub trait Archive: Send + 'static {
    /// The path of the file.
    fn path(&self) -> &Path;

    /// Adds a frame.
    ///
    /// # Errors
    /// It could not be written.
    fn write(&mut self, record: &RecordedFrame) -> anyhow::Result<()>;

    /// Makes everything written so far durable.
    ///
    /// # Errors
    /// The disk did not confirm it.
    fn sync(&mut self) -> anyhow::Result<()>;

    /// Writes the end of the file.
    ///
    /// # Errors
    /// The end could not be written.
    fn finish(self: Box<Self>) -> anyhow::Result<()>;
}

/// Writes frames into an archive and makes them durable once per second.
pub struct ArchiveWriter {
    /// `None` after the first failure, and after the end of the file.
    archive: Option<Box<dyn Archive>>,
    recorded: u64,
    lost: u64,
    failed: bool,
    synced: Instant,
    since_sync: u64,
    /// The number of durable frames. Other threads can read it even while the disk hangs.
    durable: Arc<AtomicU64>,
}

impl ArchiveWriter {
    /// Writes into `archive`, and keeps the number of durable frames in `durable`.
    #[must_use]
    pub fn new(archive: Box<dyn Archive>, durable: Arc<AtomicU64>) -> Self {
        Self {
            archive: Some(archive),
            recorded: 0,
            lost: 0,
            failed: false,
            synced: Instant::now(),
            since_sync: 0,
            durable,
        }
    }

    /// Frames in the archive.
    #[must_use]
    pub fn recorded(&self) -> u64 {
        self.recorded
    }

    /// Frames that were offered and are not in the archive.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Whether the file is complete: it has its end, and nothing that was written is missing.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.archive.is_none() && !self.failed
    }

    fn sync(&mut self) {
        self.synced = Instant::now();
        if self.since_sync == 0 {
            return;
        }
        let synced = self.archive.as_mut().map_or(Ok(()), |archive| archive.sync());
        if self.succeeded(synced) {
            self.since_sync = 0;
            self.durable.store(self.recorded, Ordering::Relaxed);
        }
    }

    /// Logs the first failure and ends the recording; the stream continues. Frames after the last sync are
    /// lost.
    fn succeeded(&mut self, result: anyhow::Result<()>) -> bool {
        let Err(failure) = result else { return true };
        error!("the recording ends here: {failure:#}");
        self.failed = true;
        self.recorded -= self.since_sync;
        self.lost += self.since_sync;
        self.since_sync = 0;
        self.archive = None;
        false
    }
}

impl Writer for ArchiveWriter {
    type Item = RecordedFrame;

    fn write(&mut self, record: &RecordedFrame) {
        let Some(archive) = &mut self.archive else {
            self.lost += 1;
            return;
        };
        let written = archive.write(record);
        if self.succeeded(written) {
            self.recorded += 1;
            self.since_sync += 1;
        } else {
            self.lost += 1;
        }
    }

    fn flush_if_due(&mut self) {
        if self.synced.elapsed() >= SYNC_PERIOD {
            self.sync();
        }
    }

    fn finish(&mut self) {
        if let Some(archive) = self.archive.take()
            && self.succeeded(archive.finish())
        {
            self.durable.store(self.recorded, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Accepts everything; only the first sync succeeds.
    struct OneSync {
        used: bool,
    }

    impl Archive for OneSync {
        fn path(&self) -> &Path {
            Path::new("archive of a test")
        }

        fn write(&mut self, _record: &RecordedFrame) -> anyhow::Result<()> {
            Ok(())
        }

        fn sync(&mut self) -> anyhow::Result<()> {
            anyhow::ensure!(!std::mem::replace(&mut self.used, true), "the disk is full");
            Ok(())
        }

        fn finish(self: Box<Self>) -> anyhow::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn frames_are_durable_after_a_sync_and_not_before() {
        let durable = Arc::default();
        let mut writer = ArchiveWriter::new(Box::new(OneSync { used: false }), Arc::clone(&durable));
        let mut seen = Vec::new();
        for _ in 0..2 {
            writer.write(&RecordedFrame::default());
            writer.write(&RecordedFrame::default());
            seen.push(durable.load(Ordering::Relaxed));
            writer.sync();
            seen.push(durable.load(Ordering::Relaxed));
        }
        assert_eq!(seen, [0, 2, 2, 2], "the second sync failed");
        assert_eq!((writer.recorded, writer.lost), (2, 2));
        assert!(!writer.is_complete());
    }
}
