//! One suite for every sink: what it takes arrives, and a backend that is slow, fails, hangs during a stop or is used again
//! does no harm to the stream. A new sink adds a line to [`CASES`].

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use nunet_core::cloud::CloudPoint;
use nunet_core::depth::{DepthEncoding, Scale};
use nunet_core::obstacle::{Ground, ObstacleSector, Obstacles};
#[cfg(feature = "foxglove")]
use nunet_foxglove::FoxgloveConfig;
use nunet_mavlink::MavlinkAddress;
use nunet_ros2::{CameraOptions, Ros2Options};
use nunet_sink::archive::Archive;
use nunet_sink::last_frame::last_frame_into;
use nunet_sink::mavlink::mavlink_sink;
use nunet_sink::metrics::metrics_sink;
use nunet_sink::record::RecordedFrame;
use nunet_sink::recorder::record_into;
use nunet_sink::view::view_sink;
use nunet_telemetry::MessageCounts;
use nunet_telemetry::{Counts, DrainTimeout, Totals};
use nunet_types::ImageSize;
use nunet_view::ViewOptions;

use super::*;
use crate::Outcome;
use crate::source::Frame;

/// No test waits longer for anything.
const TIMEOUT: Duration = Duration::from_secs(60);
const SIZE: ImageSize = ImageSize::new(2, 2);

/// The behavior of a sink's backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Backend {
    Good,
    /// It does nothing until it is released.
    Hanging,
    Failing,
}

/// A sink with its backend.
struct Rig {
    sink: Box<dyn Sink>,
    /// Lets a hanging backend go on.
    release: Box<dyn FnOnce() + Send>,
    /// Whether so many frames of a good backend arrived.
    arrived: Box<dyn Fn(u64) -> bool>,
}

struct Case {
    name: &'static str,
    /// Opens the sink; all that it writes goes below the folder.
    open: fn(&Path, Backend) -> Rig,
    /// It has a backend that can hang or fail.
    can_fail: bool,
}

const CASES: &[Case] = &[
    Case { name: "recording", open: recording, can_fail: true },
    Case { name: "last frame", open: last_frame, can_fail: true },
    Case { name: "metrics", open: metrics, can_fail: false },
    Case { name: "view", open: view, can_fail: false },
    Case { name: "mavlink", open: mavlink, can_fail: false },
    Case { name: "ROS 2", open: ros2, can_fail: false },
    #[cfg(feature = "foxglove")]
    Case { name: "Foxglove", open: foxglove, can_fail: false },
];

/// An archive that writes a line per frame.
struct Lines {
    path: PathBuf,
    backend: Backend,
    released: Receiver<()>,
}

impl Archive for Lines {
    fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, record: &RecordedFrame) -> anyhow::Result<()> {
        match self.backend {
            // After its release it goes on.
            Backend::Hanging => drop(self.released.recv_timeout(TIMEOUT)),
            Backend::Failing => anyhow::bail!("the disk is full"),
            Backend::Good => {}
        }
        let lines = std::fs::read_to_string(&self.path).unwrap_or_default();
        let labels = record.labels().expect("labels are wanted").len();
        Ok(std::fs::write(&self.path, format!("{lines}{} {labels}\n", record.frame.sequence))?)
    }

    fn sync(&mut self) -> anyhow::Result<()> {
        Ok(())
    }

    fn finish(self: Box<Self>) -> anyhow::Result<()> {
        Ok(())
    }
}

fn recording(folder: &Path, backend: Backend) -> Rig {
    let path = folder.join("lines");
    drop(std::fs::remove_file(&path));
    let (release, released): (Sender<()>, _) = channel();
    let archive = Lines { path: path.clone(), backend, released };
    let expected = |frames| (0..frames).map(|number| format!("{number} 4\n")).collect::<String>();
    Rig {
        sink: record_into(Box::new(archive), Arc::new(|| {})).unwrap(),
        release: Box::new(move || drop(release)),
        arrived: Box::new(move |frames| std::fs::read_to_string(&path).unwrap() == expected(frames)),
    }
}

