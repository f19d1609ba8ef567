//! A session with its nodes, publishers and subscribers.

use std::collections::{BTreeMap, HashMap};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use tracing::{debug, info, warn};
use zenoh::liveliness::LivelinessToken;
use zenoh::{Config, Session, Wait as _};

use super::client::Client;
use super::config::{configuration, failed, is_client, router_place, routers};
use super::dropped::DropCounter;
use super::graph::RemotePublishers;
use super::keys::{Entity, TopicKey};
use super::place::RouterPlace;
use super::publisher::TopicPublisher;
use super::router::Router;
use super::subscriber::TopicSubscriber;
use crate::environment::Environment;
use crate::error::Ros2Error;
use crate::link::{Delivery, Endpoint, Link, MessagePublisher, MessageSubscriber};
use crate::link_name::LinkName;

/// The longest time that opening a session may take. Only settings such as `listen/timeout_ms=-1` wait.
const MAX_OPENING: Duration = Duration::from_secs(30);
/// The longest time that closing the session may take.
const MAX_LEAVING: Duration = Duration::from_secs(5);

/// A new session.
pub(crate) fn alone(name: &LinkName, environment: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
    Ok(Arc::new(ZenohLink::open(configuration(name, environment)?, environment)?))
}

/// The session of this process to these routers, by whichever name; it is opened if there is none.
pub(crate) fn shared(name: &LinkName, environment: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
    type Links = BTreeMap<(String, u16), Weak<ZenohLink>>;
    static LINKS: Mutex<Links> = Mutex::new(Links::new());
    let config = configuration(name, environment)?;
    // The name and the address of this machine are one router. [::1] may be another, which listens there
    // only.
    let key = (routers(&config).replace("/127.0.0.1:", "/localhost:"), environment.domain);
    let mut links = LINKS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(link) = links.get(&key).and_then(Weak::upgrade) {
        return Ok(link);
    }
    let link = Arc::new(ZenohLink::open(config, environment)?);
    links.insert(key, Arc::downgrade(&link));
    Ok(link)
}

/// A session of Zenoh.
struct ZenohLink {
    session: Session,
    /// What connects the session if it is in client mode; `None` once it is closed, too.
    client: Option<Client>,
    /// The name of the session, as tokens have it.
    name: String,
    domain: u16,
    state: Mutex<Graph>,
    router: Arc<Router>,
    drop_counter: DropCounter,
}

/// What this session has stated, and what it knows of others.
#[derive(Default)]
struct Graph {
    /// The numbers of nodes, which exist as long as their tokens.
    nodes: BTreeMap<String, (u64, LivelinessToken)>,
    /// Nodes, publishers and subscribers so far.
    entities: u64,
    /// The publishers of topics that something subscribes to.
    publishers: HashMap<String, Arc<RemotePublishers>>,
}

impl Graph {
    fn next_id(&mut self) -> u64 {
        self.entities += 1;
        self.entities - 1
    }
}

impl ZenohLink {
    fn open(config: Config, environment: &Environment) -> Result<Self, Ros2Error> {
        let (place, domain) = (router_place(&config), environment.domain);
        let (session, client) = if is_client(&config) {
            let (session, client) = Client::open(config)?;
            (session, Some(client))
        } else {
            (open_session(config)?, None)
        };
        match &place {
            None | Some(RouterPlace::Nowhere) => info!("ROS 2 over Zenoh in domain {domain}, no router"),
            Some(place) => info!("ROS 2 over Zenoh in domain {domain}, router {place}"),
        }
        let is_expected = environment.zenoh.router_check_attempts >= 0;
        let router = Arc::new(Router::new(place.filter(|_| is_expected)));
        let (name, drop_counter) = (session.zid().to_string(), DropCounter::new(&session));
        Ok(Self { name, session, client, domain, state: Mutex::default(), router, drop_counter })
    }

    fn lock(&self) -> MutexGuard<'_, Graph> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A new publisher or subscriber of `node`, which is stated to others if it is new.
    fn new_entity<'a>(&'a self, graph: &mut Graph, node: &'a str) -> Result<Entity<'a>, Ros2Error> {
        let unnumbered = Entity { domain: self.domain, session: &self.name, node, node_id: 0, id: 0 };
        let node_id = match graph.nodes.get(node) {
            Some((id, _)) => *id,
            None => {
                let id = graph.next_id();
                let token = Entity { node_id: id, id, ..unnumbered }.node_token();
                let token = self.session.liveliness().declare_token(token).wait();
                graph.nodes.insert(node.to_owned(), (id, token.map_err(failed("announce the node"))?));
                id
            }
        };
        Ok(Entity { node_id, id: graph.next_id(), ..unnumbered })
    }

    /// The publishers of a topic, followed from the first call on.
    fn publishers(&self, graph: &mut Graph, topic: &str) -> Result<Arc<RemotePublishers>, Ros2Error> {
        if let Some(known) = graph.publishers.get(topic) {
            return Ok(Arc::clone(known));
        }
        let followed = RemotePublishers::follow(&self.session, self.domain, topic);
        let publishers = Arc::new(followed.map_err(failed("list publishers"))?);
        graph.publishers.insert(topic.to_owned(), Arc::clone(&publishers));
        Ok(publishers)
    }
}

