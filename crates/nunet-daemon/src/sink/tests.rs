//! One suite for every sink: what it takes arrives, and a backend that is slow, fails, hangs during a stop or
//! is used again does no harm to the stream. A new sink adds a line to [`CASES`].
//!
//! Shared memory is not a [`Sink`]. Its readers that are slow, hang or are killed are tested in `nunet-ipc`.

#[cfg(feature = "foxglove")]
mod foxglove_client;
mod network;

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, LazyLock, Mutex};
use std::time::{Duration, Instant};

use nunet_core::cloud::CloudPoint;
use nunet_core::depth::{DepthEncoding, Scale};
use nunet_core::obstacle::{Ground, ObstacleSector, Obstacles};
#[cfg(feature = "foxglove")]
use nunet_foxglove::FoxgloveConfig;
use nunet_mavlink::MavlinkTransport;
use nunet_ros2::{CameraOptions, OutputName, Ros2Options, Topic, Topics};
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

#[cfg(feature = "foxglove")]
use self::foxglove_client::SilentClient;
use self::network::FakeNetwork;
use super::*;
use crate::Outcome;
use crate::source::Frame;

/// No test waits longer for anything.
const TIMEOUT: Duration = Duration::from_secs(60);
const SIZE: ImageSize = ImageSize::new(2, 2);

/// The behavior of a sink's backend: a disk, a network, or the clients of a server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Backend {
    Good,
    /// It does nothing until it is released. A client is connected and does not read.
    Hanging,
    /// A disk is full, a network refuses messages, a port is closed.
    Failing,
}

const BAD: [Backend; 2] = [Backend::Hanging, Backend::Failing];

/// A sink with its backend.
struct Rig {
    sink: Box<dyn Sink>,
    /// Lets a hanging backend go on.
    release: Box<dyn FnOnce() + Send>,
    /// Whether so many frames of a good backend arrived.
    arrived: Box<dyn Fn(u64) -> bool>,
    /// Whether the sink reports a loss at its end.
    is_lost: bool,
    /// Whether the counts are right after so many frames of a backend that hangs or fails.
    is_counted: Box<dyn Fn(u64) -> bool>,
}

struct Case {
    name: &'static str,
    /// Opens the sink; all that it writes goes below the folder.
    open: fn(&Path, Backend) -> Rig,
}

