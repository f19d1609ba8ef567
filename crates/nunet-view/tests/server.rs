//! The server as clients see it, on loopback.
#![expect(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use axum::http::StatusCode;
use futures_util::{SinkExt as _, StreamExt as _};
use nunet_types::{
    ImageSize, ObstacleMap, ObstacleSector, PixelFormat, ScaleSource, Units, text_with_causes,
};
use nunet_view::{
    CameraFeed, CameraStatus, DepthInfo, FrameMessage, MetricsServer, OnDemand, RayGrid, Request, Section,
    Token, ViewErrorKind, ViewOptions, ViewServer,
};
use serde_json::{Value, json};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::protocol::CloseFrame;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;

/// No test waits longer for anything.
const TIMEOUT: Duration = Duration::from_secs(60);
const SIZE: ImageSize = ImageSize::new(64, 48);

fn loopback() -> SocketAddr {
    "127.0.0.1:0".parse().unwrap()
}

fn server() -> (ViewServer, CameraFeed) {
    let server = ViewServer::open(loopback(), ViewOptions::default()).unwrap();
    let feed = server.add_camera("front", &["floor".to_owned(), "wall".to_owned()]);
    (server, feed)
}

/// Pixel `(x, y)` of frame `sequence` is `1 + sequence + x / 100` meters away.
fn depth(sequence: u64) -> Vec<f32> {
    let value = |index: u32| 1.0 + sequence as f32 + (index % SIZE.width) as f32 / 100.0;
    (0..SIZE.pixel_count() as u32).map(|index| if index == 0 { f32::NAN } else { value(index) }).collect()
}

const DEPTH_INFO: DepthInfo = DepthInfo {
    size: SIZE,
    units: Units::Metre,
    scale_source: ScaleSource::Metric,
    view: [0.0, 0.0, 1.0, 1.0],
};

fn offer(feed: &mut CameraFeed, sequence: u64) {
    feed.offer(|frame| {
        frame.sequence = sequence;
        frame.total_micros = 5000;
        frame.rays = Some(Arc::new(RayGrid { columns: 2, rows: 2, rays: vec![[-0.5, -0.4]; 4] }));
        frame.set_image(&[128; 64 * 48 * 3], SIZE, 64 * 3, PixelFormat::Rgb8);
        frame.set_depth(&depth(sequence), DEPTH_INFO);
        frame.set_labels(&[1; 64 * 48]);
    });
}

/// The answer to a request, up to its end or to `limit` bytes.
fn ask_up_to(address: SocketAddr, request: &str, limit: u64) -> Vec<u8> {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = Vec::new();
    stream.take(limit).read_to_end(&mut answer).unwrap();
    answer
}

fn get(address: SocketAddr, target: &str, headers: &str) -> Vec<u8> {
    let request = format!("GET {target} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{headers}\r\n");
    ask_up_to(address, &request, u64::MAX)
}

fn head_and_body(answer: &[u8]) -> (String, &[u8]) {
    let end = answer.windows(4).position(|end| end == b"\r\n\r\n").expect("an answer has a head") + 4;
    (String::from_utf8(answer[..end].to_vec()).unwrap(), &answer[end..])
}

fn status_of(answer: &[u8]) -> StatusCode {
    StatusCode::from_bytes(&answer[9..12]).unwrap()
}

fn block_on<T>(future: impl Future<Output = T>) -> T {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async { tokio::time::timeout(TIMEOUT, future).await.expect("it takes too long") })
}

type Socket = WebSocketStream<tokio::net::TcpStream>;

async fn connect(address: SocketAddr) -> Socket {
    let stream = tokio::net::TcpStream::connect(address).await.unwrap();
    tokio_tungstenite::client_async(format!("ws://{address}/ws"), stream).await.unwrap().0
}

async fn say(socket: &mut Socket, request: Value) {
    socket.send(Message::text(request.to_string())).await.unwrap();
}

/// The next report of a type; other messages are skipped.
async fn report(socket: &mut Socket, kind: &str) -> Value {
    loop {
        if let Message::Text(text) = socket.next().await.expect("the connection is closed").unwrap() {
            let report: Value = serde_json::from_str(&text).unwrap();
            if report["type"] == kind {
                return report;
            }
        }
    }
}

