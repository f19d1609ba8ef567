//! A camera: the newest frame, the clients that wait for the next one, and the state of its stream.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};

use nunet_telemetry::Counts;
use serde::Serialize;
use tokio::sync::watch;

use crate::frame::ViewFrame;

/// While no client waits, one frame is kept per such period, so that a client that connects while the source
/// is paused receives a frame.
const KEEP_PERIOD: Duration = Duration::from_secs(1);

/// The state of a camera's stream.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct CameraStatus {
    /// Whether the source delivers frames.
    pub up: bool,
    /// How its frames ended.
    pub frames: Counts,
    /// Published frames per second.
    pub fps: f64,
}

/// A camera, shared by its producer and its clients.
#[derive(Debug)]
pub(crate) struct SharedCamera {
    pub(crate) name: String,
    /// Names of the classes, by label.
    pub(crate) classes: Vec<String>,
    /// Its read position never advances, so that the kept frame is new for each clone.
    newest: Slot,
    waiting: AtomicUsize,
    /// Clients that show each result of [`OnDemand`].
    demands: [AtomicUsize; 3],
    status: Mutex<CameraStatus>,
}

/// A client's slot: it holds the newest frame, and only that one.
pub(crate) type Slot = watch::Receiver<Option<Arc<ViewFrame>>>;

impl SharedCamera {
    fn new(name: &str, classes: &[String], newest: Slot) -> Self {
        Self {
            name: name.to_owned(),
            classes: classes.to_vec(),
            newest,
            waiting: AtomicUsize::new(0),
            demands: Default::default(),
            status: Mutex::default(),
        }
    }

    /// A slot that contains the kept frame.
    pub(crate) fn slot(&self) -> Slot {
        self.newest.clone()
    }

    /// The newest frame that was kept.
    pub(crate) fn newest(&self) -> Option<Arc<ViewFrame>> {
        self.newest.borrow().clone()
    }

    /// Waits for a frame that the slot did not return yet; `None` once the producer is gone.
    pub(crate) async fn next(&self, slot: &mut Slot) -> Option<Arc<ViewFrame>> {
        let _waiting = Interest::in_counter(&self.waiting);
        loop {
            slot.changed().await.ok()?;
            let frame = slot.borrow_and_update().clone();
            if frame.is_some() {
                return frame;
            }
        }
    }

    /// Requests a result until the returned value is dropped.
    pub(crate) fn demand(self: &Arc<Self>, result: OnDemand) -> Demand {
        self.demands[result as usize].fetch_add(1, Ordering::AcqRel);
        Demand { camera: Arc::clone(self), result }
    }

    /// The state of the stream.
    pub(crate) fn status(&self) -> CameraStatus {
        *self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Increments a counter until it is dropped.
struct Interest<'a>(&'a AtomicUsize);

impl<'a> Interest<'a> {
    fn in_counter(counter: &'a AtomicUsize) -> Self {
        counter.fetch_add(1, Ordering::AcqRel);
        Self(counter)
    }
}

impl Drop for Interest<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

/// A result that is computed only while a client shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OnDemand {
    /// The labels.
    Labels,
    /// The confidence.
    Confidence,
    /// The obstacles.
    Obstacles,
}

/// A client that shows a result.
#[derive(Debug)]
pub(crate) struct Demand {
    camera: Arc<SharedCamera>,
    result: OnDemand,
}

impl Drop for Demand {
    fn drop(&mut self) {
        self.camera.demands[self.result as usize].fetch_sub(1, Ordering::AcqRel);
    }
}

/// All cameras of a server.
#[derive(Debug, Default)]
pub(crate) struct Cameras(RwLock<Vec<Arc<SharedCamera>>>);

impl Cameras {
    /// Adds a camera. One of the same name is replaced: its producer was restarted.
    pub(crate) fn add(&self, name: &str, classes: &[String]) -> CameraFeed {
        let (newest, slot) = watch::channel(None);
        let camera = Arc::new(SharedCamera::new(name, classes, slot));
        let mut cameras = self.0.write().unwrap_or_else(PoisonError::into_inner);
        cameras.retain(|other| other.name != name);
        cameras.push(Arc::clone(&camera));
        CameraFeed { camera, newest, pool: Vec::new(), kept: None }
    }

    /// The camera of a name.
    ///
    /// # Errors
    /// It is not there, or not yet.
    pub(crate) fn find(&self, name: &str) -> Result<Arc<SharedCamera>, NoCamera> {
        let running = self.all();
        if running.is_empty() {
            return Err(NoCamera::Starting);
        }
        let found = running.iter().find(|camera| camera.name == name).cloned();
        found.ok_or_else(|| NoCamera::Unknown {
            name: name.to_owned(),
            running: running.iter().map(|camera| format!("`{}`", camera.name)).collect(),
        })
    }

