//! Messages that Zenoh dropped because a peer did not take them. Publishers are not informed, but the library
//! counts them, and gives the counts in the format of Prometheus.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use zenoh::{Session, Wait as _};

/// The answer comes from this process.
const TIMEOUT: Duration = Duration::from_secs(1);
/// What is asked for: all links together.
const PARAMETERS: &str = "compression=false;per_transport=false;per_link=false;per_key=false";

/// Counts the messages that a session dropped.
pub(super) struct DropCounter {
    selector: String,
    /// Those that were taken from here already.
    taken: Mutex<u64>,
}

impl DropCounter {
    pub(super) fn new(session: &Session) -> Self {
        let selector = format!("@/{}/*/metrics?{PARAMETERS}", session.zid());
        Self { selector, taken: Mutex::new(0) }
    }

    /// Messages since the last call. 0 if the configuration hides the counts.
    pub(super) fn take(&self, session: &Session) -> u64 {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let Ok(replies) = session.get(&self.selector).timeout(TIMEOUT).wait() else { return 0 };
        let texts = replies.iter().filter_map(|reply| {
            let sample = reply.into_result().ok()?;
            sample.payload().try_to_string().ok().map(|text| dropped(&text))
        });
        let count = texts.sum::<u64>().max(*taken);
        let new = count - *taken;
        *taken = count;
        new
    }
}

/// The messages that were not sent because a queue was full.
fn dropped(metrics: &str) -> u64 {
    let counts = metrics.lines().filter(|line| {
        line.contains("tx_network_message_dropped_payload")
            && line.contains("_count{")
            && line.contains("reason=\"congestion\"")
    });
    counts.filter_map(|line| line.rsplit(' ').next()?.parse::<u64>().ok()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_messages_that_were_not_taken_are_counted() {
        let name = "zenoh_tx_network_message_dropped_payload_bytes";
        let text = format!(
            "# TYPE {name} histogram\n\
             {name}_sum{{message=\"put\",reason=\"congestion\"}} 900\n\
             {name}_count{{message=\"put\",reason=\"congestion\"}} 3\n\
             {name}_count{{message=\"put\",priority=\"data\",reason=\"congestion\"}} 2\n\
             {name}_count{{message=\"put\",reason=\"no-link\"}} 7\n\
             zenoh_rx_network_message_dropped_payload_bytes_count{{reason=\"congestion\"}} 9\n"
        );
        assert_eq!(dropped(&text), 5);
        assert_eq!(dropped(""), 0);
    }
}
