//! The services of a camera, and how to open them.

use std::path::Path;

use iceoryx2::node::{Node, NodeState};
use iceoryx2::prelude::{CallbackProgression, MessagingPattern, Service};
use iceoryx2::service::ServiceDetailsError;
use iceoryx2::service::builder::event::EventOpenError;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::{PortFactory as _, event, publish_subscribe};
use nunet_types::Topic;

use crate::contract::{Block64, FrameHeader};
use crate::error::IpcError;
use crate::iceoryx::{Iceoryx, check_contract, config, contract_attribute, service_name};
use crate::name::CameraName;
use crate::process::Process;

pub(crate) type TopicService = publish_subscribe::PortFactory<Iceoryx, [Block64], FrameHeader>;
pub(crate) type WakeService = event::PortFactory<Iceoryx>;

// Two enumerations of iceoryx2 with the same names: a service that is absent, is being created, is incomplete
// until its publisher repairs it, or belongs to another user who has not shared it with the group yet. Each
// may change any moment.
macro_rules! not_there_yet {
    ($error:ident) => {
        $error::DoesNotExist
            | $error::IsMarkedForDestruction
            | $error::HangsInCreation
            | $error::ServiceInCorruptedState
            | $error::InsufficientPermissions
    };
}

/// Opens a topic's service as a reader; `None` while there is none that can be opened.
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

/// Opens the camera's event service as a reader; `None` while there is none that can be opened.
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

/// Reads the attributes before opening: a service of another version may have other types, and opening it
/// would fail without the reason. Returns whether they could be read: those of another user cannot until that
/// user shares them.
pub(crate) fn refuse_other_contract(name: &str, pattern: MessagingPattern) -> Result<bool, IpcError> {
    match Iceoryx::details(&service_name(name)?, config(), pattern) {
        Ok(Some(details)) => check_contract(name, details.static_details.attributes()).map(|()| true),
        Ok(None) => Ok(true),
        Err(ServiceDetailsError::InsufficientPermissions) => Ok(false),
        Err(cause) => Err(IpcError::iceoryx(format!("read the attributes of service `{name}`"), cause)),
    }
}

/// Whether a service exists with all its parts and may be read. It only checks files. To wait for a service,
/// check first whether there is a file at [`record_of`](crate::iceoryx::record_of), which takes one system
/// call.
pub(crate) fn is_complete(name: &str, pattern: MessagingPattern) -> Result<bool, IpcError> {
    match Iceoryx::details(&service_name(name)?, config(), pattern) {
        Ok(Some(details)) => {
            check_contract(name, details.static_details.attributes())?;
            Ok(details.dynamic_details.is_some())
        }
        Ok(None)
        | Err(
            ServiceDetailsError::InsufficientPermissions
            | ServiceDetailsError::FailedToDeserializeStaticServiceInfo
            | ServiceDetailsError::ServiceInInconsistentState,
        ) => Ok(false),
        Err(cause) => Err(IpcError::iceoryx(format!("read the attributes of service `{name}`"), cause)),
    }
}

/// The process that publishes on a service.
pub(crate) fn publisher_of(service: &TopicService) -> Option<Process> {
    let mut node_id = None;
    service.dynamic_config().list_publishers(|publisher| {
        node_id = Some(publisher.node_id);
        CallbackProgression::Stop
    });
    let node_id = node_id?;
    let pid = node_id.pid::<Iceoryx>().map_or(0, |pid| pid.value().cast_unsigned());
    let mut alive = false;
    // A listing that fails halfway reports the publisher as dead: it could not be found.
    let _ = service.nodes(|node| {
        alive |= *node.node_id() == node_id
            && match &node {
                NodeState::Alive(_) => true,
                // Whether another user's process is alive cannot be read from iceoryx2's files.
                NodeState::Inaccessible(_) => Path::new("/proc").join(pid.to_string()).exists(),
                _ => false,
            };
        CallbackProgression::Continue
    });
    Some(Process { pid, alive })
}
