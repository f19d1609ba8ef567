//! Recording beside a running stream: whatever the disk does, inference does not wait for it.
//!
//! ```text
//! worker ──frame──> listener: joins it with its results in shared memory ──record──> disk: encodes, writes, syncs
//! ```
//!
//! Both queues are bounded. A frame that finds one full is left out of the recording and counted.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use nunet_core::camera::Camera;
use nunet_ipc::{CameraName, FrameSet, Reader, Topic};
use tracing::{error, info, warn};

use super::{FrameWriter, Record};
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
    taken: Receiver<()>,
    listener: JoinHandle<u64>,
    disk: JoinHandle<Disk>,
    refused: u64,
}

/// A frame whose results have just been published.
struct Offer {
    frame: Frame,
    camera: Option<Camera>,
    /// Its source waits, and so does the worker: nothing may be left out.
    waits: bool,
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
    /// Attaches to everything that `outlet` publishes of a frame.
    pub(crate) fn start(writer: FrameWriter, camera: &CameraName, outlet: &Outlet) -> anyhow::Result<Self> {
        let topics: Vec<_> = outlet.topics().iter().copied().filter(|&topic| topic != Topic::Stats).collect();
        let reader = Reader::open(camera, &topics, NO_WAIT)?;
        let (frames, offered) = sync_channel(OFFERED);
        let (records, waiting) = sync_channel(WAITING);
        let (used, shelf) = channel();
        let (take, taken) = channel();
        let listener = Listener { reader, records, shelf, take, newer: None, left_out: 0 };
        let named = |name: &str| std::thread::Builder::new().name(name.into());
        let listener = named("listener").spawn(move || listener.run(&offered));
        let disk = named("disk").spawn(move || Disk::new(writer).run(&waiting, &used));
        let context = "cannot start the recording's threads";
        Ok(Self {
            frames,
            taken,
            listener: listener.context(context)?,
            disk: disk.context(context)?,
            refused: 0,
        })
    }

    /// Hands over a frame whose results have just been published. Of a live stream it comes back when there is no room
    /// for it; of a source that waits every frame is taken, however long the disk needs.
    pub(crate) fn offer(&mut self, frame: Frame, camera: Option<Camera>) -> Option<Frame> {
        let waits = !frame.in_real_time;
        let offer = Offer { frame, camera, waits };
        let sent = if waits {
            self.frames.send(offer).map_err(|refused| refused.0)
        } else {
            self.frames.try_send(offer).map_err(|refused| match refused {
                TrySendError::Full(offer) | TrySendError::Disconnected(offer) => offer,
            })
        };
        match sent {
            Ok(()) if waits => {
                // The next frame would overwrite the results. A listener that is gone is told at the end.
                let _ = self.taken.recv();
                None
            }
            Ok(()) => None,
            Err(offer) => {
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
                whole: disk.writer.is_none() && !disk.failed,
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
            warn!("{left_out} frames are not in the recording: it did not keep up, or the disk refused them");
        }
        left_out == 0 && whole
    }
}

/// Joins frames with their results.
struct Listener {
    reader: Reader,
    records: SyncSender<Record>,
    shelf: Receiver<Record>,
    /// Tells the worker that a frame it waits for has been taken.
    take: Sender<()>,
    /// Results that came before their frame.
    newer: Option<FrameSet>,
    left_out: u64,
}

impl Listener {
    fn run(mut self, offered: &Receiver<Offer>) -> u64 {
        while let Ok(offer) = offered.recv() {
            let waits = offer.waits;
            if !self.pass_on(offer) {
                self.left_out += 1;
            }
            if waits {
                // The worker has gone: it waits for nothing.
                let _ = self.take.send(());
            }
        }
        self.left_out
    }

    /// Whether the frame is on its way to the disk.
    fn pass_on(&mut self, Offer { frame, camera, waits }: Offer) -> bool {
        let Some(set) = self.results_of((frame.sequence, frame.capture.nanos)) else { return false };
        let mut record = self.shelf.try_recv().unwrap_or_default();
        record.take(frame, camera);
        record.copy_set(&set);
        if waits { self.records.send(record).is_ok() } else { self.records.try_send(record).is_ok() }
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
    writer: Option<FrameWriter>,
    recorded: u64,
    lost: u64,
    failed: bool,
    synced: Instant,
    since_sync: u64,
}

impl Disk {
    fn new(writer: FrameWriter) -> Self {
        Self {
            writer: Some(writer),
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
        if let Some(writer) = self.writer.take() {
            self.judge(writer.finish());
        }
        self
    }

    fn write(&mut self, record: &Record) {
        let Some(writer) = &mut self.writer else {
            self.lost += 1;
            return;
        };
        let written = writer.write(record);
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
        let synced = self.writer.as_mut().map_or(Ok(()), FrameWriter::sync);
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
        self.writer = None;
        false
    }
}
