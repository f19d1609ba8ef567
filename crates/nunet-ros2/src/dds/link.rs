//! A participant of a DDS domain, and its publishers.

use std::collections::{BTreeMap, HashMap};
use std::hash::{BuildHasher as _, RandomState};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use dust_dds::dds_async::configuration::DustDdsConfigurationBuilder;
use dust_dds::dds_async::domain_participant_factory::DomainParticipantFactoryAsync;
use dust_dds::domain::domain_participant::DomainParticipant;
use dust_dds::domain::domain_participant_factory::DomainParticipantFactory;
use dust_dds::infrastructure::error::DdsError;
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::{DataWriterQos, QosKind};
use dust_dds::infrastructure::qos_policy::{
    DurabilityQosPolicy, DurabilityQosPolicyKind, HistoryQosPolicy, HistoryQosPolicyKind,
    ReliabilityQosPolicy, ReliabilityQosPolicyKind, UserDataQosPolicy,
};
use dust_dds::infrastructure::status::NO_STATUS;
use dust_dds::infrastructure::time::{Duration as DdsDuration, DurationKind};
use dust_dds::publication::data_writer::DataWriter;
use dust_dds::publication::publisher::Publisher as DdsPublisher;
use dust_dds::topic_definition::topic::Topic as DdsTopic;
use nunet_mcap::ros::encode;
use serde::Serialize;
use tracing::{debug, info, warn};

use super::health::{Health, Watched};
use super::peers::Peers;
use super::raw_message::RawMessage;
use super::transport::UdpTransport;
use crate::environment::{DiscoveryRange, Environment};
use crate::error::Ros2Error;
use crate::link::{Link, Publisher};
use crate::topic::{Delivery, Topic};

/// How often the participant announces itself.
const ANNOUNCEMENT_PERIOD: Duration = Duration::from_secs(1);
/// The most time that leaving may take.
const MAX_LEAVING: Duration = Duration::from_secs(5);
/// How long a message waits for room while confirmations are on their way.
const WAIT_FOR_ROOM: DdsDuration = DdsDuration::new(0, 5_000_000);
/// The bytes before the fields of a message.
const ENCAPSULATION_BYTES: usize = 4;

/// The topic by which ROS 2 learns which node has which publishers.
const NODES_TOPIC: &str = "ros_discovery_info";
const NODES_TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";
const NODES_HASH: &str = "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e";

/// A participant of a DDS domain.
pub(crate) struct DdsLink {
    participant: DomainParticipant,
    publisher: DdsPublisher,
    nodes: DataWriter<RawMessage>,
    state: Mutex<State>,
    factory: Arc<DomainParticipantFactory<UdpTransport>>,
    transport_ended: Arc<AtomicBool>,
    peers: Arc<Peers>,
    health: Arc<Health>,
}

#[derive(Default)]
struct State {
    /// By their full names: cameras share some.
    topics: HashMap<String, DdsTopic>,
    /// The identifiers of the publishers of each camera.
    writers: BTreeMap<String, Vec<Identifier>>,
}

type Identifier = [u8; 16];

