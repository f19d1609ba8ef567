//! A thread behind a bounded queue, for sinks that write to disks or networks: inference never waits for
//! them.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;

use nunet_telemetry::{DrainTimeout, GivenUp, StallDetector};

/// Called from the queue's thread when there is room again.
pub type OnRoom = Arc<dyn Fn() + Send + Sync>;

/// The user is warned if nothing is written for this long while items wait. A slow disk still makes progress.
const STALLED: Duration = Duration::from_secs(5);
/// How often [`Writer::flush_if_due`] is called while the queue is empty.
pub const FLUSH_CHECK_PERIOD: Duration = Duration::from_millis(250);

/// Writes items on the queue's thread.
pub trait Writer: Send + 'static {
    /// What is written; used items are filled again, so that a steady stream allocates nothing.
    type Item: Default + Send;

    /// Writes an item. The writer counts its failures.
    fn write(&mut self, item: &Self::Item);

    /// Called after each write, and every [`FLUSH_CHECK_PERIOD`] without one.
    fn flush_if_due(&mut self) {}

    /// Called once after the last item.
    fn finish(&mut self);
}

/// The inference thread's end of the queue.
pub struct SinkQueue<W: Writer> {
    items: SyncSender<W::Item>,
    used: Receiver<W::Item>,
    capacity: u64,
    progress: Arc<Progress>,
    stall: StallDetector,
    thread: JoinHandle<W>,
    dropped: u64,
}

/// The progress of the thread, visible even while it hangs.
#[derive(Debug, Default)]
struct Progress {
    queued: AtomicU64,
    written: AtomicU64,
}

impl Progress {
    /// Items in the queue and the one that is being written.
    fn waiting(&self) -> u64 {
        // An item may be counted as written before it is counted as queued.
        self.queued.load(Ordering::Relaxed).saturating_sub(self.written())
    }

    fn written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }
}

impl<W: Writer> SinkQueue<W> {
    /// Starts the thread. `capacity` is the number of items in the queue and being written; `on_room` is
    /// called after each item.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn start(name: &str, capacity: usize, writer: W, on_room: OnRoom) -> anyhow::Result<Self> {
        let (items, waiting) = sync_channel(capacity);
        let (give_back, used) = sync_channel(capacity + 1);
        // Each item is filled once by the first frames; later frames reuse its memory and allocate nothing.
        (0..=capacity).filter_map(|_| give_back.try_send(W::Item::default()).err()).for_each(drop);
        let progress = Arc::new(Progress::default());
        let (seen, thread) = (Arc::clone(&progress), std::thread::Builder::new().name(name.into()));
        let thread = thread.spawn(move || run(writer, &waiting, &give_back, &seen, &on_room));
        let thread = thread.with_context(|| format!("cannot start the thread `{name}`"))?;
        let (capacity, stall) = (capacity as u64, StallDetector::new(Instant::now()));
        Ok(Self { items, used, capacity, progress, stall, thread, dropped: 0 })
    }

    /// Whether the next item would be accepted. If the thread is gone, items are dropped.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.progress.waiting() < self.capacity || self.thread.is_finished()
    }

    /// Calls `fill` to fill an item and queues it. If there is no room, the item is dropped and counted.
    pub fn offer(&mut self, fill: impl FnOnce(&mut W::Item)) {
        if self.progress.waiting() >= self.capacity || self.thread.is_finished() {
            self.dropped += 1;
            return;
        }
        let mut item = self.used.try_recv().unwrap_or_default();
        fill(&mut item);
        self.progress.queued.fetch_add(1, Ordering::Relaxed);
        if self.items.try_send(item).is_err() {
            self.progress.queued.fetch_sub(1, Ordering::Relaxed);
            self.dropped += 1;
        }
    }

    /// The time without a write while items wait, reported once per stall.
    pub fn stall_warning(&mut self) -> Option<Duration> {
        let (written, is_expected) = (self.progress.written(), self.progress.waiting() > 0);
        self.stall.warning(written, is_expected, STALLED, Instant::now())
    }

    /// Items in the queue and the one that is being written.
    #[must_use]
    pub fn waiting(&self) -> u64 {
        self.progress.waiting()
    }

    /// Accepts no more items; those in the queue are still written.
    pub fn close(self) -> ClosedQueue<W> {
        let Self { progress, thread, dropped, .. } = self;
        ClosedQueue { progress, thread, dropped }
    }
}

