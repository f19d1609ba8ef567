//! A participant of a DDS domain, its publishers and its subscribers.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::hash::{BuildHasher as _, RandomState};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use dust_dds::builtin_topics::{DCPS_PUBLICATION, PublicationBuiltinTopicData};
use dust_dds::dds_async::configuration::DustDdsConfigurationBuilder;
use dust_dds::dds_async::domain_participant_factory::DomainParticipantFactoryAsync;
use dust_dds::domain::domain_participant::DomainParticipant;
use dust_dds::domain::domain_participant_factory::DomainParticipantFactory;
use dust_dds::infrastructure::error::DdsError;
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::QosKind;
use dust_dds::infrastructure::sample_info::{ANY_SAMPLE_STATE, ANY_VIEW_STATE, InstanceStateKind};
use dust_dds::infrastructure::status::NO_STATUS;
use dust_dds::publication::data_writer::DataWriter;
use dust_dds::publication::publisher::Publisher as DdsPublisher;
use dust_dds::subscription::data_reader::DataReader;
use dust_dds::subscription::subscriber::Subscriber as DdsSubscriber;
use dust_dds::topic_definition::topic::Topic as DdsTopic;
use tracing::{debug, info, warn};

use super::failed::failed;
use super::health::{LibraryState, Watched};
use super::nodes::{self, Identifier, Nodes};
use super::peers::Peers;
use super::qos::{reader_qos, writer_qos};
use super::raw_message::RawMessage;
use super::subscriber::TopicSubscriber;
use super::transport::{Shared, UdpTransport};
use crate::environment::{DiscoveryRange, Environment};
use crate::error::Ros2Error;
use crate::link::{Delivery, Endpoint, Link, MessagePublisher, MessageSubscriber};
use crate::message_type::MessageType;
use crate::name::{dds_type, ros_type};
use crate::static_peer::StaticPeer;

/// How often the participant announces itself.
const ANNOUNCEMENT_PERIOD: Duration = Duration::from_secs(1);
/// The most time that leaving may take.
const MAX_LEAVING: Duration = Duration::from_secs(5);
/// Announcements of nodes that may be unconfirmed. The last one counts, but each camera announces its node,
/// and a peer may not have confirmed the one before.
const MAX_ANNOUNCEMENTS: u32 = 16;
/// The bytes before the fields of a message.
const ENCAPSULATION_BYTES: usize = 4;
/// Publishers of other nodes that are looked at.
const MAX_PUBLICATIONS: i32 = 10_000;

/// A new connection to the domain of `environment`.
pub(crate) fn alone(environment: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
    Ok(Arc::new(DdsLink::open(environment)?))
}

/// The connection of this process to the domain of `environment`; it is opened if there is none.
pub(crate) fn shared(environment: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
    static LINKS: Mutex<BTreeMap<u16, Weak<DdsLink>>> = Mutex::new(BTreeMap::new());
    let mut links = LINKS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(link) = links.get(&environment.domain).and_then(Weak::upgrade) {
        return Ok(link);
    }
    let link = Arc::new(DdsLink::open(environment)?);
    links.insert(environment.domain, Arc::downgrade(&link));
    Ok(link)
}

/// A participant of a DDS domain.
struct DdsLink {
    participant: DomainParticipant,
    publisher: DdsPublisher,
    subscriber: DdsSubscriber,
    /// Of the publishers of other nodes.
    publications: DataReader<PublicationBuiltinTopicData>,
    announcer: DataWriter<RawMessage>,
    state: Arc<Mutex<Participation>>,
    factory: Arc<DomainParticipantFactory<UdpTransport>>,
    shared: Shared,
}

#[derive(Default)]
struct Participation {
    /// By their full names: cameras share some.
    topics: HashMap<String, (MessageType, DdsTopic)>,
    nodes: Nodes,
}

