use std::sync::atomic::{AtomicU64, AtomicUsize};

use nunet_core::depth::DepthEncoding;
use nunet_ros2_link::{Delivery, Endpoint, MessageSubscriber};
use nunet_sink::sink::Timings;
use nunet_source::Frame;
use nunet_telemetry::{DrainTimeout, Totals};
use nunet_types::ImageSize;

use super::other_publishers::LOOK_PERIOD;
use super::*;
use crate::messages::DiagnosticStatus;
use crate::options::Topics;

const SIZE: ImageSize = ImageSize::new(2, 2);
const TIMEOUT: Duration = Duration::from_secs(60);

/// What a subscriber does, as its publisher sees it.
#[derive(Clone, Copy)]
enum Behavior {
    Takes,
    Refuses,
    Panics,
    /// Until the test ends.
    Hangs,
}

/// A topic that counts its messages.
#[derive(Clone)]
struct Fake {
    behavior: Behavior,
    sent: Arc<AtomicUsize>,
}

impl MessagePublisher for Fake {
    fn subscribers(&self) -> usize {
        1
    }

    fn send(&self, _message: &[u8]) -> bool {
        assert!(!matches!(self.behavior, Behavior::Panics), "as the library may");
        self.sent.fetch_add(1, Ordering::Relaxed);
        if matches!(self.behavior, Behavior::Hangs) {
            std::thread::park_timeout(TIMEOUT);
        }
        matches!(self.behavior, Behavior::Takes)
    }
}

fn fake(behavior: Behavior) -> Fake {
    Fake { behavior, sent: Arc::default() }
}

fn options(counts: &MessageCounts) -> CameraOptions<'_> {
    CameraOptions {
        name: "front",
        frame_id: "eye",
        classes: &[],
        mount: None,
        has_labels: false,
        has_confidence: false,
        has_obstacles: false,
        counts,
        about: &[],
    }
}

fn outputs(topics: &[(Topic, &Fake)]) -> TopicPublishers {
    let mut outputs = TopicPublishers::default();
    topics.iter().for_each(|(topic, fake)| outputs.add(*topic, vec![Box::new((*fake).clone())]));
    outputs
}

fn give(sink: &mut dyn Sink, value: u8) {
    let mut frame = Frame::default();
    frame.rgb_buffer(SIZE).fill(value);
    frame.capture.unix_nanos = i64::from(value);
    let results = Results {
        scale: Scale::unscaled(DepthEncoding::Metric),
        size: SIZE,
        depth: &[1.0; 4],
        labels: None,
        confidence: None,
        cloud_size: SIZE,
        cloud: None,
        camera: None,
        view: nunet_types::PixelRect::whole(SIZE),
        obstacles: None,
        obstacle_frame: "base_link",
        roll_pitch_rad: None,
    };
    let timings = Timings { total_micros: 9, queue_micros: 1, inner_micros: &[5], publish_micros: 3 };
    sink.on_frame(&PublishedFrame { frame: &frame, camera: None, results, timings });
}

/// A sink whose thread is played by the test.
fn played(topics: &[(Topic, &Fake)], counts: &MessageCounts) -> (Ros2Sink, CameraThread) {
    let side =
        CameraThread::new(&options(counts), DepthFormat::Meters, outputs(topics), Connections::default());
    let sink = Ros2Sink { shared: Arc::clone(&side.shared), thread: std::thread::spawn(|| {}) };
    (sink, side)
}

#[test]
fn an_image_has_the_pixels_of_its_own_frame() {
    let (depth, image, counts) = (fake(Behavior::Takes), fake(Behavior::Takes), MessageCounts::default());
    let (mut sink, mut side) = played(&[(Topic::HalfDepth, &depth), (Topic::Image, &image)], &counts);
    let wanted = |topics| side.shared.wanted.store(topics, Ordering::Relaxed);
    wanted(bit(Topic::HalfDepth));
    give(&mut sink, 1);
    // The subscriber of the image comes between the copy and the message.
    wanted(bit(Topic::HalfDepth) | bit(Topic::Image));
    let Taken::Item(copy) = side.shared.mailbox.take(TIMEOUT) else { panic!("no frame") };
    side.send_frame(&copy);
    let sent = || [&depth, &image].map(|fake| fake.sent.load(Ordering::Relaxed));
    assert_eq!(sent(), [1, 0], "an image without the pixels of this frame");
    side.shared.mailbox.give_back(copy);
    give(&mut sink, 2);
    let Taken::Item(copy) = side.shared.mailbox.take(TIMEOUT) else { panic!("no frame") };
    side.send_frame(&copy);
    assert_eq!(sent(), [2, 1]);
}

