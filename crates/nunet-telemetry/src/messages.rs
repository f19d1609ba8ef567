//! Counts of the messages that an output sends to other machines.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::gauge::Gauge;

/// Counts of the messages and frames of one camera, by outcome. Copies share their counts.
#[derive(Debug, Clone, Default)]
pub struct MessageCounts {
    pub(crate) sent: Counter,
    pub(crate) not_taken: Counter,
    pub(crate) superseded: Counter,
    pub(crate) connections_down: Gauge,
    pub(crate) problems: Arc<Mutex<Vec<String>>>,
}

impl MessageCounts {
    /// Messages that were handed to the network for at least one subscriber.
    #[must_use]
    pub fn sent(&self) -> u64 {
        self.sent.get()
    }

    /// Messages that a subscriber had no room for: its earlier ones were still on their way. A message that
    /// was dropped on its way to one of several subscribers counts as sent, too.
    #[must_use]
    pub fn not_taken(&self) -> u64 {
        self.not_taken.get()
    }

    /// Frames that newer ones replaced before they were encoded.
    #[must_use]
    pub fn superseded(&self) -> u64 {
        self.superseded.get()
    }

    /// Counts a message.
    pub fn add(&self, was_taken: bool) {
        (if was_taken { &self.sent } else { &self.not_taken }).inc();
    }

    /// Counts messages that were handed to the network, and then dropped on their way to a subscriber.
    pub fn add_dropped(&self, count: u64) {
        self.not_taken.inc_by(count);
    }

    /// Why messages may not arrive now, one for each connection that does not work.
    #[must_use]
    pub fn problems(&self) -> Vec<String> {
        self.lock_problems().clone()
    }

    /// States which connections do not work now.
    pub fn set_problems(&self, problems: Vec<String>) {
        self.connections_down.set(i64::try_from(problems.len()).unwrap_or(i64::MAX));
        *self.lock_problems() = problems;
    }

    fn lock_problems(&self) -> MutexGuard<'_, Vec<String>> {
        self.problems.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a frame that a newer one replaced.
    pub fn add_superseded(&self) {
        self.superseded.inc();
    }
}
