//! The server as a client sees it, on loopback.
#![cfg(feature = "server")]
#![expect(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

use std::collections::BTreeMap;
use std::io::Write as _;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use futures_util::{SinkExt as _, StreamExt as _};
use nunet_core::camera::{Camera, Intrinsics};
use nunet_core::depth::{DepthEncoding, Scale};
use nunet_foxglove::{
    FoxgloveConfig, FoxgloveServer, FoxgloveServerErrorKind, MAX_CLIENT_BYTES, MAX_CLIENTS,
};
use nunet_mcap::ros::definition;
use nunet_mcap::{CameraMount, RecordedImage, TopicDecoder};
use nunet_ros2::CameraOptions;
use nunet_sink::results::Results;
use nunet_sink::sink::{PublishedFrame, Sink, Status, Timings, Wants};
use nunet_source::Frame;
use nunet_telemetry::{Counts, MessageCounts, Totals};
use nunet_types::{Hint as _, ImageSize, PixelRect};
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;

/// No test waits longer for anything.
const TIMEOUT: Duration = Duration::from_secs(60);
const SIZE: ImageSize = ImageSize::new(64, 48);
const FREE_PORT: &str = "127.0.0.1:0";

fn server() -> FoxgloveServer {
    let config = FoxgloveConfig { address: FREE_PORT.parse().unwrap(), is_public: false };
    FoxgloveServer::open(config, 2).unwrap()
}

fn camera(server: &FoxgloveServer, name: &str) -> Box<dyn Sink> {
    let mount = CameraMount { translation_m: [0.1, 0.0, 0.5], roll_pitch_yaw_rad: [0.0; 3] };
    let options = CameraOptions {
        name,
        frame_id: "eye",
        classes: &["floor".to_owned()],
        mount: Some(mount),
        has_labels: true,
        has_confidence: false,
        has_obstacles: false,
        counts: &MessageCounts::default(),
        about: &[],
    };
    server.add_camera(&options).unwrap()
}

fn depth(number: u64) -> Vec<f32> {
    (0..SIZE.pixel_count()).map(|index| if index == 0 { f32::NAN } else { number as f32 + 0.5 }).collect()
}

/// Publishes frame `number`, which was captured `number` seconds after 1970.
fn give(sink: &mut dyn Sink, number: u64) {
    let mut frame = Frame::default();
    frame.rgb_buffer(SIZE).fill(number as u8);
    frame.capture.unix_nanos = number as i64 * 1_000_000_000;
    let intrinsics = Intrinsics::new(50.0, 50.0, 31.5, 23.5, SIZE.width, SIZE.height).unwrap();
    let (depth, labels) = (depth(number), vec![7; SIZE.pixel_count()]);
    let results = Results {
        scale: Scale::unscaled(DepthEncoding::Metric),
        size: SIZE,
        depth: &depth,
        labels: sink.wants().labels.then_some(labels.as_slice()),
        confidence: None,
        cloud_size: SIZE,
        cloud: None,
        camera: Some(Camera::pinhole(intrinsics)),
        view: PixelRect::whole(SIZE),
        obstacles: None,
        obstacle_frame: "base_link",
        roll_pitch_rad: None,
    };
    let timings = Timings { total_micros: 9, queue_micros: 1, inner_micros: &[5], publish_micros: 3 };
    sink.on_frame(&PublishedFrame { frame: &frame, camera: None, results, timings });
}

fn block_on<T>(future: impl Future<Output = T>) -> T {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async { tokio::time::timeout(TIMEOUT, future).await.expect("it takes too long") })
}

/// A connection; none if it is refused.
async fn handshake(address: SocketAddr) -> Option<WebSocketStream<TcpStream>> {
    let stream = TcpStream::connect(address).await.unwrap();
    let mut request = format!("ws://{address}/").into_client_request().unwrap();
    request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
    Some(tokio_tungstenite::client_async(request, stream).await.ok()?.0)
}

/// Reads until the server closes the connection.
async fn read_to_end(stream: &mut TcpStream) {
    let mut bytes = [0; 4096];
    while stream.read(&mut bytes).await.is_ok_and(|length| length > 0) {}
}

/// A client, and the channels that it knows.
struct Client {
    socket: WebSocketStream<TcpStream>,
    channels: BTreeMap<String, Value>,
}

impl Client {
    /// Connects, and waits for `channels` channels.
    async fn connect(address: SocketAddr, channels: usize) -> Self {
        let socket = handshake(address).await.expect("it is refused");
        let mut client = Self { socket, channels: BTreeMap::new() };
        while client.channels.len() < channels {
            let advertised = client.report("advertise").await;
            for channel in advertised["channels"].as_array().unwrap() {
                client.channels.insert(channel["topic"].as_str().unwrap().to_owned(), channel.clone());
            }
        }
        client
    }

    async fn say(&mut self, request: Value) {
        self.socket.send(Message::text(request.to_string())).await.unwrap();
    }

