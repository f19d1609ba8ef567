//! One suite that runs over all sources. A new source adds a line in [`CASES`].
#![cfg(all(feature = "mcap", feature = "v4l2"))]
#![expect(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

mod suite;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::Permissions;
use std::io::{BufRead as _, BufReader, Cursor, Read, Write as _};
use std::net::{SocketAddr, TcpListener};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use image::{ImageFormat, Rgb, RgbImage};
use nunet_ipc::{CameraName, Encoding, Limits, Publisher, Topic, TopicPlan, monotonic_nanos};
use nunet_mcap::{DepthRecord, EncodedImage, FrameRecord, RecordingWriter, ScaleRecord, WriterOptions};
use nunet_source::{
    Fill, Frame, OpenOptions, Rotated, Rotation, Source, SourceErrorKind, SourceName, open_pipe,
};
use nunet_types::{ImageSize, PixelFormat};
#[cfg(all(feature = "ros2-dds", feature = "ros2-zenoh"))]
use {
    nunet_mcap::ros::{Header, RosMessage, Time},
    nunet_ros2_link::environment::{DiscoveryRange, Environment, ZenohVariables},
    nunet_ros2_link::{Delivery, Endpoint, LinkName, MessageType, connect_alone},
    nunet_source::Ros2Source,
    std::sync::atomic::AtomicUsize,
};

use self::suite::{MAX_CALLS, Offer, Subject, assert_frames, next};

/// A source of the suite.
struct Case {
    name: &'static str,
    /// A name of a source of its kind, as users write it.
    kind: &'static str,
    has_end: bool,
    /// Whether frames can be bad, and can differ in size.
    varies: bool,
    /// Opens it; its files go into the folder.
    open: fn(&Path) -> (Box<dyn Source>, Offer),
}

/// Of the sources without an end, the demo repeats itself, shared memory and ROS 2 wait, and a command is
/// started again.
const CASES: &[Case] = &[
    Case {
        name: "images",
        kind: "images",
        has_end: true,
        varies: true,
        open: |folder| alone(folder_of_images(folder)),
    },
    Case {
        name: "rotated images",
        kind: "images",
        has_end: true,
        varies: true,
        open: |folder| alone(rotated(folder_of_images(folder))),
    },
    Case {
        name: "recording",
        kind: "drive.mcap",
        has_end: true,
        varies: true,
        open: |folder| alone(recording(folder)),
    },
    Case {
        name: "split recording",
        kind: "drive.mcap",
        has_end: true,
        varies: true,
        open: |folder| alone(split_recording(folder)),
    },
    Case { name: "raw pipe", kind: "-", has_end: true, varies: false, open: |_| alone(raw_pipe()) },
    Case { name: "Y4M pipe", kind: "-", has_end: true, varies: false, open: |_| alone(y4m_pipe()) },
    Case { name: "JPEG pipe", kind: "-", has_end: true, varies: true, open: |_| alone(jpeg_pipe()) },
    Case { name: "demo", kind: "demo", has_end: false, varies: true, open: |folder| alone(demo(folder)) },
    Case {
        name: "shared memory",
        kind: "shm:front",
        has_end: false,
        varies: true,
        open: |_| shared_memory("conformance"),
    },
    Case {
        name: "rotated shared memory",
        kind: "shm:front",
        has_end: false,
        varies: true,
        open: |_| {
            let (source, offer) = shared_memory("conformance_rotated");
            (rotated(source), offer)
        },
    },
    Case { name: "command", kind: "exec:cat", has_end: false, varies: false, open: |_| alone(command()) },
    #[cfg(all(feature = "ros2-dds", feature = "ros2-zenoh"))]
    Case { name: "ROS 2 over DDS", kind: ROS2, has_end: false, varies: true, open: |_| ros2(&dds()) },
    #[cfg(all(feature = "ros2-dds", feature = "ros2-zenoh"))]
    Case { name: "ROS 2 over Zenoh", kind: ROS2, has_end: false, varies: true, open: |_| ros2(&zenoh()) },
];

