//! Notices that another node publishes the topics of a camera.

use std::sync::Arc;
use std::time::{Duration, Instant};

use nunet_ros2_link::Link;
use tracing::warn;

/// How often other publishers are looked for, until one is found. Nodes find each other within seconds.
pub(super) const LOOK_PERIOD: Duration = Duration::from_secs(5);

/// Looks for other publishers of the topics of a camera: a second nunetd with a camera of the same name, or a
/// driver, which may share only `camera_info` or the image. Shared memory refuses a second publisher; a
/// network cannot.
pub(super) struct OtherPublishers {
    /// The topics; none after the warning.
    topics: Vec<String>,
    looked: Instant,
}

impl OtherPublishers {
    /// For topics that only one camera can have.
    pub(super) fn new(topics: Vec<String>, now: Instant) -> Self {
        Self { topics, looked: now }
    }

    /// Looks for them if it is time to. Warns of the first ones, and returns whether it did.
    pub(super) fn check(&mut self, links: &[Arc<dyn Link>], now: Instant) -> bool {
        if now.duration_since(self.looked) < LOOK_PERIOD {
            return false;
        }
        self.looked = now;
        let is_published = |topic: &str| {
            // A connection that fails is reported elsewhere.
            links.iter().any(|link| link.published_types(topic).is_ok_and(|types| !types.is_empty()))
        };
        let shared: Vec<_> = self.topics.iter().filter(|topic| is_published(topic)).cloned().collect();
        if shared.is_empty() {
            return false;
        }
        self.topics.clear();
        let (hint, shared) = ("give each camera of a network a name of its own", shared.join("`, `"));
        warn!(hint, "another node publishes `{shared}` too: subscribers receive the messages of both");
        true
    }
}
