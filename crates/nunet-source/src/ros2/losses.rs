//! Reports images that were lost on the network.

use std::time::{Duration, Instant};

use nunet_types::counted;
use tracing::warn;

/// How often lost images are reported.
const LOSS_PERIOD: Duration = Duration::from_secs(10);

/// Images that were lost on the network.
#[derive(Debug, Default)]
pub(super) struct Losses {
    count: u64,
    reported: Option<Instant>,
}

impl Losses {
    /// Adds images that were lost on `topic`, and reports them all now and then.
    pub(super) fn add(&mut self, count: u64, topic: &str) {
        self.count += count;
        let is_due = self.reported.is_none_or(|last| last.elapsed() >= LOSS_PERIOD);
        if self.count > 0 && is_due {
            let hint = "raise net.core.rmem_max, so that whole images fit into the receive buffer";
            warn!(hint, "lost on the network: {} on topic `{topic}`", counted(self.count, "image"));
            *self = Self { count: 0, reported: Some(Instant::now()) };
        }
    }
}
