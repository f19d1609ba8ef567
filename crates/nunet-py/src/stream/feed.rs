//! Frames as they come, for whichever thread takes its turn.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use nunet_ipc::{CameraName, FrameSet, IpcError, Owners, Reader, StatsRecord, Topic};
use pyo3::exceptions::PyTimeoutError;
use pyo3::prelude::*;

/// Where the feed lies while no thread uses it. It is taken away to be used, so that nothing is locked while Python
/// code (a handler of a signal) may run.
#[derive(Debug)]
pub(super) struct Desk {
    state: Mutex<State>,
    returned: Condvar,
}

#[derive(Debug)]
struct State {
    feed: Option<Feed>,
    // For who asks while a thread uses the feed. Gone when it is closed: it keeps the topics open.
    owners: Option<Owners>,
    closed: bool,
}

#[derive(Debug)]
pub(super) struct Feed {
    reader: Reader,
    topics: Vec<Topic>,
    stats: Option<StatsRecord>,
}

/// What came.
pub(super) struct Arrival {
    pub(super) set: Option<FrameSet>,
    pub(super) stats: Option<StatsRecord>,
}

/// What a look at the desk finds.
pub(super) enum Found {
    Feed(Box<Feed>),
    /// Another thread uses it.
    Busy,
    Closed,
}

impl Desk {
    pub(super) fn new(feed: Feed) -> Self {
        let owners = Some(feed.reader.owners());
        let state = State { feed: Some(feed), owners, closed: false };
        Self { state: Mutex::new(state), returned: Condvar::new() }
    }

    /// Whether it was closed.
    pub(super) fn is_closed(&self) -> bool {
        self.state().closed
    }

    /// Who publishes; `None` when it was closed.
    pub(super) fn owners(&self) -> Option<Owners> {
        self.state().owners.clone()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the feed; waits a moment for the thread that has it.
    pub(super) fn take(&self, patience: Duration) -> Found {
        let waits = |state: &mut State| !state.closed && state.feed.is_none();
        let (mut state, _) = self
            .returned
            .wait_timeout_while(self.state(), patience, waits)
            .unwrap_or_else(PoisonError::into_inner);
        if state.closed {
            return Found::Closed;
        }
        state.feed.take().map_or(Found::Busy, |feed| Found::Feed(Box::new(feed)))
    }

    /// Ends it. The thread that uses the feed drops it, soon.
    pub(super) fn close(&self) {
        let feed = {
            let mut state = self.state();
            state.closed = true;
            (state.feed.take(), state.owners.take())
        };
        self.returned.notify_all();
        drop(feed);
    }
}

/// The feed, on loan from the desk.
pub(super) struct Turn<'a> {
    desk: &'a Desk,
    pub(super) feed: Option<Box<Feed>>,
}

impl<'a> Turn<'a> {
    pub(super) fn new(desk: &'a Desk, feed: Box<Feed>) -> Self {
        Self { desk, feed: Some(feed) }
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        let mut state = self.desk.state();
        if !state.closed {
            state.feed = self.feed.take().map(|feed| *feed);
        }
        drop(state);
        self.desk.returned.notify_one();
    }
}

impl Feed {
    pub(super) fn new(reader: Reader, topics: Vec<Topic>) -> Self {
        Self { reader, topics, stats: None }
    }

    /// What is new, looking twice: now, and after waiting.
    pub(super) fn look(&mut self, patience: Duration) -> Result<Option<Arrival>, IpcError> {
        if let Some(arrival) = self.newest()? {
            return Ok(Some(arrival));
        }
        if patience.is_zero() {
            return Ok(None);
        }
        self.reader.wait(patience)?; // a hint: look whatever it says
        self.newest()
    }

    fn newest(&mut self) -> Result<Option<Arrival>, IpcError> {
        let wants_stats = self.topics.contains(&Topic::Stats);
        let mut fresh = false;
        if wants_stats && let Some(message) = self.reader.latest(Topic::Stats)? {
            self.stats = Some(*message.stats()?);
            fresh = true;
        }
        if wants_stats && self.stats.is_none() {
            return Ok(None); // a frame without the figures would not be complete
        }
        if self.topics == [Topic::Stats] {
            return Ok(fresh.then_some(Arrival { set: None, stats: self.stats }));
        }
        let stats = self.stats;
        Ok(self.reader.next_set()?.map(|set| Arrival { set: Some(set), stats }))
    }

    /// Why nothing comes, and what to do.
    pub(super) fn silence(&self, camera: &CameraName, patience: Option<Duration>) -> PyErr {
        let names: Vec<_> = self.topics.iter().map(|topic| format!("`{topic}`")).collect();
        let mut why = "it sends nothing".to_owned();
        let mut hint = format!(
            "its source may stand still (`nunetd watch {camera}` shows it); a slow network wants a longer timeout"
        );
        for topic in &self.topics {
            match self.reader.owner(*topic) {
                Ok(Some(owner)) if owner.alive => {
                    why = format!("process {} publishes it, but sends nothing new", owner.pid);
                    continue;
                }
                Ok(Some(owner)) => {
                    why = format!("process {}, which published `{topic}`, is dead", owner.pid);
                }
                _ => why = format!("nobody publishes `{topic}` any more"),
            }
            hint = format!(
                "start it again (`nunetd --camera {camera}`): this subscriber goes on with its frames by itself"
            );
            break;
        }
        let seconds = patience.unwrap_or_default().as_secs_f64();
        PyTimeoutError::new_err(format!(
            "no frame of camera `{camera}` ({}) in {seconds} s: {why}\nhint: {hint}",
            names.join(", ")
        ))
    }
}
