//! Two sessions of Zenoh on loopback, of which one is the router.
#![cfg(feature = "ros2-zenoh")]
#![expect(clippy::unwrap_used, reason = "helpers of tests are tests")]

use std::net::TcpListener;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

use nunet_ros2_link::environment::{Environment, ZenohVariables};
use nunet_ros2_link::{
    Arrival, Delivery, Endpoint, Link, LinkName, MessagePublisher, MessageSubscriber, MessageType,
    connect_alone,
};

const TIMEOUT: Duration = Duration::from_secs(60);
const STEP: Duration = Duration::from_millis(20);
const SCAN: Endpoint<'_> = Endpoint { topic: "/front/scan", message_type: MessageType::LaserScan };
const FRAMES: Delivery = Delivery { depth: 5, is_kept: false };

fn session(name: &str, settings: String) -> Arc<dyn Link> {
    let config_override = Some(settings);
    let zenoh = ZenohVariables { config_override, router_check_attempts: 1, session_config: None };
    connect_alone(&name.parse().unwrap(), &Environment { domain: 3, zenoh, ..Environment::default() })
        .unwrap()
}

/// An address of this machine that nothing listens on.
fn free_endpoint() -> String {
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    format!("tcp/{}", listener.local_addr().unwrap())
}

fn router(endpoint: &str) -> Arc<dyn Link> {
    let settings = format!("mode=\"router\";listen/endpoints=[\"{endpoint}\"];connect/endpoints=[]");
    session("zenoh", settings)
}

fn node(endpoint: &str) -> Arc<dyn Link> {
    session(&format!("zenoh:{endpoint}"), String::new())
}

/// A session that must not wait for its router.
fn at_once(name: String, zenoh: ZenohVariables) -> Arc<dyn Link> {
    let (opened, opening) = channel();
    let environment = Environment { domain: 3, zenoh, ..Environment::default() };
    std::thread::spawn(move || {
        let _ = opened.send(connect_alone(&name.parse().unwrap(), &environment));
    });
    opening.recv_timeout(TIMEOUT).unwrap().unwrap()
}

fn with_settings(settings: &str) -> ZenohVariables {
    ZenohVariables { config_override: Some(settings.to_owned()), ..ZenohVariables::default() }
}

fn wait_until(what: &str, mut condition: impl FnMut() -> bool) {
    let start = Instant::now();
    while !condition() {
        assert!(start.elapsed() < TIMEOUT, "{what}");
        std::thread::sleep(STEP);
    }
}

fn receive(subscriber: &mut dyn MessageSubscriber, message: &mut Vec<u8>) -> u64 {
    match subscriber.take(message, TIMEOUT) {
        Arrival::Message(received) => received.lost,
        other => panic!("{other:?}"),
    }
}

fn wait_for_subscribers(publisher: &dyn MessagePublisher, count: usize) {
    wait_until("subscribers come and go", || publisher.subscribers() == count);
}

#[test]
fn messages_arrive_and_both_sides_know_each_other() {
    let endpoint = free_endpoint();
    let (here, there) = (router(&endpoint), node(&endpoint));
    let publisher = here.publisher("camera", &SCAN, FRAMES).unwrap();
    assert_eq!(publisher.subscribers(), 0);
    let mut subscriber = there.subscriber("planner", &SCAN).unwrap();
    wait_for_subscribers(&*publisher, 1);
    wait_until("the publisher is found", || subscriber.update().unwrap() == 1);
    assert_eq!(there.published_types(SCAN.topic).unwrap(), ["sensor_msgs/msg/LaserScan"]);
    assert!(there.published_types("/other").unwrap().is_empty());
    let (large, mut message) = (vec![7; 2_000_000], Vec::new());
    for sent in [&[1, 2, 3][..], &large, &[]] {
        assert!(publisher.send(sent));
        assert_eq!(receive(&mut *subscriber, &mut message), 0);
        assert!(message == sent, "{} bytes instead of {}", message.len(), sent.len());
    }
    drop(subscriber);
    wait_for_subscribers(&*publisher, 0);
}

#[test]
fn another_type_is_found_but_not_received() {
    let endpoint = free_endpoint();
    let (here, there) = (router(&endpoint), node(&endpoint));
    let image = Endpoint { message_type: MessageType::Image, ..SCAN };
    let publisher = here.publisher("camera", &image, FRAMES).unwrap();
    let mut subscriber = there.subscriber("planner", &SCAN).unwrap();
    wait_until("its type is found", || {
        there.published_types(SCAN.topic).unwrap() == [image.message_type.name()]
    });
    assert_eq!((subscriber.update().unwrap(), publisher.subscribers()), (0, 0));
    drop(publisher);
    wait_until("it is gone", || there.published_types(SCAN.topic).unwrap().is_empty());
}