const ROS2: &str = "ros2:/front/image_raw";

/// Kinds without a case, and why they have none.
const WITHOUT_CASE: &[(&str, &str)] = &[
    (
        "rtsp://127.0.0.1/front",
        "ffmpeg reads it: `a_network_camera_follows_the_rules` uses a process with another PATH",
    ),
    (
        "/dev/video0",
        "only the kernel makes devices: `src/v4l2/tests.rs` checks the rules with a simulated one",
    ),
    #[cfg(not(all(feature = "ros2-dds", feature = "ros2-zenoh")))]
    (ROS2, "the tests of live topics need both networks"),
];

impl Case {
    /// Opens it, in a folder of its own.
    fn subject(&self, folder: &Path) -> Subject {
        let own = folder.join(self.name.replace(' ', "_"));
        std::fs::create_dir(&own).unwrap();
        let (source, offer) = (self.open)(&own);
        let Self { name, varies, .. } = *self;
        Subject { name, source, has_bad_frames: varies, has_sizes: varies, offer }
    }
}

/// A source that needs nobody to publish its frames.
fn alone(source: Box<dyn Source>) -> (Box<dyn Source>, Offer) {
    (source, Box::new(|_| {}))
}

fn png(side: u32) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    RgbImage::from_pixel(side, side, Rgb([9, 9, 9])).write_to(&mut file, ImageFormat::Png).unwrap();
    file.into_inner()
}

/// Two good images of different sizes around a bad one.
fn images() -> [Vec<u8>; 3] {
    [png(2), b"\x89PNG\r\n\x1a\n and no more".to_vec(), png(4)]
}

fn folder_of_images(folder: &Path) -> Box<dyn Source> {
    for (name, image) in ["a.png", "b.png", "c.png"].iter().zip(images()) {
        std::fs::write(folder.join(name), image).unwrap();
    }
    open(folder.to_str().unwrap())
}

fn open(name: &str) -> Box<dyn Source> {
    SourceName::parse(name).open(OpenOptions::default()).unwrap()
}

fn write_recording(path: &Path, images: &[Vec<u8>]) {
    let options = WriterOptions {
        camera: "front".into(),
        frame_id: "eye".into(),
        mount: None,
        about: BTreeMap::new(),
        force: true,
    };
    let mut writer = RecordingWriter::create(path, options).unwrap();
    for (log_nanos, data) in (1..).zip(images) {
        let image = Some(EncodedImage { format: "png", data });
        let depth = DepthRecord { scale: ScaleRecord::default(), width: 1, height: 1, bytes: &[0; 4] };
        let (camera, depth_camera, labels, cloud) = (None, None, None, None);
        let confidence = None;
        let frame = FrameRecord {
            log_nanos,
            stamp_nanos: 1,
            image,
            camera,
            depth,
            depth_camera,
            labels,
            confidence,
            cloud,
        };
        writer.write(&frame).unwrap();
    }
    writer.finish().unwrap();
}

fn split_recording(folder: &Path) -> Box<dyn Source> {
    for (number, image) in images().into_iter().enumerate() {
        write_recording(&folder.join(format!("drive_{number}.mcap")), &[image]);
    }
    open(folder.to_str().unwrap())
}

fn recording(folder: &Path) -> Box<dyn Source> {
    let path = folder.join("drive.mcap");
    write_recording(&path, &images());
    open(path.to_str().unwrap())
}

/// Options for raw images of 4 bytes.
fn raw_options() -> OpenOptions<'static> {
    OpenOptions {
        size: Some(ImageSize { width: 2, height: 2 }),
        format: Some(PixelFormat::Mono8),
        ..OpenOptions::default()
    }
}

fn raw_pipe() -> Box<dyn Source> {
    open_pipe(Cursor::new(vec![7; 3 * 4]), raw_options()).unwrap()
}