    /// The next report of an operation; other messages are skipped.
    async fn report(&mut self, operation: &str) -> Value {
        loop {
            if let Message::Text(text) = self.socket.next().await.expect("it is closed").unwrap() {
                let report: Value = serde_json::from_str(&text).unwrap();
                if report["op"] == operation {
                    return report;
                }
            }
        }
    }

    /// The subscription has the number of the channel.
    async fn subscribe(&mut self, topic: &str) -> u32 {
        let id = self.channels[topic]["id"].as_u64().unwrap();
        self.say(json!({"op": "subscribe", "subscriptions": [{"id": id, "channelId": id}]})).await;
        id as u32
    }

    /// The next message of a subscription within a moment.
    async fn message(&mut self, subscription: u32) -> Option<Vec<u8>> {
        let received = async {
            loop {
                match self.socket.next().await.expect("it is closed").unwrap() {
                    // An operation code, the subscription, the time, the message.
                    Message::Binary(data) if data[0] == 1 && data[1..5] == subscription.to_le_bytes() => {
                        return data[13..].to_vec();
                    }
                    _ => {}
                }
            }
        };
        tokio::time::timeout(Duration::from_millis(20), received).await.ok()
    }

    /// The first message of a subscription, while frames are given to `sink`.
    async fn message_of(&mut self, sink: &mut dyn Sink, subscription: u32) -> Vec<u8> {
        for number in 1.. {
            give(sink, number);
            if let Some(message) = self.message(subscription).await {
                return message;
            }
        }
        unreachable!("the caller has a timeout")
    }
}

fn decoded(topic: &str, message: &[u8]) -> RecordedImage {
    let mut image = RecordedImage::default();
    let decoder = TopicDecoder::new(topic, "sensor_msgs/msg/Image").unwrap();
    decoder.image(message, &mut image).unwrap();
    image
}

const TOPICS: [&str; 7] = [
    "/front/camera_info",
    "/front/depth/camera_info",
    "/front/depth/image_raw",
    "/front/depth/points",
    "/front/image_raw/compressed",
    "/front/labels/image_raw",
    "/tf_static",
];

#[test]
fn a_client_finds_the_channels_of_a_recording_and_receives_the_values_of_a_frame() {
    let server = server();
    let mut sink = camera(&server, "front");
    assert_eq!(sink.messages().map(|(output, _)| output), Some("foxglove"));
    block_on(async {
        let mut client = Client::connect(server.address(), TOPICS.len()).await;
        assert_eq!(client.channels.keys().map(String::as_str).collect::<Vec<_>>(), TOPICS);
        for channel in client.channels.values() {
            let name = channel["schemaName"].as_str().unwrap();
            assert_eq!(channel["encoding"], "cdr");
            assert_eq!(
                (&channel["schemaEncoding"], channel["schema"].as_str()),
                (&json!("ros2msg"), definition(name))
            );
        }
        let subscription = client.subscribe("/front/depth/image_raw").await;
        let message = client.message_of(sink.as_mut(), subscription).await;
        let image = decoded("/front/depth/image_raw", &message);
        let number = image.stamp_nanos / 1_000_000_000;
        assert_eq!((image.width, image.height, image.frame_id.as_str()), (SIZE.width, SIZE.height, "eye"));
        let expected = depth(number.try_into().unwrap());
        let same = |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits();
        assert!(image.depth_m().iter().zip(&expected).all(same), "{:?}", &image.depth_m()[..3]);
    });
}

