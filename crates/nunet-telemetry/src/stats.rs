//! What `stats.json` says of messages and latencies.

use serde::{Serialize, Serializer};

use crate::{Latencies, LatencySummary, MessageCounts};

/// Messages to other machines, and frames that were replaced before they became messages.
#[derive(Debug, Serialize)]
pub struct MessageStats {
    sent: u64,
    not_taken: u64,
    superseded: u64,
    /// Why messages may not arrive, if a connection does not work at the end.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    problems: Vec<String>,
}

impl From<&MessageCounts> for MessageStats {
    fn from(counts: &MessageCounts) -> Self {
        Self {
            sent: counts.sent(),
            not_taken: counts.not_taken(),
            superseded: counts.superseded(),
            problems: counts.problems(),
        }
    }
}

/// Milliseconds, from the delivery by the source to the wake-up of the readers.
#[derive(Debug, Serialize)]
pub struct LatencyMs {
    /// From end to end.
    pub total: LatencySummary,
    /// In the order in which they run.
    #[serde(serialize_with = "as_map")]
    pub stages: Vec<(String, LatencySummary)>,
}

fn as_map<S: Serializer>(stages: &[(String, LatencySummary)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(stages.iter().map(|(name, summary)| (name, summary)))
}

impl From<&Latencies> for LatencyMs {
    fn from(latencies: &Latencies) -> Self {
        let stages = latencies.stages().map(|(name, summary)| (name.to_owned(), summary)).collect();
        Self { total: latencies.total(), stages }
    }
}