fn command() -> Box<dyn Source> {
    SourceName::parse("exec:printf aaaabbbbcccc").open(raw_options()).unwrap()
}

fn jpeg(side: u32) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    RgbImage::from_pixel(side, side, Rgb([9, 9, 9])).write_to(&mut file, ImageFormat::Jpeg).unwrap();
    file.into_inner()
}

/// The second image has an end, but no data.
fn jpeg_pipe() -> Box<dyn Source> {
    let stream = [jpeg(2), b"\xff\xd8\xff\xd9".to_vec(), jpeg(4)].concat();
    open_pipe(Cursor::new(stream), OpenOptions::default()).unwrap()
}

fn y4m_pipe() -> Box<dyn Source> {
    let stream = [&b"YUV4MPEG2 W2 H2 F25:1 Cmono\n"[..], &b"FRAME\n\x01\x02\x03\x04".repeat(3)].concat();
    open_pipe(Cursor::new(stream), OpenOptions::default()).unwrap()
}

fn demo(folder: &Path) -> Box<dyn Source> {
    let clip = folder.join("clip");
    std::fs::create_dir_all(clip.join("rgb")).unwrap();
    for (name, image) in ["a_0.png", "a_1.png", "a_2.png"].iter().zip(images()) {
        std::fs::write(clip.join("rgb").join(name), image).unwrap();
    }
    let camera = r#"{"width": 2, "height": 2, "fx": 5, "fy": 5, "cx": 0.5, "cy": 0.5}"#;
    std::fs::write(clip.join("camera.json"), camera).unwrap();
    let options = OpenOptions { model_folders: &[folder.to_owned()], ..OpenOptions::default() };
    SourceName::parse("demo").open(options).unwrap()
}

/// A camera's name that no other test process has.
fn camera(test: &str) -> CameraName {
    nunet_ipc::use_root(&nunet_testkit::ipc_root()).unwrap();
    CameraName::new(&format!("{test}_{}", std::process::id())).unwrap()
}

fn publisher(camera: &CameraName) -> Publisher {
    let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: 3 * 4 * 4 };
    Publisher::create(camera, &[plan], &Limits::default()).unwrap()
}

/// The three frames in shared memory. The second is a depth map, which is no image.
fn shared_memory(name: &str) -> (Box<dyn Source>, Offer) {
    let camera = camera(name);
    let publisher = publisher(&camera);
    let mut source = open(&format!("shm:{camera}"));
    // It connects: a publisher sends to the readers that it knows.
    assert!(matches!(source.fill(&mut Frame::default()), Fill::Nothing));
    let offer = move |sequence| {
        let side: u32 = if sequence == 2 { 4 } else { 2 };
        let bytes = 3 * (side * side) as usize;
        let mut loan = publisher.loan_bytes(Topic::Rgb, bytes).unwrap();
        let header = loan.header_mut();
        (header.sequence, header.width, header.height, header.row_stride_bytes) =
            (sequence, side, side, 3 * side);
        header.set_encoding(if sequence == 1 { Encoding::DepthF32 } else { PixelFormat::Rgb8.into() });
        loan.publish(monotonic_nanos()).unwrap();
    };
    (source, Box::new(offer))
}

/// How another node and the source are connected.
#[cfg(all(feature = "ros2-dds", feature = "ros2-zenoh"))]
struct Network {
    node: (LinkName, Environment),
    source: (LinkName, Environment),
}

/// A domain of this machine that other test processes rarely use.
#[cfg(all(feature = "ros2-dds", feature = "ros2-zenoh"))]
fn dds() -> Network {
    let domain = 101 + u16::try_from(std::process::id() % 100).unwrap();
    let environment = Environment { domain, range: DiscoveryRange::Localhost, ..Environment::default() };
    let name = LinkName::Dds { domain: None };
    Network { node: (name.clone(), environment.clone()), source: (name, environment) }
}