impl DdsLink {
    /// Joins the domain of `environment`.
    pub(crate) fn open(environment: &Environment) -> Result<Self, Ros2Error> {
        let domain = environment.domain;
        if environment.range == DiscoveryRange::Off {
            warn!("ROS_AUTOMATIC_DISCOVERY_RANGE is OFF: only nodes that look for this one find it");
        }
        let transport = UdpTransport::open(environment);
        let transport = transport.map_err(|source| Ros2Error::Network { domain, source })?;
        let (transport_ended, peers, health) = (transport.ended(), transport.peers(), transport.health());
        let factory = Arc::new(factory(transport)?);
        let participant = factory.create_participant(domain.into(), QosKind::Default, NO_LISTENER, NO_STATUS);
        let participant = participant.map_err(failed("join the ROS 2 domain"))?;
        let publisher = participant.create_publisher(QosKind::Default, NO_LISTENER, NO_STATUS);
        let publisher = publisher.map_err(failed("make a publisher"))?;
        let topic = new_topic(&participant, NODES_TOPIC, NODES_TYPE)?;
        let nodes = new_writer(&publisher, &topic, Delivery { depth: 1, is_kept: true }, NODES_HASH)?;
        info!("ROS 2 over DDS in domain {domain}");
        let state = Mutex::default();
        Ok(Self { participant, publisher, nodes, state, factory, transport_ended, peers, health })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The factory lives as long as the process: the library lends it for ever. There is one per connection.
fn factory(transport: UdpTransport) -> Result<DomainParticipantFactory<UdpTransport>, Ros2Error> {
    let configuration = DustDdsConfigurationBuilder::new()
        .enable_type_information(false)
        .participant_announcement_interval(ANNOUNCEMENT_PERIOD)
        .build()
        .map_err(failed("configure DDS"))?;
    // Identifiers must differ between processes on all machines; in containers, process numbers do not.
    let random = RandomState::new().hash_one(std::process::id()).to_ne_bytes();
    let [a, b, c, d, e, f, g, h] = random;
    let (host, process) = ([a, b, c, d], [e, f, g, h]);
    let runtime = Watched::new(transport.health());
    let shared = DomainParticipantFactoryAsync::new(runtime, process, host, transport, configuration);
    Ok(DomainParticipantFactory::new(Box::leak(Box::new(shared))))
}

impl Drop for DdsLink {
    /// Other nodes learn at once that this one leaves. The library may not answer.
    fn drop(&mut self) {
        if !self.health.has_ended() {
            let (participant, factory, (left, leaving)) =
                (self.participant.clone(), Arc::clone(&self.factory), channel());
            let leave = move || {
                let deleted = participant.delete_contained_entities();
                left.send(deleted.and_then(|()| factory.delete_participant(&participant)))
            };
            let started = std::thread::Builder::new().name("dds end".to_owned()).spawn(leave);
            match started.map(|_| leaving.recv_timeout(MAX_LEAVING)) {
                Ok(Ok(Ok(()))) => {}
                Ok(Ok(Err(error))) => debug!("cannot leave the ROS 2 domain: {error}"),
                _ => {
                    warn!(
                        "other ROS 2 nodes may not know that this one has left: no answer from the library"
                    );
                }
            }
        }
        self.transport_ended.store(true, Ordering::Relaxed);
    }
}

impl Link for DdsLink {
    fn publisher(&self, camera: &str, topic: Topic) -> Result<Box<dyn Publisher>, Ros2Error> {
        let name = topic.of_camera(camera);
        let mut state = self.state();
        let dds_topic = match state.topics.get(&name) {
            Some(known) => known.clone(),
            None => new_topic(&self.participant, &format!("rt{name}"), &dds_type(topic.type_name()))?,
        };
        let writer = new_writer(&self.publisher, &dds_topic, topic.delivery(), topic.type_hash())?;
        state.topics.insert(name, dds_topic);
        state.writers.entry(camera.to_owned()).or_default().push(writer.get_instance_handle().into());
        Ok(Box::new(DdsWriter { writer, peers: Arc::clone(&self.peers), health: Arc::clone(&self.health) }))
    }

    fn announce_node(&self, _camera: &str) -> Result<(), Ros2Error> {
        let writers = self.state().writers.clone();
        let nodes = writers.into_iter().map(|(camera, writers)| NodeEntities {
            namespace: "/",
            name: format!("nunetd_{camera}"),
            readers: Vec::new(),
            writers,
        });
        let entities = ParticipantEntities {
            participant: self.participant.get_instance_handle().into(),
            nodes: nodes.collect(),
        };
        let mut message = Vec::new();
        encode(&entities, &mut message)
            .map_err(|reason| Ros2Error::Middleware { action: "announce the node", reason })?;
        self.nodes.write(raw(&message), None).map_err(failed("announce the node"))
    }
}

/// `sensor_msgs/msg/Image` as DDS names it: `sensor_msgs::msg::dds_::Image_`.
fn dds_type(type_name: &str) -> String {
    let (package, name) = type_name.rsplit_once('/').unwrap_or(("", type_name));
    format!("{}::dds_::{name}_", package.replace('/', "::"))
}

fn failed(action: &'static str) -> impl Fn(DdsError) -> Ros2Error {
    move |error| Ros2Error::Middleware { action, reason: error.to_string() }
}

fn new_topic(participant: &DomainParticipant, name: &str, type_name: &str) -> Result<DdsTopic, Ros2Error> {
    let topic =
        participant.create_topic::<RawMessage>(name, type_name, QosKind::Default, NO_LISTENER, NO_STATUS);
    topic.map_err(failed("make a topic"))
}

fn new_writer(
    publisher: &DdsPublisher,
    topic: &DdsTopic,
    delivery: Delivery,
    type_hash: &str,
) -> Result<DataWriter<RawMessage>, Ros2Error> {
    let durability = if delivery.is_kept {
        DurabilityQosPolicyKind::TransientLocal
    } else {
        DurabilityQosPolicyKind::Volatile
    };
    let qos = DataWriterQos {
        durability: DurabilityQosPolicy { kind: durability },
        reliability: ReliabilityQosPolicy {
            kind: ReliabilityQosPolicyKind::Reliable,
            max_blocking_time: DurationKind::Finite(WAIT_FOR_ROOM),
        },
        history: HistoryQosPolicy { kind: HistoryQosPolicyKind::KeepLast(delivery.depth) },
        // As rmw_fastrtps and rmw_cyclonedds state it.
        user_data: UserDataQosPolicy { value: format!("typehash={type_hash};").into_bytes() },
        ..DataWriterQos::default()
    };
    let writer =
        publisher.create_datawriter::<RawMessage>(topic, QosKind::Specific(qos), NO_LISTENER, NO_STATUS);
    writer.map_err(failed("make a publisher"))
}

fn raw(message: &[u8]) -> RawMessage {
    RawMessage(message.get(ENCAPSULATION_BYTES..).unwrap_or_default().to_vec())
}

struct DdsWriter {
    writer: DataWriter<RawMessage>,
    peers: Arc<Peers>,
    health: Arc<Health>,
}

impl Publisher for DdsWriter {
    /// Those that answer: the library counts the dead for minutes.
    fn subscribers(&self) -> usize {
        if self.health.has_ended() {
            return 0;
        }
        let (matched, now) = (self.writer.get_matched_subscriptions().unwrap_or_default(), Instant::now());
        let answers = |reader: Identifier| {
            reader.first_chunk().is_some_and(|participant| !self.peers.is_silent(*participant, now))
        };
        matched.into_iter().filter(|reader| answers((*reader).into())).count()
    }

    fn send(&self, message: &[u8]) -> bool {
        !self.health.has_ended() && self.writer.write(raw(message), None).is_ok()
    }
}

/// `rmw_dds_common/msg/ParticipantEntitiesInfo`
#[derive(Debug, Serialize)]
struct ParticipantEntities {
    participant: Identifier,
    nodes: Vec<NodeEntities>,
}

/// `rmw_dds_common/msg/NodeEntitiesInfo`
#[derive(Debug, Serialize)]
struct NodeEntities {
    namespace: &'static str,
    name: String,
    readers: Vec<Identifier>,
    writers: Vec<Identifier>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_named_as_dds_names_those_of_ros() {
        assert_eq!(dds_type("sensor_msgs/msg/Image"), "sensor_msgs::msg::dds_::Image_");
        assert_eq!(dds_type("tf2_msgs/msg/TFMessage"), "tf2_msgs::msg::dds_::TFMessage_");
    }
}
