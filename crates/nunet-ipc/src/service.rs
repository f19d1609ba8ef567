//! The services of a camera: how owners create them and readers open them.

use std::path::Path;

use iceoryx2::node::{Node, NodeState};
use iceoryx2::port::event_id::EventId;
use iceoryx2::prelude::{CallbackProgression, MessagingPattern, Service};
use iceoryx2::service::ServiceDetailsError;
use iceoryx2::service::builder::event::{EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::{PortFactory, event, publish_subscribe};

use crate::block::Block64;
use crate::error::IpcError;
use crate::header::FrameHeader;
use crate::mend::Turn;
use crate::name::CameraName;
use crate::node::{Iceoryx, Process, check_contract, config, contract_attribute, service_name};
use crate::plan::Limits;
use nunet_types::{Topic, Wake};

pub(crate) type TopicService = publish_subscribe::PortFactory<Iceoryx, [Block64], FrameHeader>;
pub(crate) type WakeService = event::PortFactory<Iceoryx>;

/// The newest frame is all that a queue or a late joiner gets: the latest frame wins.
const QUEUE_FRAMES: usize = 1;

/// Processes that may have a service open besides its readers: the owner, the next owner, tools, and some that died
/// and were not cleaned up yet.
const SPARE_NODES: usize = 12;

/// Listeners of one camera. Not a matter of [`Limits`], because a camera and a daemon share the event service and
/// whoever comes first creates it.
const MAX_LISTENERS: usize = 64;

/// The owner of `rgb`, the owner of the rest, and dead ones that were not cleaned up yet.
const MAX_NOTIFIERS: usize = 8;

/// Opens or creates a topic's service, as its owner.
pub(crate) fn create_topic(
    turn: &Turn,
    node: &Node<Iceoryx>,
    camera: &CameraName,
    topic: Topic,
    limits: &Limits,
) -> Result<TopicService, IpcError> {
    use PublishSubscribeOpenOrCreateError as E;
    let name = camera.service(topic);
    turn.mend(node, &name, MessagingPattern::PublishSubscribe)?;
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
            turn.bury(node, &name, MessagingPattern::PublishSubscribe)?;
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
    let same = existing.max_subscribers() == limits.readers_of(topic)
        && existing.subscriber_max_borrowed_samples() == limits.max_held_frames
        && existing.subscriber_max_buffer_size() == QUEUE_FRAMES
        && existing.max_publishers() == 1;
    if same { Ok(service) } else { Err(other_limits(node, camera, topic)) }
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

/// Why a service of other limits is in the way. Whoever asks for a camera that is published should hear of its owner,
/// whatever the limits.
fn other_limits(node: &Node<Iceoryx>, camera: &CameraName, topic: Topic) -> IpcError {
    let service = open_topic(node, camera, topic).ok().flatten();
    match service.as_ref().and_then(owner_of).filter(|owner| owner.alive) {
        Some(owner) => IpcError::AlreadyOwned { camera: camera.clone(), topic, owner },
        None => IpcError::OtherLimits { service: camera.service(topic) },
    }
}

/// Opens or creates the camera's event service, as an owner.
pub(crate) fn create_wake(
    turn: &Turn,
    node: &Node<Iceoryx>,
    camera: &CameraName,
) -> Result<WakeService, IpcError> {
    let name = camera.wake_service();
    turn.mend(node, &name, MessagingPattern::Event)?;
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
            .notifier_created_event(id(Wake::OwnerCame))
            .notifier_dropped_event(id(Wake::OwnerLeft))
            .notifier_dead_event(id(Wake::OwnerDied))
            .open_or_create_with_attributes(&attribute)
    };
    let created = match create() {
        Err(EventOpenOrCreateError::EventOpenError(EventOpenError::IsMarkedForDestruction)) => {
            turn.bury(node, &name, MessagingPattern::Event)?;
            create()
        }
        created => created,
    };
    created.map_err(|cause| IpcError::iceoryx(format!("create service `{name}`"), cause))
}

// Two enumerations of iceoryx2's with the same names: a service that is not there, is being made, is half of one that its
// owner will mend, or is another user's who has not let the group in. All of that may be otherwise a moment later.
macro_rules! not_there_yet {
    ($error:ident) => {
        $error::DoesNotExist
            | $error::IsMarkedForDestruction
            | $error::HangsInCreation
            | $error::ServiceInCorruptedState
            | $error::InsufficientPermissions
    };
}

/// Opens a topic's service as a reader; `None` while there is none.
pub(crate) fn open_topic(
    node: &Node<Iceoryx>,
    camera: &CameraName,
    topic: Topic,
) -> Result<Option<TopicService>, IpcError> {
    let name = camera.service(topic);
    if !refuse_other_contract(&name, MessagingPattern::PublishSubscribe)? {
        return Ok(None);
    }
    let opened = node
        .service_builder(&service_name(&name)?)
        .publish_subscribe::<[Block64]>()
        .user_header::<FrameHeader>()
        .open_with_attributes(&contract_attribute()?);
    match opened {
        Ok(service) => Ok(Some(service)),
        Err(not_there_yet!(PublishSubscribeOpenError)) => Ok(None),
        Err(cause) => Err(IpcError::iceoryx(format!("open service `{name}`"), cause)),
    }
}

/// Opens the camera's event service as a reader; `None` while there is none.
pub(crate) fn open_wake(node: &Node<Iceoryx>, camera: &CameraName) -> Result<Option<WakeService>, IpcError> {
    let name = camera.wake_service();
    if !refuse_other_contract(&name, MessagingPattern::Event)? {
        return Ok(None);
    }
    match node.service_builder(&service_name(&name)?).event().open_with_attributes(&contract_attribute()?) {
        Ok(service) => Ok(Some(service)),
        Err(not_there_yet!(EventOpenError)) => Ok(None),
        Err(cause) => Err(IpcError::iceoryx(format!("open service `{name}`"), cause)),
    }
}

/// Reads the attributes before opening: a service of another version may have other types, and then opening it
/// would fail before anything could be said about the reason. Says whether they could be read: a service of another user
/// cannot until its owner lets the group in.
fn refuse_other_contract(name: &str, pattern: MessagingPattern) -> Result<bool, IpcError> {
    match Iceoryx::details(&service_name(name)?, config(), pattern) {
        Ok(Some(details)) => check_contract(name, details.static_details.attributes()).map(|()| true),
        Ok(None) => Ok(true),
        Err(ServiceDetailsError::InsufficientPermissions) => Ok(false),
        Err(cause) => Err(IpcError::iceoryx(format!("look at service `{name}`"), cause)),
    }
}

/// Who publishes on a service.
pub(crate) fn owner_of(service: &TopicService) -> Option<Process> {
    let mut owner = None;
    service.dynamic_config().list_publishers(|publisher| {
        owner = Some(publisher.node_id);
        CallbackProgression::Stop
    });
    let owner = owner?;
    let pid = owner.pid::<Iceoryx>().map_or(0, |pid| pid.value().cast_unsigned());
    let mut alive = false;
    // A listing that fails part of the way leaves the owner dead: it could not be found.
    let _ = service.nodes(|node| {
        alive |= *node.node_id() == owner
            && match &node {
                NodeState::Alive(_) => true,
                // Another user's signs of life are not for us to see.
                NodeState::Inaccessible(_) => Path::new("/proc").join(pid.to_string()).exists(),
                _ => false,
            };
        CallbackProgression::Continue
    });
    Some(Process { pid, alive })
}