/// The node is the router.
#[cfg(all(feature = "ros2-dds", feature = "ros2-zenoh"))]
fn zenoh() -> Network {
    let listener = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let endpoint = format!("tcp/{}", listener.local_addr().unwrap());
    let settings = format!("mode=\"router\";listen/endpoints=[\"{endpoint}\"];connect/endpoints=[]");
    let zenoh = ZenohVariables { config_override: Some(settings), ..ZenohVariables::default() };
    let router = Environment { zenoh, ..Environment::default() };
    Network {
        node: (LinkName::Zenoh { endpoint: None }, router),
        source: (LinkName::Zenoh { endpoint: Some(endpoint.parse().unwrap()) }, Environment::default()),
    }
}

/// The three images as live messages from another node.
#[cfg(all(feature = "ros2-dds", feature = "ros2-zenoh"))]
fn ros2(network: &Network) -> (Box<dyn Source>, Offer) {
    static OPENED: AtomicUsize = AtomicUsize::new(0);
    // Tests run at the same time: each has a topic of its own.
    let number = OPENED.fetch_add(1, Ordering::Relaxed);
    let topic = format!("/conformance{number}/image_raw/compressed");
    let (name, environment) = &network.node;
    let link = connect_alone(name, environment).unwrap();
    let endpoint = Endpoint { topic: &topic, message_type: MessageType::CompressedImage };
    let publisher = link.publisher("camera", &endpoint, Delivery { depth: 1, is_kept: false }).unwrap();
    link.announce_nodes().unwrap();
    let (name, environment) = &network.source;
    let source = Ros2Source::open(&topic, name, environment).unwrap();
    let mut source: Box<dyn Source> = Box::new(source);
    // It subscribes once it knows the type.
    let is_subscribed = (0..600).any(|_| {
        assert!(matches!(source.fill(&mut Frame::default()), Fill::Nothing));
        publisher.subscribers() > 0
    });
    assert!(is_subscribed, "the subscriber was never found");
    let offer = move |number: u64| {
        let _link = &link;
        let data = &images()[number as usize];
        let header = Header { stamp: Time { sec: 7, nanosec: number as u32 }, frame_id: "eye".into() };
        let mut message = Vec::new();
        let image = RosMessage::CompressedImage(EncodedImage { format: "png", data });
        image.encode(&header, &mut message).unwrap();
        assert!(publisher.send(&message));
    };
    (source, Box::new(offer))
}

#[cfg(all(feature = "ros2-dds", feature = "ros2-zenoh"))]
#[test]
fn a_live_message_keeps_its_stamp_and_its_coordinate_frame() {
    for network in [dds(), zenoh()] {
        let (mut source, mut offer) = ros2(&network);
        let mut frame = Frame::default();
        offer(0);
        assert!(matches!(next(source.as_mut(), &mut frame), Fill::Frame));
        assert_eq!((frame.capture.unix_nanos, frame.frame_id.as_str()), (7_000_000_000, "eye"));
        assert!(source.is_live() && !source.is_waiting());
    }
}

/// Each round sends more messages than wait for the source. On a busy machine, some may arrive while it takes
/// others.
#[cfg(all(feature = "ros2-dds", feature = "ros2-zenoh"))]
#[test]
fn live_messages_that_newer_ones_replace_are_superseded() {
    const MESSAGES: u64 = 20;
    const ROUNDS: u64 = 100;
    for network in [dds(), zenoh()] {
        let (mut source, mut offer) = ros2(&network);
        let (mut frame, mut frames, mut superseded) = (Frame::default(), 0, 0);
        for round in 1..=ROUNDS {
            (0..MESSAGES).for_each(|_| offer(0));
            while frames + superseded < round * MESSAGES {
                assert!(matches!(next(source.as_mut(), &mut frame), Fill::Frame));
                frames += 1;
                superseded += frame.superseded;
            }
            if superseded > 0 {
                break;
            }
        }
        assert!(superseded > 0, "none of {frames} was replaced");
        assert_eq!(frame.sequence + 1, frames + superseded);
    }
}

