//! The recording of a running stream. Inference never waits for the disk.
//!
//! ```text
//! inference thread --copy of frame and results--> bounded queue --> recording thread: encodes, writes, syncs
//! ```
//!
//! A live frame that finds the queue full is dropped and counted. A source that is not live, such as a
//! folder, delivers the next frame only when there is room for it.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use nunet_telemetry::DrainTimeout;
use nunet_types::counted;
use tracing::{error, info, warn};

use crate::archive::{Archive, ArchiveWriter};
use crate::queue::{ClosedQueue, OnRoom, SinkQueue};
use crate::results::Results;
use crate::sink::{FinishingSink, Outcome, PublishedFrame, Sink, Wants};

/// Frames that wait for the disk: 6 MB each with a cloud.
const QUEUE_FRAMES: usize = 8;

/// The inference thread's end of a recording.
struct Recorder {
    queue: SinkQueue<ArchiveWriter>,
    path: PathBuf,
    durable: Arc<AtomicU64>,
    offered: u64,
    /// The source is not live and waits for room.
    source_waits: bool,
}

/// Starts a recording into `archive`.
///
/// # Errors
/// Its thread cannot be started.
pub fn record_into(archive: Box<dyn Archive>, on_room: OnRoom) -> anyhow::Result<Box<dyn Sink>> {
    let (path, durable) = (archive.path().to_owned(), Arc::default());
    let writer = ArchiveWriter::new(archive, Arc::clone(&durable));
    let queue = SinkQueue::start("recording", QUEUE_FRAMES, writer, on_room)?;
    Ok(Box::new(Recorder { queue, path, durable, offered: 0, source_waits: false }))
}

impl Sink for Recorder {
    fn wants(&self) -> Wants {
        Wants { labels: true, confidence: true, cloud: true, obstacles: true }
    }

    fn on_frame(&mut self, published: &PublishedFrame<'_>) {
        self.offered += 1;
        self.source_waits = !published.frame.in_real_time;
        self.queue.offer(|record| {
            record.copy_frame(published.frame, published.camera);
            record.copy_results(&published.results);
        });
    }

    fn has_room(&mut self) -> bool {
        if let Some(stalled) = self.queue.stall_warning() {
            warn!(
                "the recording `{}` stalls: its disk wrote nothing for {} s, with {} waiting; check whether the disk or \
                 mount responds",
                self.path.display(),
                stalled.as_secs(),
                counted(self.queue.waiting(), "frame")
            );
        }
        !self.source_waits || self.queue.has_room()
    }

    fn finish(self: Box<Self>, _last: Option<&Results<'_>>) -> FinishingSink {
        let Self { queue, path, durable, offered, source_waits: _ } = *self;
        let ending = Ending { queue: queue.close(), path, durable, offered };
        FinishingSink::new(move |timeout| Ok(ending.wait(timeout).log()))
    }
}

/// A finished recording.
struct Ending {
    queue: ClosedQueue<ArchiveWriter>,
    path: PathBuf,
    durable: Arc<AtomicU64>,
    offered: u64,
}

/// The outcome of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Tally {
    recorded: u64,
    dropped: u64,
    /// The file has its end, and everything that was written is in it.
    complete: bool,
}

impl Ending {
    /// Waits for the end of the file, within `timeout`. If the disk takes longer, it is abandoned, and frames
    /// that are not known to be durable count as dropped.
    fn wait(self, timeout: &mut DrainTimeout<'_>) -> Tally {
        let Self { queue, path, durable, offered } = self;
        let what = format!("the recording `{}`", path.display());
        let dropped = queue.dropped;
        match queue.wait(&what, timeout) {
            Ok(Some(writer)) => Tally {
                recorded: writer.recorded(),
                dropped: dropped + writer.lost(),
                complete: writer.is_complete(),
            },
            unfinished => {
                if let Err(reason) = unfinished {
                    warn!(
                        "{what} has no end: {reason}; check whether its disk or mount responds. Readers that accept such \
                         files see the frames that were on the disk before"
                    );
                }
                let recorded = durable.load(Ordering::Relaxed);
                Tally { recorded, dropped: offered.saturating_sub(recorded), complete: false }
            }
        }
    }
}

impl Tally {
    /// Logs how the recording ended. An incomplete recording is a loss.
    fn log(self) -> Outcome {
        let Self { recorded, dropped, complete } = self;
        info!("recording: {}", counted(recorded, "frame"));
        if dropped > 0 {
            error!("{} not in the recording: the disk did not keep up or failed", counted(dropped, "frame"));
        }
        if dropped == 0 && complete { Outcome::Done } else { Outcome::Lost }
    }
}