#[test]
fn only_what_a_topic_with_a_subscriber_needs_is_copied() {
    let counts = MessageCounts::default();
    let (mut sink, side) = played(&[], &counts);
    for (topic, bytes) in [(Topic::DepthCamera, 0), (Topic::HalfDepth, 16), (Topic::Scan, 0)] {
        side.shared.wanted.store(bit(topic), Ordering::Relaxed);
        give(&mut sink, 1);
        let Taken::Item(copy) = side.shared.mailbox.take(TIMEOUT) else { panic!("no frame") };
        assert_eq!(copy.record.depth().bytes.len(), bytes, "{topic}");
        assert_eq!((copy.record.depth().width, copy.record.depth().height), (2, 2));
        side.shared.mailbox.give_back(copy);
    }
}

#[test]
fn the_transform_is_sent_again_if_frames_state_another_coordinate_frame() {
    let (transform, counts) = (fake(Behavior::Takes), MessageCounts::default());
    let mount = Some(CameraMount { translation_m: [0.0; 3], roll_pitch_yaw_rad: [0.0; 3] });
    let camera = CameraOptions { mount, ..options(&counts) };
    let outputs = outputs(&[(Topic::TfStatic, &transform)]);
    let mut side = CameraThread::new(&camera, DepthFormat::Meters, outputs, Connections::default());
    side.send_kept();
    for (stated, sent) in [("", 1), ("eye", 1), ("robot_eye", 2), ("robot_eye", 2), ("", 2)] {
        side.follow_frame_id(stated);
        assert_eq!(transform.sent.load(Ordering::Relaxed), sent, "`{stated}`");
    }
}

#[test]
fn diagnostics_count_as_messages_while_something_subscribes_to_them() {
    for (behavior, expected) in [(Behavior::Takes, (1, 0)), (Behavior::Refuses, (0, 1))] {
        let (diagnostics, counts) = (fake(behavior), MessageCounts::default());
        let (_sink, side) = played(&[(Topic::Diagnostics, &diagnostics)], &counts);
        side.send_diagnostics();
        assert_eq!((counts.sent(), counts.not_taken()), (0, 0), "nothing has subscribed yet");
        side.shared.wanted.store(bit(Topic::Diagnostics), Ordering::Relaxed);
        side.send_diagnostics();
        assert_eq!((counts.sent(), counts.not_taken()), expected);
    }
}

#[test]
fn diagnostics_state_no_age_before_the_first_frame() {
    let counts = MessageCounts::default();
    let (mut sink, side) = played(&[], &counts);
    let age = || {
        let array = side.diagnostics(&side.shared.state());
        let age = array.status[0].values.iter().find(|value| value.key == "age of the last frame, ms");
        age.expect("it is always stated").value.clone()
    };
    assert_eq!(age(), "none");
    give(&mut sink, 1);
    assert!(age().parse::<f64>().expect("a number") > 0.0, "{}", age());
    side.shared.state().capture_unix_nanos = Some(i64::MIN);
    assert!(age().parse::<f64>().expect("a number") > 0.0, "{}", age());
}

#[test]
fn diagnostics_warn_of_unstable_depth() {
    let counts = MessageCounts::default();
    let (mut sink, side) = played(&[], &counts);
    let mut totals = Totals::default();
    totals.stability.set_limit(Some(0.05));
    let mut after = |change: Option<Stability>| {
        (0..nunet_telemetry::STABILITY_FRAMES).for_each(|_| totals.stability.add(change));
        sink.on_status(&Status { is_up: true, counts: &Counts::default(), totals: &totals });
        let status = side.diagnostics(&side.shared.state()).status.remove(0);
        let value =
            |key: &str| status.values.iter().find(|value| value.key == key).expect("a key").value.clone();
        (status.level, value("depth drift, % per frame"), value("depth flicker, % per frame"))
    };
    let text = |drift: &str, flicker: &str| (drift.to_owned(), flicker.to_owned());
    let check = |(level, drift, flicker), expected| assert_eq!((level, (drift, flicker)), expected);
    check(after(None), (DiagnosticStatus::OK, text("unknown", "unknown")));
    let quiet = Stability { drift: -0.0125, flicker: 0.02 };
    check(after(Some(quiet)), (DiagnosticStatus::OK, text("-1.25", "2.00")));
    check(after(None), (DiagnosticStatus::OK, text("unknown", "unknown")));
    let flickers = Stability { drift: 0.0, flicker: 0.06 };
    check(after(Some(flickers)), (DiagnosticStatus::WARN, text("0.00", "6.00")));
}

