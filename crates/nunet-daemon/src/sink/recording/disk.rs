//! The thread that writes a recording, and what others see of it: it alone waits for the disk.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use tracing::error;

use super::recorder::{Room, waits};
use super::{Archive, Record};

/// The most that is lost when the process or the machine dies.
const SYNC_PERIOD: Duration = Duration::from_secs(1);
/// A disk that takes nothing for so long while records wait is told of: one that is only slow takes some.
const STANDSTILL: Duration = Duration::from_secs(5);

/// How far the disk is, also while it hangs.
#[derive(Debug, Default)]
pub(super) struct Progress {
    given: AtomicU64,
    taken: AtomicU64,
    safe: AtomicU64,
}

impl Progress {
    /// A record is on its way to the disk.
    pub(super) fn give(&self) {
        self.given.fetch_add(1, Ordering::Relaxed);
    }

    /// The disk has dealt with a record, in one way or the other.
    fn taken(&self) {
        self.taken.fetch_add(1, Ordering::Relaxed);
    }

    /// So many frames outlive the process and the machine.
    fn safe(&self, frames: u64) {
        self.safe.store(frames, Ordering::Relaxed);
    }

    /// Frames that are on the disk, whatever becomes of it.
    pub(super) fn frames_on_disk(&self) -> u64 {
        self.safe.load(Ordering::Relaxed)
    }

    /// Records that the disk has dealt with.
    pub(super) fn records_taken(&self) -> u64 {
        self.taken.load(Ordering::Relaxed)
    }

    /// Records that wait for the disk, with the one in work.
    pub(super) fn records_waiting(&self) -> u64 {
        // What is counted as given after it was taken is not below zero.
        self.given.load(Ordering::Relaxed).saturating_sub(self.records_taken())
    }
}

/// Notices a disk that stands still.
#[derive(Debug)]
pub(super) struct Watch {
    taken: u64,
    since: Instant,
    told: bool,
}

impl Watch {
    pub(super) fn new(now: Instant) -> Self {
        Self { taken: 0, since: now, told: false }
    }

    /// For how long nothing was taken, where that is news: once a standstill.
    pub(super) fn news(&mut self, progress: &Progress, now: Instant) -> Option<Duration> {
        let taken = progress.records_taken();
        if taken != self.taken || progress.records_waiting() == 0 {
            *self = Self { taken, since: now, told: false };
        }
        let still = now.duration_since(self.since);
        let news = !self.told && still >= STANDSTILL;
        self.told |= news;
        news.then_some(still)
    }
}

/// The file's thread.
pub(super) struct Disk {
    /// `None` after the first failure, and after the file's end.
    archive: Option<Box<dyn Archive>>,
    room: Arc<Room>,
    progress: Arc<Progress>,
    pub(super) recorded: u64,
    pub(super) lost: u64,
    failed: bool,
    synced: Instant,
    since_sync: u64,
}

impl Disk {
    pub(super) fn new(archive: Box<dyn Archive>, room: Arc<Room>, progress: Arc<Progress>) -> Self {
        Self {
            archive: Some(archive),
            room,
            progress,
            recorded: 0,
            lost: 0,
            failed: false,
            synced: Instant::now(),
            since_sync: 0,
        }
    }

    pub(super) fn run(mut self, waiting: &Receiver<Record>, used: &Sender<Record>) -> Self {
        loop {
            let patience = SYNC_PERIOD.saturating_sub(self.synced.elapsed());
            match waiting.recv_timeout(patience) {
                Ok(record) => {
                    self.write(&record);
                    self.progress.taken();
                    if waits(&record.frame) {
                        self.room.leave();
                    }
                    // Nobody takes it back at the end.
                    let _ = used.send(record);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if self.synced.elapsed() >= SYNC_PERIOD {
                self.sync();
            }
        }
        if let Some(archive) = self.archive.take()
            && self.judge(archive.finish())
        {
            self.progress.safe(self.recorded);
        }
        self
    }

    /// Whether the file has its end, and everything that was written is in it.
    pub(super) fn is_whole(&self) -> bool {
        self.archive.is_none() && !self.failed
    }

    fn write(&mut self, record: &Record) {
        let Some(archive) = &mut self.archive else {
            self.lost += 1;
            return;
        };
        let written = archive.write(record);
        if self.judge(written) {
            self.recorded += 1;
            self.since_sync += 1;
        } else {
            self.lost += 1;
        }
    }

    fn sync(&mut self) {
        self.synced = Instant::now();
        if self.since_sync == 0 {
            return;
        }
        let synced = self.archive.as_mut().map_or(Ok(()), |archive| archive.sync());
        if self.judge(synced) {
            self.since_sync = 0;
            self.progress.safe(self.recorded);
        }
    }

    /// The first failure is told and ends the recording; the stream goes on. What came after the last sync is lost.
    fn judge(&mut self, done: anyhow::Result<()>) -> bool {
        let Err(failure) = done else { return true };
        error!("the recording ends here: {failure:#}");
        self.failed = true;
        self.recorded -= self.since_sync;
        self.lost += self.since_sync;
        self.since_sync = 0;
        self.archive = None;
        false
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// Takes everything, or nothing from now on.
    struct Paper {
        good: bool,
    }

    impl Archive for Paper {
        fn path(&self) -> &Path {
            Path::new("paper")
        }

        fn write(&mut self, _record: &Record) -> anyhow::Result<()> {
            Ok(())
        }

        fn sync(&mut self) -> anyhow::Result<()> {
            anyhow::ensure!(std::mem::replace(&mut self.good, false), "the paper is full");
            Ok(())
        }

        fn finish(self: Box<Self>) -> anyhow::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn frames_are_on_the_disk_when_they_were_synced_and_not_before() {
        let progress = Arc::new(Progress::default());
        let room = Arc::new(Room::new(|| {}));
        let mut disk = Disk::new(Box::new(Paper { good: true }), room, Arc::clone(&progress));
        let mut seen = Vec::new();
        for _ in 0..2 {
            disk.write(&Record::default());
            disk.write(&Record::default());
            seen.push(progress.frames_on_disk());
            disk.sync();
            seen.push(progress.frames_on_disk());
        }
        assert_eq!(seen, [0, 2, 2, 2], "the second sync failed");
        assert_eq!((disk.recorded, disk.lost), (2, 2));
    }

    #[test]
    fn a_disk_that_stands_still_is_news_once_and_again_when_it_has_moved() {
        let (progress, start) = (Progress::default(), Instant::now());
        let at = |seconds: u64| start + Duration::from_secs(seconds);
        let mut watch = Watch::new(start);
        assert_eq!(watch.news(&progress, at(100)), None, "nothing waits for it");
        progress.give();
        progress.give();
        assert_eq!(watch.news(&progress, at(104)), None);
        assert_eq!(watch.news(&progress, at(106)), Some(Duration::from_secs(6)));
        assert_eq!(watch.news(&progress, at(120)), None, "it was told");
        progress.taken();
        assert_eq!(watch.news(&progress, at(121)), None, "it moves");
        assert_eq!(watch.news(&progress, at(127)), Some(Duration::from_secs(6)));
    }
}
