//! A subscriber of one topic.

use std::sync::Arc;
use std::time::Duration;

use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber as ZenohSubscriber;
use zenoh::sample::{Locality, Sample, SampleKind};
use zenoh::{Session, Wait as _};

use super::graph::RemotePublishers;
use super::inbox::SampleInbox;
use super::keys::{Entity, TopicKey};
use super::router::Router;
use crate::error::Ros2Error;
use crate::link::{Arrival, MessageSubscriber};
use crate::message_type::MessageType;

/// A subscriber of one topic.
pub(super) struct TopicSubscriber {
    session: Session,
    _token: LivelinessToken,
    _messages: ZenohSubscriber<()>,
    inbox: Arc<SampleInbox>,
    publishers: Arc<RemotePublishers>,
    message_type: MessageType,
    router: Arc<Router>,
}

impl TopicSubscriber {
    /// Subscribes to `topic` as `entity`, in other sessions.
    pub(super) fn declare(
        session: &Session,
        entity: &Entity<'_>,
        topic: &TopicKey,
        message_type: MessageType,
        publishers: Arc<RemotePublishers>,
        router: Arc<Router>,
    ) -> zenoh::Result<Self> {
        let inbox = Arc::<SampleInbox>::default();
        let filled = Arc::clone(&inbox);
        let messages = session.declare_subscriber(topic.key_of_any_hash(entity.domain));
        let messages = messages.allowed_origin(Locality::Remote).callback(move |sample: Sample| {
            if sample.kind() == SampleKind::Put {
                filled.put(&sample);
            }
        });
        let messages = messages.wait()?;
        let token = session.liveliness().declare_token(entity.subscriber_token(topic)).wait()?;
        let session = session.clone();
        Ok(Self { session, _token: token, _messages: messages, inbox, publishers, message_type, router })
    }
}

impl MessageSubscriber for TopicSubscriber {
    fn update(&mut self) -> Result<usize, Ros2Error> {
        // Reports whether the router is there.
        let _ = self.router.problem(&self.session);
        Ok(self.publishers.count(self.message_type.name()))
    }

    fn take(&mut self, message: &mut Vec<u8>, timeout: Duration) -> Arrival {
        self.inbox.take(message, timeout)
    }
}
