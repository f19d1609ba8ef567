//! Recording beside a running stream: whatever the disk does, inference does not wait for it.
//!
//! ```text
//! worker ──frame──> listener: joins it with its results in shared memory ──record──> disk: encodes, writes, syncs
//! ```
//!
//! Both queues are bounded. A live frame that finds one full is left out of the recording and counted. A source that waits
//! is not asked for its next frame before there is room for it, while other cameras go on: nobody blocks on a queue.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, channel, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use nunet_core::camera::Camera;
use nunet_ipc::{CameraName, FrameSet, Reader, Topic};
use tracing::{error, info, warn};

use super::disk::{Disk, Progress, Watch};
use super::{Archive, Record};
use crate::sink::patience::Patience;
use crate::sink::shm::Outlet;
use crate::source::Frame;

/// Frames on their way to the listener, which needs a millisecond for each.
const OFFERED: usize = 2;
/// Records that wait for the disk: with clouds 6 MB each.
const WAITING: usize = 8;
/// The services are ours and exist: no waiting.
const NO_WAIT: Duration = Duration::ZERO;

/// The worker's end of a recording.
pub(crate) struct Recorder {
    frames: SyncSender<Offer>,
    room: Arc<Room>,
    listener: JoinHandle<u64>,
    disk: JoinHandle<Disk>,
    path: PathBuf,
    progress: Arc<Progress>,
    watch: Watch,
    offered: u64,
    refused: u64,
}

/// A frame whose results have just been published.
struct Offer {
    frame: Frame,
    camera: Option<Camera>,
}

/// Whether a frame may be left out: not of a source that waits, since it will not send another instead.
pub(super) fn waits(frame: &Frame) -> bool {
    !frame.in_real_time
}

/// Where the frames of a source that waits are. Those of a live one are not counted: for them there is always room, or
/// they are left out.
pub(super) struct Room {
    /// One was offered and is not joined with its results yet, which the next frame would overwrite.
    joining: AtomicBool,
    /// Offered, and not written yet.
    under_way: AtomicUsize,
    /// Called when there may be room again.
    changed: Box<dyn Fn() + Send + Sync>,
}

impl Room {
    pub(super) fn new(changed: impl Fn() + Send + Sync + 'static) -> Self {
        Self { joining: false.into(), under_way: 0.into(), changed: Box::new(changed) }
    }

    fn is_free(&self) -> bool {
        !self.joining.load(Ordering::Acquire) && self.under_way.load(Ordering::Acquire) < WAITING
    }

    fn enter(&self) {
        self.joining.store(true, Ordering::Release);
        self.under_way.fetch_add(1, Ordering::AcqRel);
    }

    fn joined(&self) {
        self.joining.store(false, Ordering::Release);
        (self.changed)();
    }

    pub(super) fn leave(&self) {
        self.under_way.fetch_sub(1, Ordering::AcqRel);
        (self.changed)();
    }
}

/// What became of the frames of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Tally {
    pub(crate) recorded: u64,
    pub(crate) left_out: u64,
    /// The file has its end, and everything that was written is in it.
    pub(crate) whole: bool,
}

impl Recorder {
    /// Attaches to everything that `outlet` publishes of a frame. `changed` is called when there may be room again.
    pub(crate) fn start(
        archive: impl Archive,
        camera: &CameraName,
        outlet: &Outlet,
        changed: impl Fn() + Send + Sync + 'static,
    ) -> anyhow::Result<Self> {
        let topics: Vec<_> = outlet.topics().iter().copied().filter(|&topic| topic != Topic::Stats).collect();
        let reader = Reader::open(camera, &topics, NO_WAIT)?;
        let (frames, offered) = sync_channel(OFFERED);
        let (records, waiting) = sync_channel(WAITING);
        let (used, shelf) = channel();
        let (room, progress) = (Arc::new(Room::new(changed)), Arc::new(Progress::default()));
        let path = archive.path().to_owned();
        let disk = Disk::new(Box::new(archive), Arc::clone(&room), Arc::clone(&progress));
        let listener = Listener {
            reader,
            records,
            shelf,
            room: Arc::clone(&room),
            progress: Arc::clone(&progress),
            newer: None,
            left_out: 0,
        };
        let named = |name: &str| std::thread::Builder::new().name(name.into());
        let listener = named("listener").spawn(move || listener.run(&offered));
        let disk = named("disk").spawn(move || disk.run(&waiting, &used));
        let context = "cannot start the recording's threads";
        Ok(Self {
            frames,
            room,
            listener: listener.context(context)?,
            disk: disk.context(context)?,
            path,
            progress,
            watch: Watch::new(Instant::now()),
            offered: 0,
            refused: 0,
        })
    }

    /// Tells the user once of a disk that stands still: otherwise frames would be left out, or not be asked for, in silence.
    pub(crate) fn look_after_the_disk(&mut self) {
        if let Some(still) = self.watch.news(&self.progress, Instant::now()) {
            warn!(
                "the recording `{}` stands still: its disk has taken nothing for {} s, and {} frames wait\nhint: see \
                 whether the disk or mount of the file answers",
                self.path.display(),
                still.as_secs(),
                self.progress.records_waiting()
            );
        }
    }

