//! What ROS 2 topics over DDS cost the inference thread per frame: the default topics of a VGA camera,
//! without subscribers and with one for each topic. Messages go over loopback.
#![allow(missing_docs, reason = "criterion's macros make undocumented items")]

use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use nunet_core::camera::{Camera, Intrinsics, Mount};
use nunet_core::depth::{DepthEncoding, DepthImage, Scale};
use nunet_core::obstacle::{ObstacleDetector, ObstacleOptions, Obstacles};
use nunet_ros2::{CameraOptions, Ros2Node, Ros2Options, Topic};
use nunet_ros2_link::{Endpoint, LinkName, MessageSubscriber, connect_alone};
use nunet_sink::results::Results;
use nunet_sink::sink::{PublishedFrame, Sink, Timings};
use nunet_source::Frame;
use nunet_telemetry::MessageCounts;
use nunet_types::{ImageSize, PixelRect};

const SIZE: ImageSize = ImageSize { width: 640, height: 480 };
const CAMERA: &str = "bench";
/// A domain that robots rarely use.
const DOMAIN: u16 = 199;
/// As at 100 frames per second: the sending thread has time for each frame.
const PERIOD: Duration = Duration::from_millis(10);
const DISCOVERY: Duration = Duration::from_secs(10);

/// The results of a frame: a floor and a wall 3 m ahead.
struct Fixture {
    camera: Camera,
    depth_m: Vec<f32>,
    obstacles: Obstacles,
}

impl Fixture {
    fn new() -> Self {
        let camera = Camera::pinhole(
            Intrinsics::new(519.0, 519.0, 320.0, 240.0, SIZE.width, SIZE.height).expect("a camera"),
        );
        let row = |index: usize| (index / SIZE.width as usize) as f32 - 240.0;
        let floor_m = |y: f32| if y > 0.0 { 0.5 * 519.0 / y } else { f32::INFINITY };
        let depth_m: Vec<f32> = (0..SIZE.pixel_count()).map(|index| floor_m(row(index)).min(3.0)).collect();
        let mount = Mount::new([0.0, 0.0, 0.5], [0.0; 3]).expect("a mount");
        let mut detector =
            ObstacleDetector::new(&camera, mount, &[], ObstacleOptions::default()).expect("options");
        let image = DepthImage { depth_m: &depth_m, labels: None, confidence: None };
        let obstacles = detector.detect(&image, 0).expect("buffers of the camera's size").clone();
        Self { camera, depth_m, obstacles }
    }

    fn send(&self, sink: &mut dyn Sink, frame: &Frame) {
        sink.on_frame(&PublishedFrame {
            frame,
            camera: Some(self.camera),
            results: Results {
                scale: Scale::unscaled(DepthEncoding::Metric),
                size: SIZE,
                view: PixelRect::whole(SIZE),
                depth: &self.depth_m,
                labels: None,
                confidence: None,
                cloud_size: SIZE,
                cloud: None,
                camera: Some(self.camera),
                obstacles: sink.wants().obstacles.then_some(&self.obstacles),
                obstacle_frame: "base_link",
                roll_pitch_rad: None,
            },
            timings: Timings { total_micros: 0, queue_micros: 0, inner_micros: &[], publish_micros: 0 },
        });
    }
}

fn open(counts: &MessageCounts) -> Box<dyn Sink> {
    let options =
        Ros2Options { links: vec![LinkName::Dds { domain: Some(DOMAIN) }], ..Ros2Options::default() };
    let node = Ros2Node::open(&options).expect("a network");
    let sink = node.add_camera(&CameraOptions {
        name: CAMERA,
        frame_id: "eye",
        classes: &[],
        mount: None,
        has_labels: false,
        has_confidence: false,
        has_obstacles: true,
        counts,
        about: &[],
    });
    sink.expect("a camera")
}

/// A subscriber of each default topic in another participant.
fn subscribe() -> Vec<Box<dyn MessageSubscriber>> {
    let name = LinkName::Dds { domain: Some(DOMAIN) };
    let environment = name.environment().expect("good variables");
    let link = connect_alone(&name, &environment).expect("a network");
    let subscriber = |topic: Topic| {
        let name = topic.of_camera(CAMERA);
        let endpoint = Endpoint { topic: &name, message_type: topic.message_type() };
        link.subscriber("bench", &endpoint).expect("a subscriber")
    };
    let subscribers = Topic::DEFAULT.into_iter().map(subscriber).collect();
    std::mem::forget(link); // for as long as the process
    subscribers
}

fn ros2(criterion: &mut Criterion) {
    let (fixture, counts, frame) = (Fixture::new(), MessageCounts::default(), Frame::default());
    let mut sink = open(&counts);
    let mut measure = |criterion: &mut Criterion, case: &str| {
        criterion.bench_function(&format!("ros2/{case}/640x480"), |bencher| {
            bencher.iter_custom(|count| {
                (0..count)
                    .map(|_| {
                        std::thread::sleep(PERIOD);
                        let start = Instant::now();
                        fixture.send(&mut *sink, &frame);
                        start.elapsed()
                    })
                    .sum()
            });
        });
        sink.wants().obstacles
    };
    assert!(!measure(criterion, "without subscribers"));
    let _subscribers = subscribe();
    std::thread::sleep(DISCOVERY);
    assert!(measure(criterion, "default topics with subscribers"), "the subscribers were not found");
    assert!(counts.sent() > 0, "{} messages were not taken", counts.not_taken());
}

criterion_group!(name = benches; config = Criterion::default().sample_size(10); targets = ros2);
criterion_main!(benches);