fn last_frame(folder: &Path, backend: Backend) -> Rig {
    let out = folder.join(format!("{backend:?}"));
    let pipe = out.join("depth.npy");
    match backend {
        Backend::Good => {}
        // A file where the folder should be.
        Backend::Failing => std::fs::write(&out, "").unwrap(),
        Backend::Hanging => {
            // Opening a pipe for writing returns when another process opens it for reading.
            std::fs::create_dir_all(&out).unwrap();
            assert!(pipe.exists() || Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        }
    }
    let written = out.clone();
    Rig {
        sink: last_frame_into(out, false),
        release: Box::new(move || drop(std::fs::read(pipe))),
        arrived: Box::new(move |_| {
            ["depth.npy", "labels.png", "cloud.ply"].iter().all(|file| written.join(file).is_file())
        }),
    }
}

/// The answer to a request.
fn get(address: SocketAddr, target: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    write!(stream, "GET {target} HTTP/1.1\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

fn metrics(_folder: &Path, _backend: Backend) -> Rig {
    let metrics = Metrics::default();
    let server = metrics::serve(&metrics, "127.0.0.1:0".parse().unwrap()).unwrap();
    Rig {
        sink: metrics_sink(&metrics, "front", ["queue", "graph", "publish"]),
        release: Box::new(|| {}),
        arrived: Box::new(move |frames| {
            let answer = get(server.address(), "/metrics");
            answer.contains(&format!("nunet_latency_seconds_count{{camera=\"front\"}} {frames}\n"))
                && answer.contains("nunet_camera_up{camera=\"front\"} 0\n")
        }),
    }
}

/// Viewers that do not read are tested in `nunet-view`.
fn view(_folder: &Path, _backend: Backend) -> Rig {
    let server = ViewServer::open("127.0.0.1:0".parse().unwrap(), ViewOptions::default()).unwrap();
    Rig {
        sink: view_sink(&server, "front", &[]),
        release: Box::new(|| {}),
        // The first frame is kept for viewers that come later.
        arrived: Box::new(move |_| {
            get(server.address(), "/front/depth.png").contains("x-nunet-sequence: 0\r\n")
        }),
    }
}

/// A network loses messages without a notice; a lost TCP connection is tested in `nunet-mavlink`.
fn mavlink(_folder: &Path, _backend: Backend) -> Rig {
    let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
    autopilot.set_read_timeout(Some(TIMEOUT)).unwrap();
    let address = MavlinkAddress::Udp(autopilot.local_addr().unwrap().to_string());
    // Bytes 7 to 9 are the number of the message.
    let is_distance = |message: &[u8]| message[7..10] == [0x4a, 1, 0];
    Rig {
        sink: mavlink_sink(address, Arc::new(|| {})).unwrap(),
        release: Box::new(|| {}),
        arrived: Box::new(move |_| {
            let mut buffer = [0; 300];
            std::iter::from_fn(|| autopilot.recv(&mut buffer).ok().map(|_| is_distance(&buffer))).any(|is| is)
        }),
    }
}

/// One direction, of which nothing is known.
static OBSTACLES: LazyLock<Obstacles> = LazyLock::new(|| Obstacles {
    ground: Ground::EXPECTED,
    sectors: vec![ObstacleSector::UNKNOWN],
    points: Vec::new(),
    angle_min_rad: -0.5,
    angle_step_rad: 1.0,
    max_range_m: 5.0,
    used_labels: false,
});

/// Without subscribers, nothing is sent. Transports that refuse, hang and panic are tested in `nunet-ros2`; what arrives at
/// subscribers, by `cargo xtask test --ros2`.
fn ros2(_folder: &Path, _backend: Backend) -> Rig {
    let node = Ros2Node::open(&Ros2Options::default()).unwrap();
    unread(|camera| node.add_camera(camera).unwrap())
}

/// As [`ros2`]; clients that stall, die and send nonsense are tested in `nunet-foxglove`.
#[cfg(feature = "foxglove")]
fn foxglove(_folder: &Path, _backend: Backend) -> Rig {
    let config = FoxgloveConfig { address: "127.0.0.1:0".parse().unwrap(), is_public: false };
    let server = FoxgloveServer::open(config, 1).unwrap();
    let rig = unread(|camera| server.add_camera(camera).unwrap());
    Rig { release: Box::new(move || drop(server)), ..rig }
}

/// A camera that nothing subscribes to.
fn unread(add: impl FnOnce(&CameraOptions<'_>) -> Box<dyn Sink>) -> Rig {
    let counts = MessageCounts::default();
    let camera = CameraOptions {
        name: "front",
        frame_id: "eye",
        classes: &[],
        mount: None,
        has_labels: false,
        has_confidence: false,
        has_obstacles: false,
        counts: &counts,
        about: &[],
    };
    Rig {
        sink: add(&camera),
        release: Box::new(|| {}),
        arrived: Box::new(move |_| (counts.sent(), counts.not_taken(), counts.superseded()) == (0, 0, 0)),
    }
}

const DEPTH: [f32; 4] = [1.0, 2.0, f32::NAN, 4.0];

fn results() -> Results<'static> {
    const POINT: CloudPoint = CloudPoint { x: 0.0, y: 0.0, z: 1.0, b: 0, g: 0, r: 0, label: 1 };
    Results {
        scale: Scale::unscaled(DepthEncoding::Metric),
        size: SIZE,
        depth: &DEPTH,
        labels: Some(&[0, 1, 2, 3]),
        confidence: Some(&[255, 128, 0, 1]),
        cloud_size: SIZE,
        cloud: Some(&[POINT; 4]),
        camera: None,
        view: nunet_types::PixelRect::default(),
        obstacles: Some(&OBSTACLES),
        obstacle_frame: "base_footprint",
        roll_pitch_rad: None,
    }
}

/// Gives the sink `frames` frames and ends it, as the inference thread does.
fn feed(mut sink: Box<dyn Sink>, frames: u64, is_live: bool) -> FinishingSink {
    let mut frame = Frame::default();
    frame.rgb_buffer(SIZE).fill(100);
    frame.in_real_time = is_live;
    let (counts, totals) = (Counts::default(), Totals::default());
    for number in 0..frames {
        frame.sequence = number;
        let timings = Timings { total_micros: 9, queue_micros: 1, inner_micros: &[5], publish_micros: 3 };
        sink.on_frame(&PublishedFrame { frame: &frame, camera: None, results: results(), timings });
        sink.on_status(&Status { is_up: true, counts: &counts, totals: &totals });
        let start = std::time::Instant::now();
        while !sink.has_room() {
            assert!(!is_live, "a live source does not wait");
            assert!(start.elapsed() < TIMEOUT, "it never has room");
            std::thread::yield_now();
        }
    }
    sink.finish(Some(&results()))
}

fn unlimited() -> DrainTimeout<'static> {
    DrainTimeout::new(&|| false)
}

/// Foxglove is in the registry of every build. Without the feature, it is one that refuses to open.
#[test]
fn every_sink_of_the_registry_is_in_this_suite() {
    let refused = usize::from(!cfg!(feature = "foxglove"));
    assert_eq!(CASES.len() + refused, REGISTRY.len());
}

#[test]
fn every_frame_of_a_source_that_waits_arrives_and_a_sink_can_be_opened_again() {
    for case in CASES {
        let folder = tempfile::tempdir().unwrap();
        for run in ["first", "second"] {
            let Rig { sink, arrived, .. } = (case.open)(folder.path(), Backend::Good);
            let outcome = feed(sink, 40, false).wait(&mut unlimited()).unwrap();
            assert_eq!(outcome, Outcome::Done, "{}, {run} run", case.name);
            assert!(arrived(40), "{}, {run} run", case.name);
        }
    }
}

#[test]
fn a_hanging_sink_blocks_neither_live_frames_nor_the_shutdown_and_its_loss_is_counted() {
    for case in CASES.iter().filter(|case| case.can_fail) {
        let folder = tempfile::tempdir().unwrap();
        let Rig { sink, release, .. } = (case.open)(folder.path(), Backend::Hanging);
        let (done, fed) = channel();
        let feeder = std::thread::spawn(move || done.send(feed(sink, 100, true)));
        let finishing = fed.recv_timeout(TIMEOUT).unwrap_or_else(|_| panic!("{} blocks", case.name));
        feeder.join().unwrap().unwrap();
        let mut after_stop = DrainTimeout::with(&|| true, Duration::ZERO, TIMEOUT);
        let outcome = finishing.wait(&mut after_stop);
        assert!(!matches!(outcome, Ok(Outcome::Done)), "{}: {outcome:?}", case.name);
        release();
    }
}

#[test]
fn a_sink_that_fails_takes_all_frames_and_its_failure_is_reported_at_the_end() {
    for case in CASES.iter().filter(|case| case.can_fail) {
        let folder = tempfile::tempdir().unwrap();
        let Rig { sink, .. } = (case.open)(folder.path(), Backend::Failing);
        let outcome = feed(sink, 20, false).wait(&mut unlimited());
        assert!(!matches!(outcome, Ok(Outcome::Done)), "{}: {outcome:?}", case.name);
    }
}

#[test]
fn a_stream_without_a_frame_ends_without_an_error() {
    for case in CASES {
        let folder = tempfile::tempdir().unwrap();
        let Rig { sink, .. } = (case.open)(folder.path(), Backend::Good);
        let outcome = sink.finish(None).wait(&mut unlimited()).unwrap();
        assert_eq!(outcome, Outcome::Done, "{}", case.name);
    }
}

#[test]
fn frames_that_wait_in_the_queue_are_written_after_a_hang() {
    let folder = tempfile::tempdir().unwrap();
    let Rig { sink, release, arrived } = recording(folder.path(), Backend::Hanging);
    // As many as the queue takes: none is dropped.
    let finishing = feed(sink, 8, true);
    release();
    assert_eq!(finishing.wait(&mut unlimited()).unwrap(), Outcome::Done);
    assert!(arrived(8));
}