impl DdsLink {
    /// Joins the domain of `environment`.
    fn open(environment: &Environment) -> Result<Self, Ros2Error> {
        let domain = environment.domain;
        if environment.range == DiscoveryRange::Off {
            warn!("ROS_AUTOMATIC_DISCOVERY_RANGE is OFF: only nodes that look for this one find it");
        }
        let peers = environment.static_peers.iter().map(StaticPeer::addresses);
        let peers = peers.collect::<Result<Vec<_>, _>>()?.concat();
        let transport = UdpTransport::open(environment, &peers);
        let transport = transport.map_err(|source| Ros2Error::Network { domain, source })?;
        let shared = transport.shared();
        let factory = Arc::new(factory(transport)?);
        let participant = factory.create_participant(domain.into(), QosKind::Default, NO_LISTENER, NO_STATUS);
        let participant = participant.map_err(failed("join the ROS 2 domain"))?;
        let publisher = participant.create_publisher(QosKind::Default, NO_LISTENER, NO_STATUS);
        let publisher = publisher.map_err(failed("make a publisher"))?;
        let subscriber = participant.create_subscriber(QosKind::Default, NO_LISTENER, NO_STATUS);
        let subscriber = subscriber.map_err(failed("make a subscriber"))?;
        let publications = participant.get_builtin_subscriber().lookup_datareader(DCPS_PUBLICATION);
        let publications = publications.and_then(|reader| reader.ok_or(DdsError::Unsupported));
        let publications = publications.map_err(failed("list publishers"))?;
        let topic = new_topic(&participant, nodes::TOPIC, nodes::TYPE)?;
        let qos = writer_qos(Delivery { depth: MAX_ANNOUNCEMENTS, is_kept: true }, nodes::TYPE_HASH);
        let announcer = publisher.create_datawriter(&topic, QosKind::Specific(qos), NO_LISTENER, NO_STATUS);
        let announcer = announcer.map_err(failed("make a publisher"))?;
        info!("ROS 2 over DDS in domain {domain}");
        let state = Arc::default();
        Ok(Self { participant, publisher, subscriber, publications, announcer, state, factory, shared })
    }

    /// The topic of an endpoint. A topic without users can get another type.
    fn topic(&self, state: &mut Participation, endpoint: &Endpoint<'_>) -> Result<DdsTopic, Ros2Error> {
        let Endpoint { topic: name, message_type } = *endpoint;
        match state.topics.get(name) {
            Some((known, topic)) if *known == message_type => return Ok(topic.clone()),
            Some((_, topic)) => {
                self.participant.delete_topic(topic).map_err(failed("change the type of a topic"))?;
            }
            None => {}
        }
        let topic = new_topic(&self.participant, &dds_name(name), &dds_type(message_type.name()))?;
        state.topics.insert(name.to_owned(), (message_type, topic.clone()));
        Ok(topic)
    }
}

fn lock(state: &Mutex<Participation>) -> MutexGuard<'_, Participation> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
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
    let runtime = Watched::new(transport.shared().health);
    let shared = DomainParticipantFactoryAsync::new(runtime, process, host, transport, configuration);
    Ok(DomainParticipantFactory::new(Box::leak(Box::new(shared))))
}

impl Drop for DdsLink {
    /// Other nodes learn at once that this one leaves. The library may not answer.
    fn drop(&mut self) {
        if !self.shared.health.has_ended() {
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
        self.shared.ended.store(true, Ordering::Relaxed);
    }
}

impl Link for DdsLink {
    fn publisher(
        &self,
        node: &str,
        endpoint: &Endpoint<'_>,
        delivery: Delivery,
    ) -> Result<Box<dyn MessagePublisher>, Ros2Error> {
        self.shared.health.check("make a publisher")?;
        let mut state = lock(&self.state);
        let topic = self.topic(&mut state, endpoint)?;
        let qos = QosKind::Specific(writer_qos(delivery, endpoint.message_type.hash()));
        let writer = self.publisher.create_datawriter::<RawMessage>(&topic, qos, NO_LISTENER, NO_STATUS);
        let writer = writer.map_err(failed("make a publisher"))?;
        state.nodes.add_writer(node, writer.get_instance_handle().into());
        let Shared { peers, health, .. } = self.shared.clone();
        Ok(Box::new(TopicPublisher { writer, peers, health, known: AtomicUsize::new(0) }))
    }