/// The close of the server; other messages are skipped.
async fn close(socket: &mut Socket) -> Option<CloseFrame> {
    loop {
        if let Message::Close(close) = socket.next().await.expect("no close came").unwrap() {
            return close;
        }
    }
}

/// The next frame.
async fn frame(socket: &mut Socket) -> Vec<u8> {
    loop {
        if let Message::Binary(bytes) = socket.next().await.expect("the connection is closed").unwrap() {
            return bytes.to_vec();
        }
    }
}

/// Offers frames as a camera of about 200 fps would, until it is dropped.
struct Producer {
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<(u64, CameraFeed)>>,
}

impl Producer {
    fn start(mut feed: CameraFeed) -> Self {
        let stop = Arc::<AtomicBool>::default();
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let mut sequence = 0;
            while !stopped.load(Ordering::Relaxed) {
                if feed.is_wanted() {
                    offer(&mut feed, sequence);
                }
                sequence += 1;
                std::thread::sleep(Duration::from_millis(5));
            }
            (sequence, feed)
        });
        Self { stop, thread: Some(thread) }
    }

    /// How many frames the producer made.
    fn finish(mut self) -> u64 {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap().0
    }
}

#[test]
fn a_viewer_that_is_earlier_than_the_camera_hears_of_it() {
    let server = ViewServer::open(loopback(), ViewOptions::default()).unwrap();
    block_on(async {
        let mut socket = connect(server.address()).await;
        assert_eq!(report(&mut socket, "hello").await["cameras"], json!([]));
        let mut feed = server.add_camera("front", &[]);
        assert_eq!(report(&mut socket, "hello").await["cameras"], json!(["front"]));
        offer(&mut feed, 3);
        say(&mut socket, json!({"type": "watch", "camera": "front"})).await;
        assert!(!frame(&mut socket).await.is_empty());
    });
}

#[test]
fn a_viewer_hears_of_a_camera_that_is_added_again() {
    let (server, mut feed) = server();
    offer(&mut feed, 3);
    block_on(async {
        let mut socket = connect(server.address()).await;
        assert_eq!(report(&mut socket, "hello").await["cameras"], json!(["front"]));
        say(&mut socket, json!({"type": "watch", "camera": "front"})).await;
        frame(&mut socket).await;
        let mut again = server.add_camera("front", &[]);
        assert_eq!(report(&mut socket, "hello").await["cameras"], json!(["front"]));
        offer(&mut again, 9);
        say(&mut socket, json!({"type": "watch", "camera": "front"})).await;
        assert_eq!(FrameMessage::parse(&frame(&mut socket).await).unwrap().sequence, 9);
    });
}

#[test]
fn a_viewer_receives_what_was_offered() {
    let (server, mut feed) = server();
    offer(&mut feed, 3);
    block_on(async {
        let mut socket = connect(server.address()).await;
        let hello = report(&mut socket, "hello").await;
        assert_eq!((&hello["protocol"], &hello["cameras"]), (&json!(1), &json!(["front"])));
        assert_eq!(hello["palette"].as_array().unwrap().len(), 768);
        say(&mut socket, json!({"type": "watch", "camera": "front", "max_width": 32})).await;
        let camera = report(&mut socket, "camera").await;
        assert_eq!((&camera["classes"], &camera["rays"]["columns"]), (&json!(["floor", "wall"]), &json!(2)));
        let bytes = frame(&mut socket).await;
        let frame = FrameMessage::parse(&bytes).unwrap();
        assert_eq!((frame.sequence, frame.total_micros, frame.stride), (3, 5000, 2));
        assert_eq!((frame.depth_size, frame.map_size), (SIZE, ImageSize::new(32, 24)));
        let map = frame.depth().unwrap().unwrap();
        assert!(
            map.values[0].is_nan() && (map.values[32 + 5] / 4.1 - 1.0).abs() < 0.0021,
            "{}",
            map.values[32 + 5]
        );
        assert_eq!(frame.labels().unwrap().unwrap(), [1; 32 * 24]);
        let jpeg = image::load_from_memory(frame.section(Section::Image).unwrap()).unwrap();
        assert_eq!((jpeg.width(), jpeg.height()), (32, 24));
        feed.set_status(CameraStatus { up: true, fps: 12.5, ..CameraStatus::default() });
        let mut status = report(&mut socket, "status").await;
        // The first one may have been sent before.
        if status["status"]["up"] == json!(false) {
            status = report(&mut socket, "status").await;
        }
        assert_eq!((&status["status"]["up"], &status["status"]["fps"]), (&json!(true), &json!(12.5)));
    });
}