#[test]
fn messages_that_a_subscriber_does_not_take_are_replaced_by_newer_ones() {
    let endpoint = free_endpoint();
    let (here, there) = (router(&endpoint), node(&endpoint));
    let publisher = here.publisher("camera", &SCAN, FRAMES).unwrap();
    let mut subscriber = there.subscriber("planner", &SCAN).unwrap();
    let last = there.subscriber("planner", &SCAN).unwrap();
    wait_for_subscribers(&*publisher, 1);
    (0..50).for_each(|number| assert!(publisher.send(&[number])));
    // The second subscriber shows when all have arrived.
    let (mut message, mut last) = (Vec::new(), last);
    wait_until("the last one arrives", || {
        last.take(&mut message, Duration::ZERO) != Arrival::Nothing && message == [49]
    });
    wait_until("both have it", || {
        let taken = subscriber.take(&mut message, Duration::ZERO);
        matches!(taken, Arrival::Message(_)) && message == [49]
    });
    assert_eq!(subscriber.take(&mut message, Duration::ZERO), Arrival::Nothing);
}

#[test]
fn an_absent_router_is_a_problem_until_it_comes() {
    let endpoint = free_endpoint();
    let there = node(&endpoint);
    let problem = format!("no Zenoh router at {endpoint}");
    wait_until("its absence is noticed", || there.problem().as_deref() == Some(&problem));
    let publisher = there.publisher("camera", &SCAN, FRAMES).unwrap();
    assert_eq!(publisher.subscribers(), 0);
    let here = router(&endpoint);
    wait_until("the router is found", || there.problem().is_none());
    let _subscriber = here.subscriber("planner", &SCAN).unwrap();
    wait_for_subscribers(&*publisher, 1);
    drop(here);
    wait_until("its end is noticed", || there.problem().is_some());
}

#[test]
fn leaving_takes_a_limited_time_without_a_router() {
    let there = node(&free_endpoint());
    let _publisher = there.publisher("camera", &SCAN, FRAMES).unwrap();
    let start = Instant::now();
    drop(there);
    assert!(start.elapsed() < TIMEOUT);
    let endpoint = LinkName::Zenoh { endpoint: Some("tcp/127.0.0.1:1".parse().unwrap()) };
    assert!(connect_alone(&endpoint, &Environment::default()).is_ok(), "the router is tried later");
}

#[test]
fn a_client_starts_without_its_router_and_finds_it_whenever_it_comes() {
    let endpoint = free_endpoint();
    let there = at_once(format!("zenoh:{endpoint}"), with_settings("mode=\"client\""));
    let publisher = there.publisher("camera", &SCAN, FRAMES).unwrap();
    let problem = format!("no Zenoh router at {endpoint}");
    wait_until("its absence is noticed", || there.problem().as_deref() == Some(&problem));
    for _ in 0..2 {
        let here = router(&endpoint);
        let mut subscriber = here.subscriber("planner", &SCAN).unwrap();
        wait_for_subscribers(&*publisher, 1);
        wait_until("the router is found", || there.problem().is_none());
        let mut message = Vec::new();
        wait_until("a message arrives", || {
            assert!(publisher.send(&[1, 2, 3]));
            let taken = subscriber.take(&mut message, Duration::ZERO);
            matches!(taken, Arrival::Message(_)) && message == [1, 2, 3]
        });
        drop((subscriber, here));
        wait_until("its end is noticed", || there.problem().is_some());
    }
}

#[test]
fn a_client_connects_to_the_router_that_is_there() {
    let (absent, present) = (free_endpoint(), free_endpoint());
    let here = router(&present);
    let endpoints = format!("connect/endpoints=[\"{absent}\",\"{present}\"]");
    let there = at_once("zenoh".to_owned(), with_settings(&format!("mode=\"client\";{endpoints}")));
    let publisher = there.publisher("camera", &SCAN, FRAMES).unwrap();
    let _subscriber = here.subscriber("planner", &SCAN).unwrap();
    wait_for_subscribers(&*publisher, 1);
}

#[test]
fn neither_a_file_nor_a_setting_makes_a_session_wait_or_fail_without_a_router() {
    let endpoint = free_endpoint();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.json5");
    std::fs::write(&path, format!("{{ mode: 'client', connect: {{ endpoints: ['{endpoint}'] }} }}")).unwrap();
    let file = ZenohVariables { session_config: Some(path), ..ZenohVariables::default() };
    let peer = with_settings("connect/exit_on_failure=true;connect/timeout_ms=-1");
    let client = with_settings("mode=\"client\";connect/timeout_ms=-1");
    for (name, zenoh) in [
        ("zenoh".to_owned(), file),
        (format!("zenoh:{endpoint}"), peer),
        (format!("zenoh:{endpoint}"), client),
    ] {
        let link = at_once(name, zenoh);
        assert_eq!(link.publisher("camera", &SCAN, FRAMES).unwrap().subscribers(), 0);
    }
}