#[test]
fn diagnostics_state_the_problems_of_connections() {
    let counts = MessageCounts::default();
    let (mut sink, side) = played(&[], &counts);
    sink.on_status(&Status { is_up: true, counts: &Counts::default(), totals: &Totals::default() });
    let status = || {
        let mut array = side.diagnostics(&side.shared.state());
        let status = array.status.remove(0);
        (status.level, status.message)
    };
    assert_eq!(status(), (DiagnosticStatus::OK, "frames arrive".to_owned()));
    counts.set_problems(vec!["no router".to_owned()]);
    assert_eq!(status(), (DiagnosticStatus::WARN, "no router".to_owned()));
}

#[test]
fn the_counts_and_the_thread_have_the_name_of_the_output() {
    for id in ["ros2", "other"] {
        let connections = Connections { output: OutputName { text: "Text", id }, ..Connections::default() };
        let counts = MessageCounts::default();
        let started =
            CameraThread::start(&options(&counts), DepthFormat::Meters, outputs(&[]), connections).unwrap();
        assert_eq!(started.messages().unwrap().0, id);
        assert_eq!(started.thread.thread().name(), Some(id));
        let finishing = Box::new(started).finish(None);
        assert_eq!(finishing.wait(&mut DrainTimeout::new(&|| false)).unwrap(), Outcome::Done);
    }
}

/// Feeds frames until the counts satisfy `is_enough`, and ends the sink.
fn feed(behavior: Behavior, is_enough: impl Fn(&MessageCounts, usize) -> bool) -> Outcome {
    let (fake, counts) = (fake(behavior), MessageCounts::default());
    let outputs = outputs(&[(Topic::HalfDepth, &fake)]);
    let mut sink =
        CameraThread::start(&options(&counts), DepthFormat::Meters, outputs, Connections::default()).unwrap();
    let start = Instant::now();
    while !is_enough(&counts, fake.sent.load(Ordering::Relaxed)) {
        give(&mut sink, 1);
        assert!(start.elapsed() < TIMEOUT, "{} sent, {} not taken", counts.sent(), counts.not_taken());
        std::thread::yield_now();
    }
    let is_stuck = matches!(behavior, Behavior::Hangs);
    let mut timeout = if is_stuck {
        DrainTimeout::with(&|| true, Duration::ZERO, TIMEOUT)
    } else {
        DrainTimeout::new(&|| false)
    };
    Box::new(sink).finish(None).wait(&mut timeout).unwrap()
}

#[test]
fn messages_are_counted_whether_subscribers_take_them_or_not() {
    assert_eq!(feed(Behavior::Takes, |counts, sent| counts.sent() >= 5 && sent >= 5), Outcome::Done);
    assert_eq!(
        feed(Behavior::Refuses, |counts, _| counts.not_taken() >= 5 && counts.sent() == 0),
        Outcome::Done
    );
}

#[test]
fn a_transport_that_hangs_or_panics_holds_up_neither_frames_nor_the_shutdown() {
    for behavior in [Behavior::Hangs, Behavior::Panics] {
        assert_eq!(feed(behavior, |counts, _| counts.superseded() >= 5), Outcome::Lost);
    }
}

/// A link that accepts the second announcement only, and reports a problem.
#[derive(Default)]
struct LateLink {
    announcements: AtomicUsize,
    dropped: AtomicU64,
    /// The topic that another node publishes, if one does.
    published: Option<&'static str>,
}

impl Link for LateLink {
    fn publisher(
        &self,
        _node: &str,
        _endpoint: &Endpoint<'_>,
        _delivery: Delivery,
    ) -> Result<Box<dyn MessagePublisher>, Ros2Error> {
        Ok(Box::new(fake(Behavior::Takes)))
    }

    fn subscriber(
        &self,
        _node: &str,
        _endpoint: &Endpoint<'_>,
    ) -> Result<Box<dyn MessageSubscriber>, Ros2Error> {
        Err(Ros2Error::Transport { name: "shy" })
    }

