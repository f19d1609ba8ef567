//! Recording beside a running stream: whatever the disk does, inference does not wait for it.
//!
//! ```text
//! worker ──frame──> listener: joins it with its results in shared memory ──record──> disk: encodes, writes, syncs
//! ```
//!
//! Both queues are bounded. A live frame that finds one full is left out of the recording and counted. A source that waits
//! is not asked for its next frame before there is room for it, while other cameras go on: nobody blocks on a queue.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use nunet_core::camera::Camera;
use nunet_ipc::{CameraName, FrameSet, Reader, Topic};
use tracing::{error, info};

use super::{Archive, Record};
use crate::sink::shm::Outlet;
use crate::source::Frame;

/// Frames on their way to the listener, which needs a millisecond for each.
const OFFERED: usize = 2;
/// Records that wait for the disk: with clouds 6 MB each.
const WAITING: usize = 8;
/// The most that is lost when the process or the machine dies.
const SYNC_PERIOD: Duration = Duration::from_secs(1);
/// The services are ours and exist: no waiting.
const NO_WAIT: Duration = Duration::ZERO;

/// The worker's end of a recording.
pub(crate) struct Recorder {
    frames: SyncSender<Offer>,
    room: Arc<Room>,
    listener: JoinHandle<u64>,
    disk: JoinHandle<Disk>,
    refused: u64,
}

/// A frame whose results have just been published.
struct Offer {
    frame: Frame,
    camera: Option<Camera>,
}

/// Whether a frame may be left out: not of a source that waits, since it will not send another instead.
fn waits(frame: &Frame) -> bool {
    !frame.in_real_time
}

/// Where the frames of a source that waits are. Those of a live one are not counted: for them there is always room, or
/// they are left out.
struct Room {
    /// One was offered and is not joined with its results yet, which the next frame would overwrite.
    joining: AtomicBool,
    /// Offered, and not written yet.
    under_way: AtomicUsize,
    /// Called when there may be room again.
    changed: Box<dyn Fn() + Send + Sync>,
}

impl Room {
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

    fn leave(&self) {
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
        let changed = Box::new(changed);
        let room = Arc::new(Room { joining: false.into(), under_way: 0.into(), changed });
        let listener = Listener { reader, records, shelf, room: Arc::clone(&room), newer: None, left_out: 0 };
        let of_disk = Arc::clone(&room);
        let named = |name: &str| std::thread::Builder::new().name(name.into());
        let listener = named("listener").spawn(move || listener.run(&offered));
        let disk = named("disk").spawn(move || Disk::new(Box::new(archive), of_disk).run(&waiting, &used));
        let context = "cannot start the recording's threads";
        Ok(Self {
            frames,
            room,
            listener: listener.context(context)?,
            disk: disk.context(context)?,
            refused: 0,
        })
    }

    /// Whether the next frame may be taken on; always of a live source. Nobody waits for threads that are gone: what they
    /// do not take is counted.
    pub(crate) fn has_room(&self) -> bool {
        self.room.is_free() || self.listener.is_finished() || self.disk.is_finished()
    }

    /// Hands over a frame whose results have just been published; never waits. It comes back when there is no room for
    /// it.
    pub(crate) fn offer(&mut self, frame: Frame, camera: Option<Camera>) -> Option<Frame> {
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
        drop(self.frames);
        Ending { missed: self.listener.join(), disk: self.disk, refused: self.refused }
    }
}

/// A recording to which nothing is added any more.
pub(crate) struct Ending {
    missed: std::thread::Result<u64>,
    disk: JoinHandle<Disk>,
    refused: u64,
}

impl Ending {
    /// Waits for the end of the file.
    pub(crate) fn tally(self) -> Tally {
        match (self.missed, self.disk.join()) {
            (Ok(missed), Ok(disk)) => Tally {
                recorded: disk.recorded,
                left_out: self.refused + missed + disk.lost,
                whole: disk.archive.is_none() && !disk.failed,
            },
            _ => Tally { recorded: 0, left_out: self.refused, whole: false },
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
        self.records.try_send(record).is_ok()
    }

    /// The results of a frame; `None` when newer ones have taken their place already. Not by the sequence alone: not
    /// every publisher counts, and one that begins again counts from 0.
    fn results_of(&mut self, wanted: (u64, i64)) -> Option<FrameSet> {
        let of = |set: &FrameSet| {
            let header = set.get(Topic::Depth)?.header();
            Some((header.sequence, header.capture_nanos))
        };
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

/// The file's thread.
struct Disk {
    archive: Option<Box<dyn Archive>>,
    room: Arc<Room>,
    recorded: u64,
    lost: u64,
    failed: bool,
    synced: Instant,
    since_sync: u64,
}

impl Disk {
    fn new(archive: Box<dyn Archive>, room: Arc<Room>) -> Self {
        Self {
            archive: Some(archive),
            room,
            recorded: 0,
            lost: 0,
            failed: false,
            synced: Instant::now(),
            since_sync: 0,
        }
    }

    fn run(mut self, waiting: &Receiver<Record>, used: &Sender<Record>) -> Self {
        loop {
            let patience = SYNC_PERIOD.saturating_sub(self.synced.elapsed());
            match waiting.recv_timeout(patience) {
                Ok(record) => {
                    self.write(&record);
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
        if let Some(archive) = self.archive.take() {
            self.judge(archive.finish());
        }
        self
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