    /// Whether the next frame may be taken on; always of a live source. Nobody waits for threads that are gone: what they
    /// do not take is counted.
    pub(crate) fn has_room(&self) -> bool {
        self.room.is_free() || self.listener.is_finished() || self.disk.is_finished()
    }

    /// Hands over a frame whose results have just been published; never waits. It comes back when there is no room for
    /// it.
    pub(crate) fn offer(&mut self, frame: Frame, camera: Option<Camera>) -> Option<Frame> {
        self.offered += 1;
        if waits(&frame) {
            self.room.enter();
        }
        match self.frames.try_send(Offer { frame, camera }) {
            Ok(()) => None,
            Err(TrySendError::Full(offer) | TrySendError::Disconnected(offer)) => {
                self.refused += 1;
                Some(offer.frame)
            }
        }
    }

    /// No more frames. Those that were offered are joined with their results before this returns, so that shared memory
    /// may go; they are written, and the file is ended, meanwhile.
    pub(crate) fn end(self) -> Ending {
        let Self { frames, listener, disk, path, progress, offered, refused, .. } = self;
        drop(frames);
        Ending { missed: listener.join(), disk, path, progress, offered, refused }
    }
}

/// A recording to which nothing is added any more.
pub(crate) struct Ending {
    missed: std::thread::Result<u64>,
    disk: JoinHandle<Disk>,
    path: PathBuf,
    progress: Arc<Progress>,
    offered: u64,
    refused: u64,
}

impl Ending {
    /// Waits for the end of the file, within `patience`. A disk that does not come to it is left alone, and what is not
    /// known to be on it is left out.
    pub(crate) fn tally(self, patience: &mut Patience<'_>) -> Tally {
        let Self { missed, disk, path, progress, offered, refused } = self;
        let what = format!("the recording `{}`", path.display());
        let joined = match patience.wait(&what, || disk.is_finished(), || progress.records_taken()) {
            Ok(()) => disk.join().ok(),
            Err(why) => {
                warn!(
                    "{what} is left without its end: {why}\nhint: see whether its disk or mount answers; readers that take \
                     such files see what was on the disk before"
                );
                None
            }
        };
        match (missed, joined) {
            (Ok(missed), Some(disk)) => Tally {
                recorded: disk.recorded,
                left_out: refused + missed + disk.lost,
                whole: disk.is_whole(),
            },
            _ => {
                let recorded = progress.frames_on_disk();
                Tally { recorded, left_out: offered.saturating_sub(recorded), whole: false }
            }
        }
    }
}

impl Tally {
    /// Says how the recording ended; whether nothing is missing.
    pub(crate) fn say(self) -> bool {
        let Self { recorded, left_out, whole } = self;
        info!("recording: {recorded} frames");
        if left_out > 0 {
            error!(
                "{left_out} frames are not in the recording: it did not keep up, or the disk refused them"
            );
        }
        left_out == 0 && whole
    }
}

/// Joins frames with their results.
struct Listener {
    reader: Reader,
    records: SyncSender<Record>,
    shelf: Receiver<Record>,
    room: Arc<Room>,
    progress: Arc<Progress>,
    /// Results that came before their frame.
    newer: Option<FrameSet>,
    left_out: u64,
}

impl Listener {
    fn run(mut self, offered: &Receiver<Offer>) -> u64 {
        while let Ok(offer) = offered.recv() {
            let waits = waits(&offer.frame);
            let passed = self.pass_on(offer);
            if !passed {
                self.left_out += 1;
            }
            if waits {
                if !passed {
                    self.room.leave();
                }
                self.room.joined();
            }
        }
        self.left_out
    }

    /// Whether the frame is on its way to the disk.
    fn pass_on(&mut self, Offer { frame, camera }: Offer) -> bool {
        let Some(set) = self.results_of((frame.sequence, frame.capture.nanos)) else { return false };
        let mut record = self.shelf.try_recv().unwrap_or_default();
        record.take(frame, camera);
        record.copy_set(&set);
        // Of a source that waits there are never more records than the queue takes.
        let passed = self.records.try_send(record).is_ok();
        if passed {
            self.progress.give();
        }
        passed
    }

    /// The results of a frame, by their key; `None` when newer ones have taken their place already.
    fn results_of(&mut self, wanted: (u64, i64)) -> Option<FrameSet> {
        let of = |set: &FrameSet| Some(set.get(Topic::Depth)?.header().key());
        let mut set = self.newer.take();
        while set.as_ref().and_then(of) != Some(wanted) {
            match self.reader.next_set().ok().flatten() {
                Some(fresh) => set = Some(fresh),
                None => {
                    self.newer = set;
                    return None;
                }
            }
        }
        set
    }
}