/// A session that connects in the background.
fn open_session(config: Config) -> Result<Session, Ros2Error> {
    const ACTION: &str = "open a Zenoh session";
    let (opened, opening) = channel();
    let open = move || opened.send(zenoh::open(config).wait());
    let started = std::thread::Builder::new().name("zenoh start".to_owned()).spawn(open);
    started.map_err(Ros2Error::Thread)?;
    match opening.recv_timeout(MAX_OPENING) {
        Ok(session) => session.map_err(failed(ACTION)),
        Err(_) => {
            let reason = format!("it waited {} s for an address, see `listen`", MAX_OPENING.as_secs());
            Err(Ros2Error::Middleware { action: ACTION, reason })
        }
    }
}

impl Drop for ZenohLink {
    /// Other nodes learn at once that this one leaves. The library waits for a peer that takes nothing.
    fn drop(&mut self) {
        let (session, client, (left, leaving)) = (self.session.clone(), self.client.take(), channel());
        let leave = move || {
            let closed = session.close().wait();
            left.send(closed.and(client.map_or(Ok(()), Client::close)))
        };
        let started = std::thread::Builder::new().name("zenoh end".to_owned()).spawn(leave);
        match started.map(|_| leaving.recv_timeout(MAX_LEAVING)) {
            Ok(Ok(Ok(()))) => {}
            Ok(Ok(Err(error))) => debug!("cannot close the Zenoh session: {error}"),
            _ => warn!("other ROS 2 nodes may not know that this one has left: a peer takes no messages"),
        }
    }
}

impl Link for ZenohLink {
    fn publisher(
        &self,
        node: &str,
        endpoint: &Endpoint<'_>,
        delivery: Delivery,
    ) -> Result<Box<dyn MessagePublisher>, Ros2Error> {
        let entity = self.new_entity(&mut self.lock(), node)?;
        let declared = TopicPublisher::declare(&self.session, &entity, &endpoint.into(), delivery);
        Ok(Box::new(declared.map_err(failed("make a publisher"))?))
    }

    fn subscriber(
        &self,
        node: &str,
        endpoint: &Endpoint<'_>,
    ) -> Result<Box<dyn MessageSubscriber>, Ros2Error> {
        let mut graph = self.lock();
        let entity = self.new_entity(&mut graph, node)?;
        let publishers = self.publishers(&mut graph, endpoint.topic)?;
        let (topic, router) = (TopicKey::from(endpoint), Arc::clone(&self.router));
        let (session, message_type) = (&self.session, endpoint.message_type);
        let declared = TopicSubscriber::declare(session, &entity, &topic, message_type, publishers, router);
        Ok(Box::new(declared.map_err(failed("make a subscriber"))?))
    }

    fn published_types(&self, topic: &str) -> Result<Vec<String>, Ros2Error> {
        Ok(self.publishers(&mut self.lock(), topic)?.types())
    }

    /// Nodes are stated when their first publisher or subscriber is made.
    fn announce_nodes(&self) -> Result<(), Ros2Error> {
        Ok(())
    }

    fn problem(&self) -> Option<String> {
        if self.session.is_closed() {
            return Some("ROS 2 over Zenoh has ended".to_owned());
        }
        self.router.problem(&self.session)
    }

    fn take_dropped(&self) -> u64 {
        self.drop_counter.take(&self.session)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::ZenohVariables;
    use crate::message_type::MessageType;

    fn environment(config_override: &str) -> Environment {
        let config_override = Some(config_override.to_owned());
        let zenoh = ZenohVariables { config_override, router_check_attempts: -1, session_config: None };
        Environment { zenoh, ..Environment::default() }
    }

    #[test]
    fn names_of_one_router_share_a_session() {
        let environment = environment("connect/endpoints=[\"tcp/localhost:1\"]");
        let open = |name: &str| shared(&name.parse().unwrap(), &environment).unwrap();
        let default = open("zenoh");
        assert!(Arc::ptr_eq(&default, &open("zenoh:tcp/localhost:1")));
        assert!(Arc::ptr_eq(&default, &open("zenoh:tcp/127.0.0.1:1")));
        assert!(!Arc::ptr_eq(&default, &open("zenoh:tcp/localhost:2")));
    }

    #[test]
    fn a_session_that_has_ended_takes_no_messages_and_is_a_problem_without_a_router_too() {
        let environment = environment(
            "mode=\"peer\";listen/endpoints=[];connect/endpoints=[];scouting/multicast/enabled=false",
        );
        let config = configuration(&"zenoh".parse().unwrap(), &environment).unwrap();
        let link = ZenohLink::open(config, &environment).unwrap();
        let endpoint = Endpoint { topic: "/front/scan", message_type: MessageType::LaserScan };
        let delivery = Delivery { depth: 1, is_kept: false };
        let publisher = link.publisher("camera", &endpoint, delivery).unwrap();
        assert!(publisher.send(&[1]) && link.problem().is_none());
        link.session.close().wait().unwrap();
        assert!(!publisher.send(&[1]));
        assert_eq!(link.problem().as_deref(), Some("ROS 2 over Zenoh has ended"));
    }
}