/// Any source can be rotated.
fn rotated(source: Box<dyn Source>) -> Box<dyn Source> {
    Box::new(Rotated::new(source, Some(Rotation::Quarter)))
}

#[test]
fn every_kind_of_source_has_a_case_or_a_reason_why_it_has_none() {
    let with_case = CASES.iter().map(|case| case.kind);
    let without_case = WITHOUT_CASE.iter().map(|(kind, _)| *kind);
    let found = with_case.chain(without_case).map(|kind| SourceName::parse(kind).kind_index());
    let found: BTreeSet<usize> = found.collect();
    let missing = (0..SourceName::KIND_COUNT).filter(|index| !found.contains(index));
    let missing: Vec<usize> = missing.collect();
    assert!(missing.is_empty(), "these lines of REGISTRY have no case: {missing:?}");
}

#[test]
fn a_bad_frame_fails_alone_and_sizes_may_change() {
    let folder = tempfile::tempdir().unwrap();
    CASES.iter().for_each(|case| assert_frames(case.subject(folder.path())));
}

/// Stands for ffmpeg: asks a camera for its video, and passes it on.
const FFMPEG: &str = r#"#!/usr/bin/env python3
import socket
import sys

url = sys.argv[sys.argv.index("-i") + 1]
host, port = url.split("/")[2].split(":")
with socket.create_connection((host, int(port)), 60) as camera:
    camera.sendall(f"DESCRIBE {url}\n".encode())
    while part := camera.recv(65536):
        sys.stdout.buffer.write(part)
        sys.stdout.buffer.flush()
"#;

/// A network camera. A connection ends after two frames, so that the third comes over another one; those to
/// other places than `/front` stay open and silent.
fn network_camera() -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let video = [&b"YUV4MPEG2 W2 H2 F25:1 Cmono\n"[..], &b"FRAME\n\x01\x02\x03\x04".repeat(2)].concat();
    std::thread::spawn(move || {
        let mut silent = Vec::new();
        for stream in listener.incoming().take(MAX_CALLS) {
            let mut stream = stream.unwrap();
            let mut request = String::new();
            // After an error, the request is incomplete.
            BufReader::new(&stream).read_line(&mut request).unwrap_or_default();
            if request == format!("DESCRIBE rtsp://{address}/front\n") {
                stream.write_all(&video).unwrap_or_default();
            } else {
                silent.push(stream);
            }
        }
    });
    address
}

/// The address of the network camera, for the process that reads it.
const CAMERA: &str = "NUNET_SOURCE_TEST_CAMERA";

/// ffmpeg is found by PATH, which no test may change for the others: another process reads the camera.
#[test]
fn a_network_camera_follows_the_rules() {
    if let Ok(address) = std::env::var(CAMERA) {
        assert_returns_nothing("silent network camera", open(&format!("rtsp://{address}/silent")));
        let (source, offer) = alone(open(&format!("rtsp://{address}/front")));
        let name = "network camera";
        assert_frames(Subject { name, source, has_bad_frames: false, has_sizes: false, offer });
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let ffmpeg = folder.path().join("ffmpeg");
    std::fs::write(&ffmpeg, FFMPEG).unwrap();
    std::fs::set_permissions(&ffmpeg, Permissions::from_mode(0o755)).unwrap();
    let path = std::env::var("PATH").unwrap();
    let reader = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "a_network_camera_follows_the_rules", "--nocapture"])
        .env(CAMERA, network_camera().to_string())
        .env("PATH", format!("{}:{path}", folder.path().display()))
        .output()
        .unwrap();
    let [printed, errors] = [&reader.stdout, &reader.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(reader.status.success() && printed.contains("1 passed"), "{printed}{errors}");
}