    fn subscriber(
        &self,
        node: &str,
        endpoint: &Endpoint<'_>,
    ) -> Result<Box<dyn MessageSubscriber>, Ros2Error> {
        self.shared.health.check("make a subscriber")?;
        let mut state = lock(&self.state);
        let topic = self.topic(&mut state, endpoint)?;
        let qos = QosKind::Specific(reader_qos(endpoint.message_type.hash()));
        let reader = self.subscriber.create_datareader::<RawMessage>(&topic, qos, NO_LISTENER, NO_STATUS);
        let reader = reader.map_err(failed("make a subscriber"))?;
        let identifier = reader.get_instance_handle().into();
        state.nodes.add_reader(node, identifier);
        let all = Arc::clone(&self.state);
        let Shared { inboxes, peers, health, .. } = self.shared.clone();
        Ok(Box::new(TopicSubscriber {
            subscriber: self.subscriber.clone(),
            reader,
            inbox: inboxes.add(),
            peers,
            health,
            on_end: Box::new(move || lock(&all).nodes.remove_reader(identifier)),
        }))
    }

    /// Without those of participants that are lost: the library lists them for minutes.
    fn published_types(&self, topic: &str) -> Result<Vec<String>, Ros2Error> {
        self.shared.health.check("list publishers")?;
        let name = dds_name(topic);
        let alive = &[InstanceStateKind::Alive];
        let samples = match self.publications.read(MAX_PUBLICATIONS, ANY_SAMPLE_STATE, ANY_VIEW_STATE, alive)
        {
            Err(DdsError::NoData) => Vec::new(),
            samples => samples.map_err(failed("list publishers"))?,
        };
        let publications = samples.iter().filter_map(|sample| sample.data.as_ref());
        // By multicast, this participant receives its own announcements too.
        let own: Identifier = self.participant.get_instance_handle().into();
        let (peers, now) = (&self.shared.peers, Instant::now());
        let is_there = |writer: Identifier| {
            let participant = writer.first_chunk::<12>();
            participant != own.first_chunk() && participant.is_some_and(|prefix| !peers.is_lost(*prefix, now))
        };
        let of_others = publications.filter(|publication| is_there(publication.key().value));
        let named = of_others.filter(|publication| publication.topic_name() == name);
        let types: BTreeSet<_> = named.map(|publication| ros_type(publication.get_type_name())).collect();
        Ok(types.into_iter().collect())
    }

    fn announce_nodes(&self) -> Result<(), Ros2Error> {
        const ACTION: &str = "announce the node";
        self.shared.health.check(ACTION)?;
        let message = lock(&self.state).nodes.message(self.participant.get_instance_handle().into());
        let message = message.map_err(|reason| Ros2Error::Middleware { action: ACTION, reason })?;
        self.announcer.write(raw(&message), None).map_err(failed(ACTION))
    }

    fn problem(&self) -> Option<String> {
        self.shared.health.has_ended().then(|| "ROS 2 over DDS has ended".to_owned())
    }
}

/// `/front/scan` as DDS names it: `rt/front/scan`.
fn dds_name(topic: &str) -> String {
    format!("rt{topic}")
}

fn new_topic(participant: &DomainParticipant, name: &str, type_name: &str) -> Result<DdsTopic, Ros2Error> {
    let topic =
        participant.create_topic::<RawMessage>(name, type_name, QosKind::Default, NO_LISTENER, NO_STATUS);
    topic.map_err(failed("make a topic"))
}

fn raw(message: &[u8]) -> RawMessage {
    RawMessage(message.get(ENCAPSULATION_BYTES..).unwrap_or_default().to_vec())
}

struct TopicPublisher {
    writer: DataWriter<RawMessage>,
    peers: Arc<Peers>,
    health: Arc<LibraryState>,
    /// How many subscribers there were when they were last counted.
    known: AtomicUsize,
}

impl MessagePublisher for TopicPublisher {
    /// Those that answer: the library counts the dead for minutes. Once the library has ended, the last ones:
    /// they wait for messages, which count as not taken.
    fn subscribers(&self) -> usize {
        if self.health.has_ended() {
            return self.known.load(Ordering::Relaxed);
        }
        let (matched, now) = (self.writer.get_matched_subscriptions().unwrap_or_default(), Instant::now());
        let answers = |reader: Identifier| {
            reader.first_chunk().is_some_and(|participant| !self.peers.is_silent(*participant, now))
        };
        let count = matched.into_iter().filter(|reader| answers((*reader).into())).count();
        self.known.store(count, Ordering::Relaxed);
        count
    }

    fn send(&self, message: &[u8]) -> bool {
        !self.health.has_ended() && self.writer.write(raw(message), None).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};

    use super::super::addresses::{MAX_PARTICIPANTS, discovery_port};
    use super::super::rtps::tests::heartbeat;
    use super::super::sending::MAX_DATAGRAM_BYTES;
    use super::*;