const CASES: &[Case] = &[
    Case { name: "recording", open: recording },
    Case { name: "last frame", open: last_frame },
    Case { name: "metrics", open: metrics },
    Case { name: "view", open: view },
    Case { name: "mavlink", open: mavlink },
    Case { name: "ROS 2", open: ros2 },
    #[cfg(feature = "foxglove")]
    Case { name: "Foxglove", open: foxglove },
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
    let written = path.clone();
    Rig {
        sink: record_into(Box::new(archive), Arc::new(|| {})).unwrap(),
        release: Box::new(move || drop(release)),
        arrived: Box::new(move |frames| std::fs::read_to_string(&path).unwrap() == expected(frames)),
        is_lost: backend != Backend::Good,
        // All frames are lost.
        is_counted: Box::new(move |_| !written.exists()),
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
        is_lost: backend != Backend::Good,
        // It writes one frame and counts none.
        is_counted: Box::new(|_| true),
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

/// A client that asks again and again, and reads no answer.
fn ask_without_reading(address: SocketAddr, target: &str) -> TcpStream {
    const MOST_REQUESTS: usize = 4096;
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_nonblocking(true).unwrap();
    let request = format!("GET {target} HTTP/1.1\r\nHost: {address}\r\n\r\n");
    for _ in 0..MOST_REQUESTS {
        // An error: there is no room for more.
        if stream.write_all(request.as_bytes()).is_err() {
            break;
        }
    }
    stream
}

/// Every frame is counted, also while clients do not read the counts.
fn metrics(_folder: &Path, backend: Backend) -> Rig {
    let metrics = Metrics::default();
    let server = metrics::serve(&metrics, "127.0.0.1:0".parse().unwrap()).unwrap();
    let address = server.address();
    let has_counted = |text: &str, frames: u64| {
        text.contains(&format!("nunet_latency_seconds_count{{camera=\"front\"}} {frames}\n"))
            && text.contains("nunet_camera_up{camera=\"front\"} 0\n")
    };
    let sink = metrics_sink(&metrics, "front", ["queue", "graph", "publish"]);
    let client = (backend == Backend::Hanging).then(|| ask_without_reading(address, "/metrics"));
    let server = Some(server).filter(|_| backend != Backend::Failing);
    let read = move || if backend == Backend::Failing { metrics.text() } else { get(address, "/metrics") };
    Rig {
        sink,
        release: Box::new(move || drop(client)),
        arrived: Box::new(move |frames| server.is_some() && has_counted(&get(address, "/metrics"), frames)),
        is_lost: false,
        is_counted: Box::new(move |frames| has_counted(&read(), frames)),
    }
}

/// Viewers whose buffers are full are tested in `nunet-view`. Skipped frames are not counted: each viewer
/// gets the newest one.
fn view(_folder: &Path, backend: Backend) -> Rig {
    let server = ViewServer::open("127.0.0.1:0".parse().unwrap(), ViewOptions::default()).unwrap();
    let (address, sink) = (server.address(), view_sink(&server, "front", &[]));
    let viewer = (backend == Backend::Hanging).then(|| ask_without_reading(address, "/front/depth.mjpeg"));
    let server = Some(server).filter(|_| backend != Backend::Failing);
    let depth = move || get(address, "/front/depth.png");
    Rig {
        sink,
        release: Box::new(move || drop(viewer)),
        // The first frame is kept for viewers that come later.
        arrived: Box::new(move |_| server.is_some() && depth().contains("x-nunet-sequence: 0\r\n")),
        is_lost: false,
        // Other viewers see a frame.
        is_counted: Box::new(move |_| backend == Backend::Failing || depth().contains("x-nunet-sequence: ")),
    }
}

/// Counts the messages that the thread of a queue has finished. If the backend hangs, so does the thread.
fn on_room_of(backend: Backend) -> (OnRoom, Arc<AtomicU64>, Sender<()>) {
    let (release, released) = channel();
    let (released, finished) = (Mutex::new(released), Arc::<AtomicU64>::default());
    let count = Arc::clone(&finished);
    let on_room = move || {
        count.fetch_add(1, Ordering::Relaxed);
        if backend == Backend::Hanging {
            let _ = released.lock().unwrap().recv_timeout(TIMEOUT);
        }
    };
    (Arc::new(on_room), finished, release)
}

/// A network loses messages without a notice. How a lost TCP connection is opened again is tested in
/// `nunet-mavlink`.
fn mavlink(_folder: &Path, backend: Backend) -> Rig {
    let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
    autopilot.set_read_timeout(Some(TIMEOUT)).unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let transport = match backend {
        Backend::Good => MavlinkTransport::Udp(autopilot.local_addr().unwrap().to_string()),
        // A peer that does not read, or a closed port.
        Backend::Hanging | Backend::Failing => {
            MavlinkTransport::Tcp(listener.local_addr().unwrap().to_string())
        }
    };
    let listener = Some(listener).filter(|_| backend == Backend::Hanging);
    let (on_room, finished, release) = on_room_of(backend);
    // Bytes 7 to 9 are the number of the message.
    let is_distance = |message: &[u8]| message[7..10] == [0x4a, 1, 0];
    Rig {
        sink: mavlink_sink(transport.into(), on_room).unwrap(),
        release: Box::new(move || drop((release, listener))),
        arrived: Box::new(move |_| {
            let mut buffer = [0; 300];
            std::iter::from_fn(|| autopilot.recv(&mut buffer).ok().map(|_| is_distance(&buffer))).any(|is| is)
        }),
        // A lost connection is opened again, and is no failure of the stream.
        is_lost: backend == Backend::Hanging,
        is_counted: Box::new(move |frames| match (backend, finished.load(Ordering::Relaxed)) {
            (Backend::Hanging, finished) => finished <= 1,
            // The first message is taken, and at most all.
            (_, finished) => (1..=frames).contains(&finished),
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

/// Without subscribers, nothing is sent. Transports that panic are tested in `nunet-ros2`; what arrives at
/// subscribers, by `cargo xtask test --ros2`.
fn ros2(_folder: &Path, backend: Backend) -> Rig {
    if backend == Backend::Good {
        let node = Ros2Node::open(&Ros2Options::default()).unwrap();
        return unread(|camera| node.add_camera(camera).unwrap());
    }
    let (release, released) = channel();
    let labels = Topics::These([Topic::Labels].into());
    let node = Ros2Node::over(Arc::new(FakeNetwork::new(backend, released)), OutputName::ROS_2, labels);
    let (sink, counts) = with_counts(|camera| node.add_camera(camera).unwrap());
    await_subscriber(sink.as_ref());
    Rig {
        sink,
        release: Box::new(move || drop(release)),
        arrived: Box::new(|_| false),
        is_lost: backend == Backend::Hanging,
        is_counted: Box::new(move |frames| {
            let (not_taken, superseded) = (counts.not_taken(), counts.superseded());
            let is_right = match backend {
                // One is being sent, and one may wait.
                Backend::Hanging => not_taken == 0 && (frames - 2..frames).contains(&superseded),
                _ => not_taken > 0 && not_taken + superseded == frames,
            };
            is_right && counts.sent() == 0
        }),
    }
}

/// As [`ros2`]; clients with full buffers, that die and send nonsense are tested in `nunet-foxglove`.
#[cfg(feature = "foxglove")]
fn foxglove(_folder: &Path, backend: Backend) -> Rig {
    let config = FoxgloveConfig { address: "127.0.0.1:0".parse().unwrap(), is_public: false };
    let server = FoxgloveServer::open(config, 1).unwrap();
    if backend == Backend::Good {
        let rig = unread(|camera| server.add_camera(camera).unwrap());
        return Rig { release: Box::new(move || drop(server)), ..rig };
    }
    let (sink, counts) = with_counts(|camera| server.add_camera(camera).unwrap());
    let client = SilentClient::subscribe(server.address(), "/front/labels/image_raw");
    await_subscriber(sink.as_ref());
    let server = Some(server).filter(|_| backend == Backend::Hanging);
    Rig {
        sink,
        release: Box::new(move || drop((client, server))),
        arrived: Box::new(|_| false),
        is_lost: false,
        is_counted: Box::new(move |frames| {
            let all = counts.sent() + counts.superseded();
            // The server queues messages for its client. Without the server, nobody waits for a frame.
            let is_right = if backend == Backend::Hanging { all == frames } else { all <= frames };
            is_right && counts.not_taken() == 0
        }),
    }
}

/// Waits until the sink knows that something subscribes to labels. From then on, each frame is a message.
fn await_subscriber(sink: &dyn Sink) {
    let start = Instant::now();
    while !sink.wants().labels {
        assert!(start.elapsed() < TIMEOUT, "the subscriber is not found");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A camera with the counts of its messages.
fn with_counts(add: impl FnOnce(&CameraOptions<'_>) -> Box<dyn Sink>) -> (Box<dyn Sink>, MessageCounts) {
    let counts = MessageCounts::default();
    let camera = CameraOptions {
        name: "front",
        frame_id: "eye",
        classes: &[],
        mount: None,
        has_labels: true,
        has_confidence: false,
        has_obstacles: false,
        counts: &counts,
        about: &[],
    };
    let sink = add(&camera);
    (sink, counts)
}

/// A camera that nothing subscribes to.
fn unread(add: impl FnOnce(&CameraOptions<'_>) -> Box<dyn Sink>) -> Rig {
    let (sink, counts) = with_counts(add);
    Rig {
        sink,
        release: Box::new(|| {}),
        arrived: Box::new(move |_| (counts.sent(), counts.not_taken(), counts.superseded()) == (0, 0, 0)),
        is_lost: false,
        is_counted: Box::new(|_| false),
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
        let start = Instant::now();
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

/// The backend is released after all calls, so no call can have waited for it.
#[test]
fn a_hanging_sink_blocks_neither_live_frames_nor_the_shutdown_and_its_loss_is_counted() {
    for Case { name, open } in CASES {
        let folder = tempfile::tempdir().unwrap();
        let rig = open(folder.path(), Backend::Hanging);
        let (done, fed) = channel();
        let sink = rig.sink;
        let feeder = std::thread::spawn(move || done.send(feed(sink, 100, true)));
        let finishing = fed.recv_timeout(TIMEOUT).unwrap_or_else(|_| panic!("{name} blocks"));
        feeder.join().unwrap().unwrap();
        // What waits for its backend is abandoned by the stop. Everything else ends without one.
        let is_stopped = || rig.is_lost;
        let mut after_stop = DrainTimeout::with(&is_stopped, Duration::ZERO, TIMEOUT);
        let outcome = finishing.wait(&mut after_stop);
        assert_eq!(!matches!(outcome, Ok(Outcome::Done)), rig.is_lost, "{name}: {outcome:?}");
        assert!((rig.is_counted)(100), "{name}");
        (rig.release)();
    }
}

/// A disk that fails is a loss. A network or a client that is gone is none: the messages are counted.
#[test]
fn a_sink_that_fails_takes_all_frames_and_its_failure_is_reported_at_the_end() {
    for Case { name, open } in CASES {
        let folder = tempfile::tempdir().unwrap();
        let rig = open(folder.path(), Backend::Failing);
        let outcome = feed(rig.sink, 20, false).wait(&mut unlimited());
        assert_eq!(!matches!(outcome, Ok(Outcome::Done)), rig.is_lost, "{name}: {outcome:?}");
        assert!((rig.is_counted)(20), "{name}");
    }
}

/// The stream is restarted after the disk, the network or the client was repaired.
#[test]
fn a_sink_can_be_opened_again_after_its_backend_hung_or_failed() {
    for (Case { name, open }, before) in CASES.iter().flat_map(|case| BAD.map(|before| (case, before))) {
        let folder = tempfile::tempdir().unwrap();
        let rig = open(folder.path(), before);
        let finishing = feed(rig.sink, 3, true);
        (rig.release)();
        // Whatever it reports: that it ended is enough here.
        drop(finishing.wait(&mut unlimited()));
        let again = open(folder.path(), Backend::Good);
        assert_eq!(feed(again.sink, 3, false).wait(&mut unlimited()).unwrap(), Outcome::Done, "{name}");
        assert!((again.arrived)(3), "{name} after {before:?}");
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
    let Rig { sink, release, arrived, .. } = recording(folder.path(), Backend::Hanging);
    // As many as the queue takes: none is dropped.
    let finishing = feed(sink, 8, true);
    release();
    assert_eq!(finishing.wait(&mut unlimited()).unwrap(), Outcome::Done);
    assert!(arrived(8));
}