/// A queue that takes no more items.
pub struct ClosedQueue<W: Writer> {
    progress: Arc<Progress>,
    thread: JoinHandle<W>,
    /// Items that were dropped because the queue was full.
    pub dropped: u64,
}

impl<W: Writer> ClosedQueue<W> {
    /// Waits until everything is written and returns the writer; `None` if its thread panicked.
    ///
    /// # Errors
    /// It took longer than `timeout` allows.
    pub fn wait(self, what: &str, timeout: &mut DrainTimeout<'_>) -> Result<Option<W>, GivenUp> {
        let Self { progress, thread, dropped: _ } = self;
        timeout.wait(what, || thread.is_finished(), || progress.written())?;
        Ok(thread.join().ok())
    }
}

fn run<W: Writer>(
    mut writer: W,
    waiting: &Receiver<W::Item>,
    give_back: &SyncSender<W::Item>,
    progress: &Progress,
    on_room: &OnRoom,
) -> W {
    loop {
        match waiting.recv_timeout(FLUSH_CHECK_PERIOD) {
            Ok(item) => {
                writer.write(&item);
                progress.written.fetch_add(1, Ordering::Relaxed);
                // At the end it is not reused.
                let _ = give_back.try_send(item);
                on_room();
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        writer.flush_if_due();
    }
    writer.finish();
    writer
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::sync::mpsc::{Sender, channel};

    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    /// Writes an item when the test allows it.
    struct Gate {
        allowed: Receiver<()>,
        written: Arc<Mutex<Vec<u64>>>,
    }

    impl Writer for Gate {
        type Item = u64;

        fn write(&mut self, item: &u64) {
            self.allowed.recv_timeout(LONG).unwrap();
            self.written.lock().unwrap().push(*item);
        }

        fn finish(&mut self) {
            self.written.lock().unwrap().push(u64::MAX);
        }
    }

    type Written = Arc<Mutex<Vec<u64>>>;

    /// A queue, what allows a write, what is notified of room, and what was written.
    fn gate(capacity: usize) -> (SinkQueue<Gate>, Sender<()>, Receiver<()>, Written) {
        let (allow, allowed) = channel();
        let (room, on_room) = channel();
        let (written, room) = (Arc::default(), Mutex::new(room));
        let writer = Gate { allowed, written: Arc::clone(&written) };
        let on_room_called: OnRoom = Arc::new(move || room.lock().unwrap().send(()).unwrap_or_default());
        (SinkQueue::start("gate", capacity, writer, on_room_called).unwrap(), allow, on_room, written)
    }

    #[test]
    fn a_full_queue_drops_and_counts_and_has_room_again_after_a_write() {
        let (mut queue, allow, on_room, written) = gate(2);
        for item in 0..5 {
            assert_eq!(queue.has_room(), item < 2);
            queue.offer(|place| *place = item);
        }
        assert_eq!((queue.waiting(), queue.dropped), (2, 3));
        allow.send(()).unwrap();
        on_room.recv_timeout(LONG).expect("it has room after a write");
        assert!(queue.has_room());
        queue.offer(|place| *place = 9);
        allow.send(()).unwrap();
        allow.send(()).unwrap();
        let closed = queue.close();
        assert_eq!(closed.dropped, 3);
        assert!(closed.wait("items", &mut DrainTimeout::new(&|| false)).unwrap().is_some());
        assert_eq!(*written.lock().unwrap(), [0, 1, 9, u64::MAX], "all accepted items, then the end");
    }

    #[test]
    fn a_writer_that_hangs_is_abandoned_after_a_stop() {
        let (mut queue, allow, _on_room, _) = gate(2);
        queue.offer(|place| *place = 1);
        let mut timeout = DrainTimeout::with(&|| true, Duration::ZERO, LONG);
        assert_eq!(queue.close().wait("items", &mut timeout).err(), Some(GivenUp::Stopped(Duration::ZERO)));
        drop(allow);
    }

    #[test]
    fn items_for_a_dead_thread_are_dropped_without_waiting() {
        let (mut queue, allow, ..) = gate(1);
        drop(allow); // the writer panics
        queue.offer(|place| *place = 1);
        let start = Instant::now();
        while !queue.thread.is_finished() {
            assert!(start.elapsed() < LONG, "the writer goes on");
            std::thread::yield_now();
        }
        assert!(queue.has_room());
        queue.offer(|place| *place = 2);
        let closed = queue.close();
        assert_eq!(closed.dropped, 1);
        assert!(closed.wait("items", &mut DrainTimeout::new(&|| false)).unwrap().is_none());
    }
}