#[test]
fn after_the_end_every_further_call_is_the_end() {
    let folder = tempfile::tempdir().unwrap();
    for case in CASES.iter().filter(|case| case.has_end) {
        let Subject { name, mut source, .. } = case.subject(folder.path());
        let mut frame = Frame::default();
        for _ in 0..3 {
            assert!(next(source.as_mut(), &mut frame).had_frame(), "{name}");
        }
        for _ in 0..3 {
            assert!(matches!(source.fill(&mut frame), Fill::End | Fill::Nothing), "{name}");
        }
        assert!(matches!(next(source.as_mut(), &mut frame), Fill::End), "{name}");
        assert!(!source.is_waiting(), "{name}");
    }
}

#[test]
fn a_source_that_fails_or_is_truncated_reports_it_once_and_ends() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.mcap");
    write_recording(&path, &[png(2), png(2)]);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 8]).unwrap();
    let cut_pipe =
        open_pipe(Cursor::new(b"YUV4MPEG2 W2 H2 F25:1 Cmono\nFRAME\n123".to_vec()), OpenOptions::default());
    for (name, mut source) in [("recording", open(path.to_str().unwrap())), ("pipe", cut_pipe.unwrap())] {
        let mut frame = Frame::default();
        let end = loop {
            match next(source.as_mut(), &mut frame) {
                Fill::Frame => {}
                end => break end,
            }
        };
        assert!(matches!(end, Fill::Cut(_) | Fill::Broken(_)), "{name}: {end:?}");
        assert!(matches!(next(source.as_mut(), &mut frame), Fill::End), "{name}");
    }
}

/// A pipe that stays open and silent.
struct Silent;

impl Read for Silent {
    fn read(&mut self, _buffer: &mut [u8]) -> std::io::Result<usize> {
        loop {
            std::thread::park();
        }
    }
}

/// Asks on a thread of its own: a source that blocks would block forever.
fn assert_returns_nothing(name: &str, mut source: Box<dyn Source>) {
    let (send, asked) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let fill = source.fill(&mut Frame::default());
        // The source is given back: dropping it ends what it started.
        send.send((matches!(fill, Fill::Nothing), source))
    });
    let (is_nothing, _source) =
        asked.recv_timeout(Duration::from_secs(60)).unwrap_or_else(|_| panic!("{name} blocks"));
    assert!(is_nothing, "{name}");
}

/// No source blocks, so that a stop is noticed between two calls.
#[test]
fn a_source_that_waits_returns_nothing_so_that_a_stop_is_noticed() {
    let waiting = |name: &str| {
        let source = SourceName::parse(name);
        let error = source.open(OpenOptions::default()).err().unwrap();
        source.stand_in(OpenOptions::default(), error)
    };
    let silent = camera("silent");
    let _publisher = publisher(&silent);
    let subjects: [(&str, Box<dyn Source>); 5] = [
        ("silent pipe", open_pipe(Silent, OpenOptions::default()).unwrap()),
        ("silent command", open("exec:sleep 1000")),
        ("missing camera", waiting("/dev/video-of-nobody")),
        ("shared memory of nobody", open(&format!("shm:{}", camera("nobody")))),
        ("shared memory without frames", open(&format!("shm:{silent}"))),
    ];
    for (name, source) in subjects {
        assert_returns_nothing(name, source);
    }
}

#[test]
fn opening_a_long_recording_can_be_canceled() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    write_recording(&path, &[png(2)]);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 30]).unwrap(); // no index
    let stopped = AtomicBool::new(true);
    let options = OpenOptions { stopped: Some(&stopped), ..OpenOptions::default() };
    let start = Instant::now();
    let refused = SourceName::parse(path.to_str().unwrap()).open(options).err();
    assert!(refused.is_some(), "{:?}", start.elapsed());
    stopped.store(false, Ordering::Relaxed);
    assert!(SourceName::parse(path.to_str().unwrap()).open(options).is_ok());
}