#[test]
fn obstacles_are_wanted_and_sent_only_while_a_viewer_shows_them() {
    let (server, mut feed) = server();
    let sectors = [ObstacleSector { range_m: 2.5, ..ObstacleSector::UNKNOWN }; 3];
    feed.offer(|frame| {
        frame.set_depth(&depth(3), DEPTH_INFO);
        frame.set_obstacles(&ObstacleMap {
            sectors: &sectors,
            points: &[],
            angle_min_rad: -0.3,
            angle_step_rad: 0.2,
            max_range_m: 8.0,
        });
    });
    block_on(async {
        let mut socket = connect(server.address()).await;
        say(&mut socket, json!({"type": "watch", "camera": "front"})).await;
        let bytes = frame(&mut socket).await;
        let section = FrameMessage::parse(&bytes).unwrap().section(Section::Obstacles).unwrap().to_vec();
        assert_eq!((section.len(), &section[..4]), (16 + 3 * 8, &[3, 0, 0, 0][..]));
        assert!(feed.wants(OnDemand::Obstacles));
        say(&mut socket, json!({"type": "watch", "camera": "front", "obstacles": false})).await;
        let bytes = frame(&mut socket).await;
        assert_eq!(FrameMessage::parse(&bytes).unwrap().section(Section::Obstacles), None);
        assert!(!feed.wants(OnDemand::Obstacles));
    });
}

#[test]
fn confidence_is_wanted_and_sent_only_while_a_viewer_asks_for_it() {
    let (server, mut feed) = server();
    let confidence: Vec<u8> = (0..SIZE.pixel_count()).map(|index| (index % 64) as u8 * 4).collect();
    feed.offer(|frame| {
        frame.set_depth(&depth(3), DEPTH_INFO);
        frame.set_confidence(&confidence);
    });
    block_on(async {
        let mut socket = connect(server.address()).await;
        say(&mut socket, json!({"type": "watch", "camera": "front"})).await;
        let bytes = frame(&mut socket).await;
        let without = FrameMessage::parse(&bytes).unwrap();
        assert_eq!(without.confidence().unwrap(), None, "a client that does not know it receives none");
        assert!(!feed.wants(OnDemand::Confidence));
        say(&mut socket, json!({"type": "watch", "camera": "front", "confidence": true, "max_width": 32}))
            .await;
        let bytes = frame(&mut socket).await;
        let map = FrameMessage::parse(&bytes).unwrap().confidence().unwrap().unwrap();
        assert_eq!((map.len(), map[0], map[5]), (32 * 24, 0, 40));
        assert!(feed.wants(OnDemand::Confidence));
        say(&mut socket, json!({"type": "probe", "u": 0.999, "v": 0.5})).await;
        assert_eq!(report(&mut socket, "probe").await["confidence"], json!(252));
    });
}

#[test]
fn a_probe_reads_the_exact_depth_of_the_frame_that_is_shown_also_while_paused() {
    let (server, mut feed) = server();
    offer(&mut feed, 3);
    block_on(async {
        let mut socket = connect(server.address()).await;
        say(&mut socket, json!({"type": "watch", "camera": "front"})).await;
        frame(&mut socket).await;
        say(&mut socket, json!({"type": "pause"})).await;
        say(&mut socket, json!({"type": "probe", "u": 0.999, "v": 0.5})).await;
        let probe = report(&mut socket, "probe").await;
        let expected = depth(3)[24 * 64 + 63];
        assert_eq!((&probe["x"], &probe["y"], &probe["label"]), (&json!(63), &json!(24), &json!(1)));
        assert_eq!(probe["confidence"], Value::Null);
        assert_eq!(probe["depth"].as_f64().unwrap() as f32, expected);
        // Newer frames are neither sent nor read.
        offer(&mut feed, 4);
        say(&mut socket, json!({"type": "probe", "u": 0, "v": 0})).await;
        let probe = report(&mut socket, "probe").await;
        assert_eq!((&probe["sequence"], &probe["depth"]), (&json!(3), &Value::Null));
        assert!(!feed.is_wanted(), "nobody waits for a frame");
        assert!(!feed.wants(OnDemand::Labels));
    });
}