    fn published_types(&self, topic: &str) -> Result<Vec<String>, Ros2Error> {
        let is_published = self.published == Some(topic);
        Ok(is_published.then(|| "sensor_msgs/msg/LaserScan".to_owned()).into_iter().collect())
    }

    fn announce_nodes(&self) -> Result<(), Ros2Error> {
        let is_first = self.announcements.fetch_add(1, Ordering::Relaxed) == 0;
        let error = Ros2Error::Middleware { action: "announce the node", reason: "Timeout".to_owned() };
        if is_first { Err(error) } else { Ok(()) }
    }

    fn problem(&self) -> Option<String> {
        Some("no router".to_owned())
    }

    fn take_dropped(&self) -> u64 {
        self.dropped.swap(0, Ordering::Relaxed)
    }
}

#[test]
fn a_node_that_could_not_be_announced_is_announced_later() {
    let (link, counts) = (Arc::new(LateLink::default()), MessageCounts::default());
    let node = crate::Ros2Node::over(
        Arc::clone(&link) as Arc<dyn Link>,
        OutputName { text: "Test", id: "test" },
        Topics::Default,
    );
    let sink = node.add_camera(&options(&counts)).unwrap();
    let start = Instant::now();
    while link.announcements.load(Ordering::Relaxed) < 2 || counts.problems() != ["no router"] {
        assert!(start.elapsed() < TIMEOUT, "it is not tried again, or its problem is not reported");
        std::thread::sleep(COUNT_PERIOD);
    }
    link.dropped.store(3, Ordering::Relaxed);
    assert_eq!(sink.finish(None).wait(&mut DrainTimeout::new(&|| false)).unwrap(), Outcome::Done);
    assert_eq!(link.announcements.load(Ordering::Relaxed), 2, "once is enough");
    assert_eq!(counts.not_taken(), 3, "what was dropped in the end is counted, too");
}

#[test]
fn another_publisher_of_the_topics_of_a_camera_is_reported_once() {
    let start = Instant::now();
    let own =
        ["/front/depth/half/image_raw", "/front/scan", "/front/camera_info"].map(str::to_owned).to_vec();
    let link = |published| Arc::new(LateLink { published, ..LateLink::default() }) as Arc<dyn Link>;
    let reports = |links: &[Arc<dyn Link>], own: &[String]| {
        let mut others = OtherPublishers::new(own.to_vec(), start);
        (0..40_u32).filter(|tenth| others.check(links, start + LOOK_PERIOD * *tenth / 10)).collect::<Vec<_>>()
    };
    for topic in ["/front/depth/half/image_raw", "/front/scan", "/front/camera_info"] {
        let both = [link(None), link(Some(topic))];
        assert_eq!(reports(&both, &own), [10], "not before nodes had the time to find each other");
        assert!(reports(&both, &[]).is_empty());
    }
    assert!(reports(&[link(Some("/rear/scan"))], &own).is_empty());
    assert!(reports(&[], &own).is_empty());
}

#[test]
fn other_publishers_are_looked_for_on_all_topics_of_the_camera() {
    let (counts, fake) = (MessageCounts::default(), fake(Behavior::Takes));
    let topics = [Topic::HalfDepth, Topic::Image, Topic::ImageCamera, Topic::Diagnostics];
    let topics = topics.map(|topic| (topic, &fake));
    for (published, is_reported) in [
        ("/front/depth/half/image_raw", true),
        ("/front/image_raw/compressed", true),
        ("/front/camera_info", true),
        ("/diagnostics", false),
    ] {
        let (_sink, mut side) = played(&topics, &counts);
        let link = Arc::new(LateLink { published: Some(published), ..LateLink::default() });
        let later = Instant::now() + LOOK_PERIOD;
        assert_eq!(side.others.check(&[link as Arc<dyn Link>], later), is_reported, "{published}");
    }
}

#[test]
fn a_connection_with_two_names_is_used_once() {
    let [first, second] = [(); 2].map(|()| Arc::new(LateLink::default()) as Arc<dyn Link>);
    let links = crate::node::distinct(vec![Arc::clone(&first), Arc::clone(&second), Arc::clone(&first)]);
    assert_eq!(links.len(), 2);
    assert!(Arc::ptr_eq(&links[0], &first) && Arc::ptr_eq(&links[1], &second));
}
