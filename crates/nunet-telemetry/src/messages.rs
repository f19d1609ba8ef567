//! Counts of the messages that an output sends to other machines.

use prometheus_client::metrics::counter::Counter;

/// Counts of the messages and frames of one camera, by outcome. Copies share their counts.
#[derive(Debug, Clone, Default)]
pub struct MessageCounts {
    pub(crate) sent: Counter,
    pub(crate) not_taken: Counter,
    pub(crate) superseded: Counter,
}

impl MessageCounts {
    /// Messages that were handed to the network for at least one subscriber.
    #[must_use]
    pub fn sent(&self) -> u64 {
        self.sent.get()
    }

    /// Messages that a subscriber had no room for: its earlier ones were still on their way.
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

    /// Counts a frame that a newer one replaced.
    pub fn add_superseded(&self) {
        self.superseded.inc();
    }
}
