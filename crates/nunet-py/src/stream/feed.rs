//! The frames of a subscriber, which threads take in turn.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use nunet_ipc::{CameraName, FrameSet, IpcError, Publishers, Reader, StatsRecord, Topic};
use pyo3::exceptions::PyTimeoutError;
use pyo3::prelude::*;

use crate::error::hinted;

/// The feed while no thread uses it. A thread takes it out instead of locking it, because Python code (a
/// signal handler) may run meanwhile.
#[derive(Debug)]
pub(super) struct SharedFeed {
    state: Mutex<FeedState>,
    returned: Condvar,
}

#[derive(Debug)]
struct FeedState {
    feed: Option<Feed>,
    /// For callers that ask while a thread uses the feed. Dropped on closing, because it keeps the topics
    /// open.
    publishers: Option<Publishers>,
    closed: bool,
}

/// An open reader.
#[derive(Debug)]
pub(super) struct Feed {
    reader: Reader,
    topics: Vec<Topic>,
    stats: Option<StatsRecord>,
}

/// A received frame.
pub(super) struct Arrival {
    pub(super) set: Option<FrameSet>,
    pub(super) stats: Option<StatsRecord>,
}

/// The outcome of [`SharedFeed::take`].
pub(super) enum TakenFeed {
    Feed(Box<Feed>),
    /// Another thread uses it.
    Busy,
    Closed,
}

impl SharedFeed {
    pub(super) fn new(feed: Feed) -> Self {
        let publishers = Some(feed.reader.publishers());
        let state = FeedState { feed: Some(feed), publishers, closed: false };
        Self { state: Mutex::new(state), returned: Condvar::new() }
    }

    /// Whether it is closed.
    pub(super) fn is_closed(&self) -> bool {
        self.state().closed
    }

    /// The publishers of the topics; `None` after closing.
    pub(super) fn publishers(&self) -> Option<Publishers> {
        self.state().publishers.clone()
    }

    fn state(&self) -> MutexGuard<'_, FeedState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the feed. Waits up to `timeout` for another thread that has it.
    pub(super) fn take(&self, timeout: Duration) -> TakenFeed {
        let waits = |state: &mut FeedState| !state.closed && state.feed.is_none();
        let (mut state, _) = self
            .returned
            .wait_timeout_while(self.state(), timeout, waits)
            .unwrap_or_else(PoisonError::into_inner);
        if state.closed {
            return TakenFeed::Closed;
        }
        state.feed.take().map_or(TakenFeed::Busy, |feed| TakenFeed::Feed(Box::new(feed)))
    }

    /// Closes it. A thread that uses the feed drops it soon.
    pub(super) fn close(&self) {
        let feed = {
            let mut state = self.state();
            state.closed = true;
            (state.feed.take(), state.publishers.take())
        };
        self.returned.notify_all();
        drop(feed);
    }
}

/// The feed while one thread uses it. Dropping it returns the feed.
pub(super) struct BorrowedFeed<'a> {
    shared: &'a SharedFeed,
    pub(super) feed: Option<Box<Feed>>,
}

impl<'a> BorrowedFeed<'a> {
    pub(super) fn new(shared: &'a SharedFeed, feed: Box<Feed>) -> Self {
        Self { shared, feed: Some(feed) }
    }
}

impl Drop for BorrowedFeed<'_> {
    fn drop(&mut self) {
        let mut state = self.shared.state();
        if !state.closed {
            state.feed = self.feed.take().map(|feed| *feed);
        }
        drop(state);
        self.shared.returned.notify_one();
    }
}

impl Feed {
    pub(super) fn new(reader: Reader, topics: Vec<Topic>) -> Self {
        Self { reader, topics, stats: None }
    }

    /// The newest frame that is complete and was not returned yet. Waits up to `timeout` for one.
    pub(super) fn poll(&mut self, timeout: Duration) -> Result<Option<Arrival>, IpcError> {
        if let Some(arrival) = self.newest()? {
            return Ok(Some(arrival));
        }
        if timeout.is_zero() {
            return Ok(None);
        }
        self.reader.wait(timeout)?; // events are a hint: read in any case
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
            return Ok(None); // the frame would be incomplete
        }
        if self.topics == [Topic::Stats] {
            return Ok(fresh.then_some(Arrival { set: None, stats: self.stats }));
        }
        let stats = self.stats;
        Ok(self.reader.next_set()?.map(|set| Arrival { set: Some(set), stats }))
    }

    /// The exception for a timeout: which publisher is silent, dead or missing, and what to do.
    pub(super) fn timeout_error(&self, camera: &CameraName, timeout: Option<Duration>) -> PyErr {
        let names: Vec<_> = self.topics.iter().map(|topic| format!("`{topic}`")).collect();
        let mut why = "nothing was published".to_owned();
        let mut hint = format!(
            "look at the source with `nunetd watch {camera}`, or pass a longer timeout for a slow network"
        );
        for topic in &self.topics {
            match self.reader.publisher(*topic) {
                Ok(Some(publisher)) if publisher.alive => {
                    why = format!("process {} publishes it, but has sent nothing new", publisher.pid);
                    continue;
                }
                Ok(Some(publisher)) => {
                    why = format!("process {}, which published `{topic}`, is dead", publisher.pid);
                }
                _ => why = format!("`{topic}` is no longer published"),
            }
            let program = match topic {
                Topic::Rgb => "the camera's own publisher, such as `nunetd feed`".to_owned(),
                _ => format!("`nunetd --camera {camera}`"),
            };
            hint = format!("start it again, {program}: this subscriber then continues");
            break;
        }
        let seconds = timeout.unwrap_or_default().as_secs_f64();
        let topics = names.join(", ");
        hinted::<PyTimeoutError>(
            format!("no frame of camera `{camera}` ({topics}) within {seconds} s: {why}"),
            hint,
        )
    }
}