#[test]
fn nothing_is_wanted_without_a_subscription() {
    let server = server();
    let mut sink = camera(&server, "front");
    let wants = |sink: &dyn Sink, labels: bool| {
        let start = Instant::now();
        while sink.wants().labels != labels {
            assert!(start.elapsed() < TIMEOUT, "{:?}", sink.wants());
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    block_on(async {
        let mut client = Client::connect(server.address(), TOPICS.len()).await;
        give(sink.as_mut(), 1);
        assert_eq!(sink.wants(), Wants::default(), "a client alone wants nothing");
        let subscription = client.subscribe("/front/labels/image_raw").await;
        let message = client.message_of(sink.as_mut(), subscription).await;
        assert_eq!(decoded("/front/labels/image_raw", &message).data, [7; 64 * 48]);
        assert_eq!(sink.wants(), Wants { labels: true, ..Wants::default() });
    });
    wants(sink.as_ref(), false);
}

#[test]
fn a_client_that_subscribes_later_gets_the_transforms_of_all_cameras() {
    let server = server();
    let _cameras = ["front", "rear"].map(|name| camera(&server, name));
    block_on(async {
        let mut client = Client::connect(server.address(), 2 * TOPICS.len() - 1).await;
        let subscription = client.subscribe("/tf_static").await;
        let mut received = 0;
        while received < 2 {
            received += usize::from(client.message(subscription).await.is_some());
        }
    });
}

#[test]
fn clients_that_stall_die_or_send_nonsense_do_not_disturb_others() {
    let server = server();
    let mut sink = camera(&server, "front");
    block_on(async {
        let mut stalled = Client::connect(server.address(), TOPICS.len()).await;
        for topic in TOPICS {
            stalled.subscribe(topic).await;
        }
        let mut dying = Client::connect(server.address(), TOPICS.len()).await;
        dying.subscribe("/front/depth/image_raw").await;
        drop(dying);
        let mut confused = Client::connect(server.address(), TOPICS.len()).await;
        confused.socket.send(Message::text("no JSON")).await.unwrap();
        confused
            .socket
            .send(Message::text(r#"{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}"#))
            .await
            .unwrap();
        for bytes in [vec![], vec![0xff; 10], vec![1], vec![2, 0, 0]] {
            confused.socket.send(Message::binary(bytes)).await.unwrap();
        }
        // A frame that is no frame, and a request that is no request.
        let raw = confused.socket.get_mut();
        raw.writable().await.unwrap();
        raw.try_write(&[0xf7; 64]).unwrap();
        let mut other_client = std::net::TcpStream::connect(server.address()).unwrap();
        other_client.write_all(&[0; 64]).unwrap();
        let mut good = Client::connect(server.address(), TOPICS.len()).await;
        let subscription = good.subscribe("/front/depth/image_raw").await;
        for number in 0..2000 {
            give(sink.as_mut(), number);
        }
        let message = good.message_of(sink.as_mut(), subscription).await;
        assert_eq!(decoded("/front/depth/image_raw", &message).depth_m().len(), SIZE.pixel_count());
    });
    drop(sink);
    drop(server);
}

#[test]
fn more_clients_than_the_limit_are_refused_until_one_leaves() {
    let server = server();
    block_on(async {
        let mut clients = Vec::new();
        for _ in 0..MAX_CLIENTS {
            clients.push(Client::connect(server.address(), 0).await);
        }
        assert!(handshake(server.address()).await.is_none());
        drop(clients.pop());
        while handshake(server.address()).await.is_none() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    });
}

#[test]
fn a_connection_without_a_complete_request_is_closed() {
    let server = server();
    block_on(async {
        let mut silent = Vec::new();
        for request in ["", "\r\n\r\n", "GET / HTTP/1.1\r\nHost: robot\r\n"] {
            let mut stream = TcpStream::connect(server.address()).await.unwrap();
            stream.write_all(request.as_bytes()).await.unwrap();
            silent.push(stream);
        }
        for stream in &mut silent {
            read_to_end(stream).await;
        }
    });
}

#[test]
fn a_client_that_does_not_finish_a_message_is_disconnected() {
    let server = server();
    block_on(async {
        let mut socket = handshake(server.address()).await.unwrap();
        let stream = socket.get_mut();
        // A masked binary message of 48 MiB: the library would take up to 64 MiB.
        let header = [[0x82, 0xff].as_slice(), &(48_u64 << 20).to_be_bytes(), &[0; 4]].concat();
        stream.write_all(&header).await.unwrap();
        let mut sent = 0;
        while sent < 4 * MAX_CLIENT_BYTES && stream.write_all(&[0; 1 << 16]).await.is_ok() {
            sent += 1 << 16;
        }
        read_to_end(stream).await;
        assert!(handshake(server.address()).await.is_some(), "others are served");
    });
}

#[test]
fn rate_and_scale_can_be_read_and_not_be_changed() {
    let server = server();
    let mut sink = camera(&server, "front");
    give(sink.as_mut(), 1);
    let totals = Totals::default();
    sink.on_status(&Status { is_up: true, counts: &Counts::default(), totals: &totals });
    block_on(async {
        let mut client = Client::connect(server.address(), TOPICS.len()).await;
        let change = json!([{"name": "/front/scale_factor", "value": 5.0}]);
        client.say(json!({"op": "setParameters", "parameters": change, "id": "1"})).await;
        let answer = client.report("parameterValues").await;
        assert_eq!(
            answer["parameters"],
            json!([{"name": "/front/scale_factor", "type": "float64", "value": 1.0}])
        );
        client.say(json!({"op": "getParameters", "parameterNames": [], "id": "2"})).await;
        let answer = client.report("parameterValues").await;
        let names: Vec<_> =
            answer["parameters"].as_array().unwrap().iter().map(|one| one["name"].clone()).collect();
        assert_eq!(names, ["/front/rate_hz", "/front/scale_factor", "/front/scale_source", "/front/units"]);
        assert_eq!(answer["parameters"][3]["value"], "metre");
    });
}

#[test]
fn a_port_in_use_is_an_error_with_a_hint_and_free_again_after_a_drop() {
    let first = server();
    let config = FoxgloveConfig { address: first.address(), is_public: false };
    let error = FoxgloveServer::open(config, 1).err().unwrap();
    assert_eq!(error.kind(), FoxgloveServerErrorKind::Address);
    assert!(error.hint().unwrap().contains("another port"));
    drop(first);
    assert!(FoxgloveServer::open(config, 1).is_ok());
}
