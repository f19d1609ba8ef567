//! A publisher of one topic.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::{Duration, SystemTime};

use twox_hash::XxHash3_128;
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::{CongestionControl, Reliability};
use zenoh::{Session, Wait as _};
use zenoh_ext::{AdvancedPublisher, AdvancedPublisherBuilderExt as _, CacheConfig, MissDetectionConfig};

use super::attachment::{self, Gid, Origin};
use super::keys::{Entity, TopicKey};
use crate::link::{Delivery, MessagePublisher};

/// How often a publisher that keeps messages states the number of the last one, as in `rmw_zenoh`.
const HEARTBEAT: Duration = Duration::from_millis(500);

/// A publisher of one topic.
pub(super) struct TopicPublisher {
    // First: it disappears from the graph before it ends.
    _token: LivelinessToken,
    publisher: AdvancedPublisher<'static>,
    has_subscribers: Arc<AtomicBool>,
    gid: Gid,
    sequence: AtomicI64,
}

impl TopicPublisher {
    /// Publishes `topic` as `entity`. A message that a peer has no room for is dropped, as `rmw_zenoh` does.
    pub(super) fn declare(
        session: &Session,
        entity: &Entity<'_>,
        topic: &TopicKey,
        delivery: Delivery,
    ) -> zenoh::Result<Self> {
        let builder = session.declare_publisher(topic.key(entity.domain));
        let builder = builder.congestion_control(CongestionControl::Drop).reliability(Reliability::Reliable);
        let publisher = if delivery.is_kept {
            let cache = CacheConfig::default().max_samples(delivery.depth as usize);
            let misses = MissDetectionConfig::default().sporadic_heartbeat(HEARTBEAT);
            builder.cache(cache).publisher_detection().sample_miss_detection(misses).wait()?
        } else {
            builder.advanced().wait()?
        };
        let has_subscribers = Arc::new(AtomicBool::new(false));
        let shared = Arc::clone(&has_subscribers);
        let listener = publisher.matching_listener();
        let listener = listener.callback(move |status| shared.store(status.matching(), Ordering::Relaxed));
        listener.background().wait()?;
        if publisher.matching_status().wait()?.matching() {
            has_subscribers.store(true, Ordering::Relaxed);
        }
        let token = entity.publisher_token(topic, delivery);
        // Other nodes compute the same identifier from the token.
        let gid = XxHash3_128::oneshot(token.as_bytes()).to_le_bytes();
        let token = session.liveliness().declare_token(token).wait()?;
        Ok(Self { _token: token, publisher, has_subscribers, gid, sequence: AtomicI64::new(1) })
    }
}

impl MessagePublisher for TopicPublisher {
    /// Zenoh states whether there are any, not how many.
    fn subscribers(&self) -> usize {
        usize::from(self.has_subscribers.load(Ordering::Relaxed))
    }

    fn send(&self, message: &[u8]) -> bool {
        let sequence = self.sequence.fetch_add(1, Ordering::Relaxed);
        let origin = Origin { sequence, publisher: self.gid };
        let since_1970 = SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default();
        let unix_nanos = i64::try_from(since_1970.as_nanos()).unwrap_or(i64::MAX);
        let attachment = attachment::write(origin, unix_nanos);
        self.publisher.put(message.to_vec()).attachment(attachment).wait().is_ok()
    }
}
