//! Creating the services of a camera.

use iceoryx2::node::Node;
use iceoryx2::port::event_id::EventId;
use iceoryx2::prelude::MessagingPattern;
use iceoryx2::service::builder::event::{EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::PortFactory as _;
use nunet_types::{Topic, Wake};

use crate::contract::{Block64, FrameHeader};
use crate::error::IpcError;
use crate::iceoryx::{Iceoryx, contract_attribute, service_name};
use crate::name::CameraName;
use crate::plan::Limits;
use crate::recovery::CreationLock;
use crate::service::{TopicService, WakeService, open_topic, publisher_of, refuse_other_contract};

/// A queue and the history hold one frame: the newest wins.
const QUEUE_FRAMES: usize = 1;

/// Processes that may have a service open besides its readers: the publisher, the next publisher, tools, and
/// dead ones that were not cleaned up yet.
const SPARE_NODES: usize = 12;

/// Listeners of one camera. Not part of [`Limits`], because a camera and a daemon share the event service,
/// and the first of them creates it.
const MAX_LISTENERS: usize = 64;

/// The publisher of `rgb`, that of `attitude`, the publisher of the rest, and dead ones that were not cleaned
/// up yet.
const MAX_NOTIFIERS: usize = 8;

/// Opens or creates a topic's service, as its publisher.
///
/// A service may be in the way for three reasons, and each has its own remedy: half of one that a killed
/// process left behind is removed first (`repair`); one that its last user marked but could not remove is
/// removed when iceoryx2 reports it (`remove_marked`), then creation is tried once more; one that readers of
/// an earlier publisher keep open is taken over if its limits are the same, and is an error otherwise.
/// iceoryx2 checks limits only as minimums when it opens a service, so they are compared here once more.
pub(crate) fn create_topic(
    lock: &CreationLock,
    node: &Node<Iceoryx>,
    camera: &CameraName,
    topic: Topic,
    limits: &Limits,
) -> Result<TopicService, IpcError> {
    use PublishSubscribeOpenOrCreateError as E;
    let name = camera.service(topic);
    lock.repair(node, &name, MessagingPattern::PublishSubscribe)?;
    refuse_other_contract(&name, MessagingPattern::PublishSubscribe)?;
    let (service_name, attribute) = (service_name(&name)?, contract_attribute()?);
    let create = || {
        node.service_builder(&service_name)
            .publish_subscribe::<[Block64]>()
            .user_header::<FrameHeader>()
            .max_publishers(1)
            .max_subscribers(limits.readers_of(topic))
            .max_nodes(limits.readers_of(topic) + SPARE_NODES)
            .subscriber_max_borrowed_samples(limits.max_held_frames)
            .subscriber_max_buffer_size(QUEUE_FRAMES)
            .history_size(QUEUE_FRAMES)
            .enable_safe_overflow(true)
            .open_or_create_with_attributes(&attribute)
    };
    let created = match create() {
        Err(E::PublishSubscribeOpenError(PublishSubscribeOpenError::IsMarkedForDestruction)) => {
            lock.remove_marked(node, &name, MessagingPattern::PublishSubscribe)?;
            create()
        }
        created => created,
    };
    let service = created.map_err(|cause| {
        if asks_for_more(&cause) {
            return other_limits(node, camera, topic);
        }
        IpcError::iceoryx(format!("create service `{name}`"), cause)
    })?;
    let existing = service.static_config();
    let same_limits = existing.max_subscribers() == limits.readers_of(topic)
        && existing.subscriber_max_borrowed_samples() == limits.max_held_frames
        && existing.subscriber_max_buffer_size() == QUEUE_FRAMES
        && existing.max_publishers() == 1;
    if same_limits { Ok(service) } else { Err(other_limits(node, camera, topic)) }
}

/// Whether a service exists and has room for less than asked for.
fn asks_for_more(cause: &PublishSubscribeOpenOrCreateError) -> bool {
    use PublishSubscribeOpenError as E;
    matches!(
        cause,
        PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
            E::DoesNotSupportRequestedAmountOfSubscribers
                | E::DoesNotSupportRequestedAmountOfNodes
                | E::DoesNotSupportRequestedMinSubscriberBorrowedSamples
        )
    )
}

/// Why a service with other limits is in the way. If a living process publishes the camera, the error names
/// it.
fn other_limits(node: &Node<Iceoryx>, camera: &CameraName, topic: Topic) -> IpcError {
    let service = open_topic(node, camera, topic).ok().flatten();
    match service.as_ref().and_then(publisher_of).filter(|publisher| publisher.alive) {
        Some(publisher) => IpcError::AlreadyPublished { camera: camera.clone(), topic, publisher },
        None => IpcError::OtherLimits { service: camera.service(topic) },
    }
}

/// Opens or creates the camera's event service, as a publisher.
pub(crate) fn create_wake(
    lock: &CreationLock,
    node: &Node<Iceoryx>,
    camera: &CameraName,
) -> Result<WakeService, IpcError> {
    let name = camera.wake_service();
    lock.repair(node, &name, MessagingPattern::Event)?;
    refuse_other_contract(&name, MessagingPattern::Event)?;
    let id = |wake: Wake| EventId::new(wake as usize);
    let (service_name, attribute) = (service_name(&name)?, contract_attribute()?);
    let create = || {
        node.service_builder(&service_name)
            .event()
            .max_listeners(MAX_LISTENERS)
            .max_notifiers(MAX_NOTIFIERS)
            .max_nodes(MAX_LISTENERS + SPARE_NODES)
            .event_id_max_value(Wake::ALL.len() - 1)
            .notifier_created_event(id(Wake::PublisherStarted))
            .notifier_dropped_event(id(Wake::PublisherClosed))
            .notifier_dead_event(id(Wake::PublisherDied))
            .open_or_create_with_attributes(&attribute)
    };
    let created = match create() {
        Err(EventOpenOrCreateError::EventOpenError(EventOpenError::IsMarkedForDestruction)) => {
            lock.remove_marked(node, &name, MessagingPattern::Event)?;
            create()
        }
        created => created,
    };
    created.map_err(|cause| IpcError::iceoryx(format!("create service `{name}`"), cause))
}