    const TIMEOUT: Duration = Duration::from_secs(60);

    /// Its own announcement is sent back to it, as by multicast.
    #[test]
    fn a_participant_that_finds_itself_is_no_other_node() {
        let (domain, range) = (84, DiscoveryRange::Localhost);
        let mirror =
            UdpSocket::bind((Ipv4Addr::LOCALHOST, discovery_port(domain, MAX_PARTICIPANTS - 1))).unwrap();
        mirror.set_read_timeout(Some(TIMEOUT)).unwrap();
        let link = DdsLink::open(&Environment { domain, range, ..Environment::default() }).unwrap();
        let endpoint = Endpoint { topic: "/front/scan", message_type: MessageType::LaserScan };
        let delivery = Delivery { depth: 1, is_kept: false };
        let _publisher = link.publisher("nunetd_front", &endpoint, delivery).unwrap();
        let has_found_itself = || {
            let alive = &[InstanceStateKind::Alive];
            let found = link.publications.read(MAX_PUBLICATIONS, ANY_SAMPLE_STATE, ANY_VIEW_STATE, alive);
            let found = found.unwrap_or_default();
            let mut found = found.iter().filter_map(|sample| sample.data.as_ref());
            found.any(|publication| publication.topic_name() == dds_name(endpoint.topic))
        };
        let (start, mut buffer) = (Instant::now(), vec![0; MAX_DATAGRAM_BYTES]);
        while !has_found_itself() {
            assert!(start.elapsed() < TIMEOUT, "it does not find itself");
            let (length, from) = mirror.recv_from(&mut buffer).unwrap();
            mirror.send_to(&buffer[..length], from).unwrap();
        }
        assert_eq!(link.published_types(endpoint.topic).unwrap(), Vec::<String>::new());
    }

    #[test]
    fn types_of_a_participant_that_is_lost_are_not_listed() {
        const TO: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 7411);
        let range = DiscoveryRange::Localhost;
        let environment = Environment { domain: 85, range, ..Environment::default() };
        let [ours, theirs] = [(); 2].map(|()| DdsLink::open(&environment).unwrap());
        let endpoint = Endpoint { topic: "/front/scan", message_type: MessageType::LaserScan };
        let _publisher =
            theirs.publisher("talker", &endpoint, Delivery { depth: 1, is_kept: false }).unwrap();
        let start = Instant::now();
        while ours.published_types(endpoint.topic).unwrap().is_empty() {
            assert!(start.elapsed() < TIMEOUT, "the publisher is not found");
            std::thread::yield_now();
        }
        let identifier: Identifier = theirs.participant.get_instance_handle().into();
        let question = heartbeat(*identifier.first_chunk().unwrap(), [0, 0, 4, 0xc7, 0, 0, 4, 0xc2], 1);
        while !ours.published_types(endpoint.topic).unwrap().is_empty() {
            assert!(start.elapsed() < TIMEOUT, "it is listed though it does not answer");
            // Again, because it is heard in between.
            let long_ago = Instant::now().checked_sub(Duration::from_secs(10)).unwrap();
            ours.shared.peers.outgoing(&question, TO, long_ago);
        }
    }

    #[test]
    fn once_the_library_has_ended_messages_for_its_subscribers_are_not_taken_and_the_problem_is_stated() {
        let range = DiscoveryRange::Localhost;
        let environment = Environment { domain: 87, range, ..Environment::default() };
        let [ours, theirs] = [(); 2].map(|()| DdsLink::open(&environment).unwrap());
        let endpoint = Endpoint { topic: "/front/scan", message_type: MessageType::LaserScan };
        let delivery = Delivery { depth: 1, is_kept: false };
        let publisher = ours.publisher("nunetd_front", &endpoint, delivery).unwrap();
        let _subscriber = theirs.subscriber("reader", &endpoint).unwrap();
        let start = Instant::now();
        while publisher.subscribers() == 0 {
            assert!(start.elapsed() < TIMEOUT, "the subscriber is not found");
            std::thread::yield_now();
        }
        assert!(publisher.send(&[0; 8]) && ours.problem().is_none());
        ours.shared.health.end("a test");
        assert_eq!((publisher.subscribers(), publisher.send(&[0; 8])), (1, false));
        assert_eq!(ours.problem().as_deref(), Some("ROS 2 over DDS has ended"));
    }
}
