//! Notices that another node publishes the topics of a camera.

use std::sync::Arc;
use std::time::{Duration, Instant};

use nunet_ros2_link::Link;
use tracing::warn;

/// How often other publishers are looked for, until one is found. Nodes find each other within seconds.
pub(super) const LOOK_PERIOD: Duration = Duration::from_secs(5);

/// Looks for other publishers of one topic of a camera, for instance of a second nunetd with a camera of the
/// same name. Shared memory refuses a second publisher; a network cannot.
pub(super) struct OtherPublishers {
    /// The topic; `None` after the warning.
    topic: Option<String>,
    looked: Instant,
}

impl OtherPublishers {
    /// For a topic that only one camera can have, if there is one.
    pub(super) fn new(topic: Option<String>, now: Instant) -> Self {
        Self { topic, looked: now }
    }

    /// Looks for them if it is time to. Warns of the first one, and returns whether it did.
    pub(super) fn check(&mut self, links: &[Arc<dyn Link>], now: Instant) -> bool {
        if now.duration_since(self.looked) < LOOK_PERIOD {
            return false;
        }
        self.looked = now;
        let is_published = |topic: &str| {
            // A connection that fails is reported elsewhere.
            links.iter().any(|link| link.published_types(topic).is_ok_and(|types| !types.is_empty()))
        };
        let Some(topic) = self.topic.take_if(|topic| is_published(topic)) else { return false };
        let hint = "give each camera of a network a name of its own";
        warn!(hint, "another node publishes `{topic}` too: subscribers receive the messages of both");
        true
    }
}