#[test]
fn a_stalled_viewer_slows_neither_the_producer_nor_another_viewer() {
    let (server, feed) = server();
    let address = server.address();
    let producer = Producer::start(feed);
    let watch = json!({"type": "watch", "camera": "front", "max_fps": 120, "max_mbit_per_s": 10000});
    let received = block_on(async {
        let mut stalled = connect(address).await;
        say(&mut stalled, watch.clone()).await; // and it never reads
        let mut viewer = connect(address).await;
        say(&mut viewer, watch).await;
        let (mut received, start) = (0, Instant::now());
        while received < 100 && start.elapsed() < TIMEOUT / 2 {
            frame(&mut viewer).await;
            received += 1;
        }
        drop(stalled);
        received
    });
    let produced = producer.finish();
    assert_eq!(received, 100);
    assert!(produced >= received, "{produced} frames");
}

#[test]
fn malformed_requests_are_answered_and_the_connection_is_closed() {
    let (server, _feed) = server();
    block_on(async {
        for (message, expected) in [
            (Message::text("{"), "the request cannot be read"),
            (Message::text(r#"{"type": "watch", "camera": "rear"}"#), "there is no camera `rear`"),
            (Message::text(r#"{"type": "probe", "u": 2, "v": 0}"#), "`u` is 2, expected 0 to 1"),
            (Message::binary(vec![0, 1, 2]), "requests are JSON text"),
        ] {
            let mut socket = connect(server.address()).await;
            socket.send(message).await.unwrap();
            let error = report(&mut socket, "error").await;
            assert!(error["message"].as_str().unwrap().starts_with(expected), "{error}");
            assert!(matches!(socket.next().await, Some(Ok(Message::Close(Some(_))))), "{expected}");
        }
        // Longer than any request; the last ones are also longer than what the server reads.
        for (length, is_text) in [(4097, true), (60_000, true), (100_000, true), (100_000, false)] {
            let text = "x".repeat(length);
            let mut socket = connect(server.address()).await;
            socket.send(if is_text { Message::text(text) } else { Message::binary(text) }).await.unwrap();
            let error = report(&mut socket, "error").await;
            assert_eq!(error["message"], format!("the request has {length} bytes, expected at most 4096"));
            assert_eq!(close(&mut socket).await.map(|close| u16::from(close.code)), Some(1009));
        }
    });
    malformed_frames(server.address());
    assert_eq!(status_of(&get(server.address(), "/", "")), StatusCode::OK, "it still answers");
}

/// Bytes that no WebSocket sends, after a proper handshake.
fn malformed_frames(address: SocketAddr) {
    const PROTOCOL: u16 = 1002;
    let upgrade = format!(
        "GET /ws HTTP/1.1\r\nHost: {address}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    );
    let cases: [(&[u8], u16); 8] = [
        (&[0xff; 64], PROTOCOL),
        (&[0x81, 0x05, b'h', b'e', b'l', b'l', b'o'], PROTOCOL), // not masked
        (&[0x8f, 0x80, 0, 0, 0, 0], PROTOCOL),                   // an unknown opcode
        (&[0x09, 0x80, 0, 0, 0, 0], PROTOCOL),                   // a ping in parts
        (&[0x80, 0x80, 0, 0, 0, 0], PROTOCOL),                   // continues nothing
        (&[0x88, 0x81, 0, 0, 0, 0, 3], PROTOCOL),                // half a code
        // 2^64 bytes are announced.
        (&[0x81, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0], 1009),
        (&[0x81, 0x81, 0, 0, 0, 0, 0xff], 1007), // not UTF-8
    ];
    for (bytes, code) in cases {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        stream.write_all(upgrade.as_bytes()).unwrap();
        stream.write_all(bytes).unwrap();
        // It ends: the server has closed the connection.
        let mut answer = Vec::new();
        let read = stream.read_to_end(&mut answer);
        assert!(answer.starts_with(b"HTTP/1.1 101"), "{read:?}, {bytes:?}");
        let text = String::from_utf8_lossy(&answer);
        assert!(text.contains(r#"{"type":"error","message":""#), "{bytes:?}: {text}");
        let close = [&[0x88_u8, 25][..], &code.to_be_bytes(), b"the request was refused"].concat();
        assert!(answer.ends_with(&close), "{bytes:?}: {text}");
    }
}

#[test]
fn the_close_of_a_client_is_answered() {
    let (server, feed) = server();
    let producer = Producer::start(feed);
    block_on(async {
        for is_watching in [false, true] {
            let mut socket = connect(server.address()).await;
            if is_watching {
                say(&mut socket, json!({"type": "watch", "camera": "front"})).await;
                frame(&mut socket).await;
            }
            let sent = CloseFrame { code: CloseCode::Normal, reason: "done".into() };
            socket.close(Some(sent.clone())).await.unwrap();
            assert_eq!(close(&mut socket).await, Some(sent));
            assert!(socket.next().await.is_none(), "the connection ends");
        }
    });
    producer.finish();
}

#[test]
fn before_the_first_camera_clients_are_asked_to_try_again() {
    let server = ViewServer::open(loopback(), ViewOptions::default()).unwrap();
    let address = server.address();
    for file in ["frame.jpg", "depth.png", "image.mjpeg", "depth.mjpeg"] {
        let answer = get(address, &format!("/front/{file}"), "");
        assert_eq!(status_of(&answer), StatusCode::SERVICE_UNAVAILABLE, "{file}");
        assert_eq!(head_and_body(&answer).1, b"no camera is running yet; try again\n", "{file}");
    }
    block_on(async {
        let mut socket = connect(address).await;
        say(&mut socket, json!({"type": "watch", "camera": "front"})).await;
        let error = report(&mut socket, "error").await;
        assert_eq!(error["message"], "no camera is running yet; try again");
        assert_eq!(close(&mut socket).await.map(|close| u16::from(close.code)), Some(1013));
    });
    let _feed = server.add_camera("front", &[]);
    assert_eq!(status_of(&get(address, "/rear/frame.jpg", "")), StatusCode::NOT_FOUND);
}

#[test]
fn a_camera_can_have_any_name_and_the_page_keeps_its_files() {
    let server = ViewServer::open(loopback(), ViewOptions::default()).unwrap();
    let address = server.address();
    for name in ["page", "api", "ws", "metrics"] {
        let mut feed = server.add_camera(name, &[]);
        offer(&mut feed, 3);
        for file in ["image.mjpeg", "depth.mjpeg"] {
            let request = format!("GET /{name}/{file} HTTP/1.1\r\nHost: {address}\r\n\r\n");
            assert_eq!(status_of(&ask_up_to(address, &request, 20)), StatusCode::OK, "/{name}/{file}");
        }
    }
    let page = String::from_utf8(get(address, "/", "")).unwrap();
    let files: Vec<&str> = page.split('"').filter(|word| word.starts_with('/') && word.len() > 1).collect();
    assert!(files.len() >= 3, "{files:?}");
    for file in files {
        assert_eq!(status_of(&get(address, file, "")), StatusCode::OK, "{file}");
    }
}

#[test]
fn a_request_with_a_value_of_a_wrong_type_states_the_right_one_in_words() {
    const WIDTH: &str = "a whole number from 16 to 32768";
    for (request, expected) in [
        (r#"{"type": "watch", "camera": "a", "max_width": "wide"}"#, WIDTH),
        (r#"{"type": "watch", "camera": "a", "max_width": -1}"#, WIDTH),
        (r#"{"type": "watch", "camera": "a", "max_width": 320.5}"#, WIDTH),
        (r#"{"type": "watch", "camera": "a", "max_width": 5000000000}"#, WIDTH),
        (r#"{"type": "watch", "camera": "a", "max_fps": "fast"}"#, "a number"),
        (r#"{"type": "watch", "camera": "a", "max_mbit_per_s": [3]}"#, "a number"),
        (r#"{"type": "probe", "u": null, "v": 0}"#, "a number"),
        (r#"{"type": "probe", "u": 0, "v": true}"#, "a number"),
        ("null", "an object with `type`"),
        (r#"["watch"]"#, "an object with `camera`"),
    ] {
        let text = text_with_causes(&Request::parse(request).unwrap_err());
        assert!(text.contains(&format!("expected {expected}")), "{request}: {text}");
    }
}

#[test]
fn an_upgrade_that_is_none_and_unknown_paths_are_refused() {
    let (server, _feed) = server();
    let address = server.address();
    assert_eq!(status_of(&get(address, "/ws", "")), StatusCode::BAD_REQUEST);
    assert_eq!(status_of(&get(address, "/nothing", "")), StatusCode::NOT_FOUND);
    assert_eq!(status_of(&get(address, "/_page/../lib.rs", "")), StatusCode::NOT_FOUND);
    assert_eq!(status_of(&get(address, "/_page/%2e%2e%2flib.rs", "")), StatusCode::NOT_FOUND);
    let answer = get(address, "/rear/frame.jpg", "");
    assert!(answer.ends_with(b"there is no camera `rear`, expected one of: `front`\n"));
    let post =
        format!("POST / HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nContent-Length: 0\r\n\r\n");
    assert_eq!(status_of(&ask_up_to(address, &post, 1000)), StatusCode::METHOD_NOT_ALLOWED);
}

#[test]
fn the_newest_frame_is_there_as_files_also_while_the_source_is_paused() {
    let (server, mut feed) = server();
    let address = server.address();
    let answer = get(address, "/front/frame.jpg", "");
    assert_eq!(status_of(&answer), StatusCode::SERVICE_UNAVAILABLE, "there is no frame yet");
    offer(&mut feed, 3);
    let answer = get(address, "/front/depth.png", "");
    let (head, body) = head_and_body(&answer);
    assert!(
        head.contains("content-type: image/png\r\n") && head.contains("x-nunet-sequence: 3\r\n"),
        "{head}"
    );
    let png = image::load_from_memory(body).unwrap();
    let millimeters = png.as_luma16().unwrap();
    assert_eq!((millimeters.get_pixel(0, 0).0, millimeters.get_pixel(10, 20).0), ([0], [4100]));
    let answer = get(address, "/front/frame.jpg", "");
    assert_eq!(image::load_from_memory(head_and_body(&answer).1).unwrap().width(), 64);
    let answer = get(address, "/api/cameras", "");
    let list: Value = serde_json::from_slice(head_and_body(&answer).1).unwrap();
    let camera = &list["cameras"][0];
    assert_eq!(
        (&list["contract"], &camera["name"], &camera["sequence"]),
        (&json!(1), &json!("front"), &json!(3))
    );
    assert_eq!((&camera["depth"], &camera["units"]), (&json!({"width": 64, "height": 48}), &json!("metre")));
}

#[test]
fn a_video_is_one_jpeg_after_the_other() {
    let (server, feed) = server();
    let address = server.address();
    let producer = Producer::start(feed);
    for target in ["/front/image.mjpeg?fps=100&mbit=100", "/front/depth.mjpeg?fps=100&near=1&far=2&width=32"]
    {
        let request = format!("GET {target} HTTP/1.1\r\nHost: {address}\r\n\r\n");
        let answer = ask_up_to(address, &request, 20_000);
        let (head, _) = head_and_body(&answer);
        assert!(head.contains("multipart/x-mixed-replace; boundary=nunet-frame"), "{head}");
        let boundary = b"--nunet-frame\r\nContent-Type: image/jpeg\r\n";
        let parts = answer.windows(boundary.len()).filter(|window| window == boundary).count();
        assert!(parts > 2, "{parts} parts in 20 kB");
    }
    for (target, expected) in [
        ("/front/depth.mjpeg?fps=0", "`fps` is 0, expected more than 0.001, up to 120\n"),
        ("/front/image.mjpeg?mbit=-1", "`mbit` is -1, expected more than 0.001, up to 10000\n"),
        ("/front/image.mjpeg?width=15", "`width` is 15, expected 16 to 32768\n"),
        ("/front/depth.mjpeg?near=inf", "`near` is inf, expected a finite number\n"),
        ("/front/depth.mjpeg?fps=abc", "`fps` is `abc`, expected a number\n"),
        ("/front/depth.mjpeg?far=", "`far` is ``, expected a number\n"),
        ("/front/image.mjpeg?width=-1", "`width` is `-1`, expected a whole number from 16 to 32768\n"),
        ("/front/image.mjpeg?fps=1&fps=2", "`fps` is given twice\n"),
        (
            "/front/depth.mjpeg?color=red",
            "unknown parameter `color`, expected one of: `fps`, `mbit`, `width`, `near`, `far`, `token`\n",
        ),
    ] {
        let answer = get(address, target, "");
        assert_eq!(status_of(&answer), StatusCode::BAD_REQUEST, "{target}");
        assert_eq!(std::str::from_utf8(head_and_body(&answer).1).unwrap(), expected);
    }
    for target in ["/front/depth.mjpeg?fps=x", "/front/depth.mjpeg?color=red"] {
        assert_eq!(status_of(&get(address, target, "")), StatusCode::BAD_REQUEST, "{target}");
    }
    producer.finish();
}

#[test]
fn videos_leave_connections_for_the_page_and_the_metrics() {
    const MOST: usize = 32;
    let (server, feed) = server();
    let address = server.address();
    let producer = Producer::start(feed);
    let request = format!("GET /front/image.mjpeg HTTP/1.1\r\nHost: {address}\r\n\r\n");
    let open = || {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut start = [0; 12];
        stream.read_exact(&mut start).unwrap();
        (status_of(&start), stream)
    };
    let videos: Vec<_> = (0..MOST).map(|_| open()).collect();
    assert!(videos.iter().all(|(status, _)| *status == StatusCode::OK));
    for _ in 0..3 {
        assert_eq!(open().0, StatusCode::SERVICE_UNAVAILABLE);
    }
    for target in ["/", "/api/cameras", "/front/frame.jpg"] {
        assert_eq!(status_of(&get(address, target, "")), StatusCode::OK, "{target}");
    }
    drop(videos);
    // The server notices it when it sends the next image.
    let deadline = Instant::now() + TIMEOUT;
    while open().0 != StatusCode::OK {
        assert!(Instant::now() < deadline, "the places of the videos stay taken");
    }
    producer.finish();
}

#[test]
fn relative_depth_has_no_millimeters() {
    let (server, mut feed) = server();
    let info = DepthInfo {
        size: SIZE,
        units: Units::Relative,
        scale_source: ScaleSource::Relative,
        view: [0.0, 0.0, 1.0, 1.0],
    };
    feed.offer(|frame| frame.set_depth(&depth(0), info));
    assert_eq!(status_of(&get(server.address(), "/front/depth.png", "")), StatusCode::CONFLICT);
}

#[test]
fn every_request_without_the_token_is_refused() {
    let options = ViewOptions {
        token: Some(Token::new("open-sesame").unwrap()),
        metrics: Some(Arc::new(|| "# EOF\n".to_owned())),
    };
    let server = ViewServer::open(loopback(), options).unwrap();
    let _feed = server.add_camera("front", &[]);
    let address = server.address();
    let targets =
        ["/", "/api/cameras", "/metrics", "/ws", "/front/frame.jpg", "/front/image.mjpeg", "/_page/main.js"];
    for target in targets {
        for (suffix, headers) in [
            ("", ""),
            ("?token=open-sesam", ""),
            ("?token=", ""),
            ("", "Authorization: Bearer wrong\r\n"),
            ("", "Cookie: nunet_view_1=open-sesame\r\n"),
        ] {
            let answer = get(address, &format!("{target}{suffix}"), headers);
            assert_eq!(status_of(&answer), StatusCode::UNAUTHORIZED, "{target}{suffix} {headers}");
        }
    }
    let bearer = "Authorization: Bearer open-sesame\r\n";
    assert_eq!(status_of(&get(address, "/api/cameras", bearer)), StatusCode::OK);
    assert_eq!(status_of(&get(address, "/metrics?token=open-sesame", "")), StatusCode::OK);
    let signed_in = head_and_body(&get(address, "/?token=open-sesame", "")).0;
    assert!(signed_in.starts_with("HTTP/1.1 303") && signed_in.contains("location: /\r\n"), "{signed_in}");
    let cookie = signed_in.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
    assert!(cookie.ends_with("; Path=/; HttpOnly; SameSite=Strict"), "{cookie}");
    let cookie = format!("Cookie: {}\r\n", cookie.split(';').next().unwrap());
    assert_eq!(status_of(&get(address, "/", &cookie)), StatusCode::OK);
    let page = get(address, "/", "Accept: text/html\r\n");
    assert!(status_of(&page) == StatusCode::UNAUTHORIZED && page.windows(5).any(|word| word == b"Token"));
}

#[test]
fn requests_of_other_sites_are_refused_and_responses_forbid_foreign_content() {
    let (server, _feed) = server();
    let address = server.address();
    let head = head_and_body(&get(address, "/", "")).0;
    for header in [
        "content-security-policy: default-src 'none';",
        "x-content-type-options: nosniff",
        "cache-control: no-store",
    ] {
        assert!(head.contains(header), "{header} is not in\n{head}");
    }
    let foreign = get(address, "/api/cameras", "Origin: http://evil.example\r\n");
    assert_eq!(status_of(&foreign), StatusCode::FORBIDDEN);
    let rebound = "GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n";
    assert_eq!(status_of(&ask_up_to(address, rebound, 1000)), StatusCode::MISDIRECTED_REQUEST);
}

#[test]
fn an_address_for_other_machines_needs_a_token() {
    let address = "0.0.0.0:0".parse().unwrap();
    let error = ViewServer::open(address, ViewOptions::default()).err().unwrap();
    assert_eq!(error.kind(), ViewErrorKind::Token);
}

#[test]
fn the_metrics_alone_are_at_one_address_only() {
    let server = MetricsServer::open(loopback(), Arc::new(|| "a 1\n# EOF\n".to_owned())).unwrap();
    let address = server.address();
    let answer = get(address, "/metrics?name[]=a", "");
    let (head, body) = head_and_body(&answer);
    assert!(head.contains("content-type: application/openmetrics-text; version=1.0.0"), "{head}");
    assert_eq!(body, b"a 1\n# EOF\n");
    assert!(get(address, "/", "").ends_with(b"metrics are at /metrics\n"));
}

/// A server that serves one connection after another answers only after it has closed the idle ones.
#[test]
fn metrics_are_served_beside_idle_connections_which_stay_open() {
    let server = MetricsServer::open(loopback(), Arc::new(|| "a 1\n# EOF\n".to_owned())).unwrap();
    let address = server.address();
    let connect = |begun: &&str| {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        stream.write_all(begun.as_bytes()).unwrap();
        stream
    };
    let begun = ["", "", "", "GET /met", "GET /metrics HTTP/1.1\r\nHost:"];
    let idle: Vec<TcpStream> = begun.iter().map(connect).collect();
    assert!(get(address, "/metrics", "").ends_with(b"a 1\n# EOF\n"));
    let request = format!("GET /metrics HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    for (mut stream, begun) in idle.into_iter().zip(begun) {
        stream.write_all(&request.as_bytes()[begun.len()..]).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        assert!(answer.ends_with(b"a 1\n# EOF\n"), "after {begun:?}: {}", String::from_utf8_lossy(&answer));
    }
}

#[test]
fn a_head_request_gets_the_head_of_the_metrics() {
    let server = MetricsServer::open(loopback(), Arc::new(|| "a 1\n# EOF\n".to_owned())).unwrap();
    let address = server.address();
    for target in ["/metrics", "/metrics?name[]=a"] {
        let request = format!("HEAD {target} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
        let answer = ask_up_to(address, &request, u64::MAX);
        assert_eq!(status_of(&answer), StatusCode::OK, "{target}");
        let (head, body) = head_and_body(&answer);
        assert!(head.contains("content-type: application/openmetrics-text; version=1.0.0"), "{head}");
        assert!(head.contains("content-length: 10\r\n"), "{head}");
        assert_eq!(body, b"", "{target}");
    }
}