    /// All of them, in the order in which they were added.
    pub(crate) fn all(&self) -> Vec<Arc<SharedCamera>> {
        self.0.read().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Why a camera is not found.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NoCamera {
    /// The server runs before the first camera does, for example while a model is loaded.
    #[error("no camera is running yet; try again")]
    Starting,
    /// Other cameras run.
    #[error("there is no camera `{name}`, expected one of: {}", running.join(", "))]
    Unknown {
        /// The name.
        name: String,
        /// The names of those that run, in backticks.
        running: Vec<String>,
    },
}

/// The producer's end of a camera. No function of it blocks.
#[derive(Debug)]
pub struct CameraFeed {
    camera: Arc<SharedCamera>,
    newest: watch::Sender<Option<Arc<ViewFrame>>>,
    /// Frames that were offered; those that no client holds any more are filled again.
    pool: Vec<Arc<ViewFrame>>,
    kept: Option<Instant>,
}

impl CameraFeed {
    /// Whether the next frame should be offered: a client waits for it, or the kept frame is at least a
    /// second old.
    #[must_use]
    pub fn is_wanted(&self) -> bool {
        self.camera.waiting.load(Ordering::Acquire) > 0
            || self.kept.is_none_or(|kept| kept.elapsed() >= KEEP_PERIOD)
    }

    /// Whether a client shows a result.
    #[must_use]
    pub fn wants(&self, result: OnDemand) -> bool {
        self.camera.demands[result as usize].load(Ordering::Acquire) > 0
    }

    /// Calls `fill` to copy a frame, and passes it to the clients that wait. Nothing is encoded here.
    pub fn offer(&mut self, fill: impl FnOnce(&mut ViewFrame)) {
        let mut frame = self.free_frame();
        // The frame is free: this is the only reference to it.
        if let Some(frame) = Arc::get_mut(&mut frame) {
            frame.clear();
            fill(frame);
        }
        self.pool.push(Arc::clone(&frame));
        self.kept = Some(Instant::now());
        self.newest.send_replace(Some(frame));
    }

    /// Reports the state of the stream.
    pub fn set_status(&self, status: CameraStatus) {
        *self.camera.status.lock().unwrap_or_else(PoisonError::into_inner) = status;
    }

    /// A frame that no client holds, or a new one. There are as many as clients hold, and two more.
    fn free_frame(&mut self) -> Arc<ViewFrame> {
        let free = self.pool.iter_mut().position(|frame| Arc::get_mut(frame).is_some());
        free.map(|index| self.pool.swap_remove(index)).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feed() -> (Arc<SharedCamera>, CameraFeed) {
        let feed = Cameras::default().add("front", &[]);
        (Arc::clone(&feed.camera), feed)
    }

    fn offer(feed: &mut CameraFeed, sequence: u64) {
        feed.offer(|frame| frame.sequence = sequence);
    }

    #[test]
    fn a_frame_is_wanted_while_a_client_waits_and_once_per_second_for_those_that_come_later() {
        let (camera, mut feed) = feed();
        assert!(feed.is_wanted(), "none is kept yet");
        offer(&mut feed, 0);
        assert!(!feed.is_wanted());
        let waiting = Interest::in_counter(&camera.waiting);
        assert!(feed.is_wanted());
        drop(waiting);
        assert!(!feed.is_wanted());
        feed.kept = Instant::now().checked_sub(KEEP_PERIOD);
        assert!(feed.is_wanted());
    }

    #[test]
    fn a_result_is_wanted_while_a_client_shows_it() {
        let (camera, feed) = feed();
        assert!(!feed.wants(OnDemand::Labels));
        let (first, second) = (camera.demand(OnDemand::Labels), camera.demand(OnDemand::Labels));
        drop(first);
        assert!(feed.wants(OnDemand::Labels));
        assert!(!feed.wants(OnDemand::Obstacles));
        drop(second);
        assert!(!feed.wants(OnDemand::Labels));
    }

    #[test]
    fn a_client_that_stalls_holds_one_frame_and_finds_the_newest_one_afterwards() {
        let (camera, mut feed) = feed();
        let mut stalled = camera.slot();
        offer(&mut feed, 0);
        let held = stalled.borrow_and_update().clone().unwrap();
        for sequence in 1..100 {
            offer(&mut feed, sequence);
        }
        assert_eq!(feed.pool.len(), 3, "the held one, the newest one and the one before it");
        assert_eq!(held.sequence, 0, "it was not filled again");
        assert_eq!(stalled.borrow_and_update().as_ref().unwrap().sequence, 99);
    }

    #[test]
    fn a_camera_that_is_added_again_replaces_the_one_before() {
        let cameras = Cameras::default();
        let (_front, _rear) = (cameras.add("front", &[]), cameras.add("rear", &[]));
        let again = cameras.add("front", &["floor".to_owned()]);
        let names: Vec<_> = cameras.all().iter().map(|camera| camera.name.clone()).collect();
        assert_eq!(names, ["rear", "front"]);
        assert!(Arc::ptr_eq(&cameras.find("front").unwrap(), &again.camera));
        assert!(matches!(cameras.find("left"), Err(NoCamera::Unknown { name, .. }) if name == "left"));
    }

    #[test]
    fn before_the_first_camera_no_name_is_wrong() {
        let cameras = Cameras::default();
        assert!(matches!(cameras.find("front"), Err(NoCamera::Starting)));
        let _front = cameras.add("front", &[]);
        assert!(cameras.find("front").is_ok());
    }
}
