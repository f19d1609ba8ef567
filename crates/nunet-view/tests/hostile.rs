//! Damaged requests and frames: an error, never a panic. libFuzzer runs the same functions.
#![expect(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

#[expect(unreachable_pub, reason = "the fuzz targets are another crate")]
#[path = "../../../fuzz/src/view.rs"]
mod body;

use futures_util::{SinkExt as _, StreamExt as _};
use nunet_testkit::hostile::{feed_damaged, greedy_texts, keep_for_fuzzing};
use nunet_types::{ImageSize, ScaleSource, Units};
use nunet_view::{DepthInfo, ViewOptions, ViewServer};
use tokio_tungstenite::tungstenite::Message;

const REQUESTS: [&str; 3] = [
    r#"{"type": "watch", "camera": "front", "labels": false, "max_width": 640, "max_fps": 15, "max_mbit_per_s": 3}"#,
    r#"{"type": "probe", "u": 0.25, "v": 1}"#,
    r#"{"type": "pause"}"#,
];

/// A frame of 4x2 pixels, as the server sends it.
fn sent_frame() -> Vec<u8> {
    let server = ViewServer::open("127.0.0.1:0".parse().unwrap(), ViewOptions::default()).unwrap();
    let mut feed = server.add_camera("front", &[]);
    let size = ImageSize::new(4, 2);
    let info = DepthInfo {
        size,
        units: Units::Metre,
        scale_source: ScaleSource::Metric,
        view: [0.0, 0.0, 1.0, 1.0],
    };
    feed.offer(|frame| {
        frame.set_depth(&[1.0, 1.1, 1.2, f32::NAN, 2.0, 2.1, 2.2, 2.3], info);
        frame.set_labels(&[0, 0, 1, 1, 2, 2, 3, 3]);
        frame.set_confidence(&[9, 0, 1, 1, 200, 2, 3, 255]);
    });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let stream = tokio::net::TcpStream::connect(server.address()).await.unwrap();
        let url = format!("ws://{}/ws", server.address());
        let (mut socket, _) = tokio_tungstenite::client_async(url, stream).await.unwrap();
        socket
            .send(Message::text(r#"{"type": "watch", "camera": "front", "confidence": true}"#))
            .await
            .unwrap();
        while let Some(message) = socket.next().await {
            if let Message::Binary(bytes) = message.unwrap() {
                return bytes.to_vec();
            }
        }
        panic!("the connection was closed before a frame came");
    })
}

#[test]
fn damaged_and_oversized_requests_are_errors() {
    for (index, request) in REQUESTS.iter().enumerate() {
        keep_for_fuzzing("view_request", &index.to_string(), request.as_bytes());
        feed_damaged("request", request.as_bytes(), body::request);
    }
    for text in greedy_texts() {
        body::request(text.as_bytes());
        let short = text.get(..4000).unwrap_or(&text);
        body::request(short.as_bytes());
    }
}

#[test]
fn damaged_frames_are_errors() {
    let bytes = sent_frame();
    let frame = nunet_view::FrameMessage::parse(&bytes).unwrap();
    assert!(
        frame.depth().unwrap().is_some()
            && frame.labels().unwrap().is_some()
            && frame.confidence().unwrap().is_some(),
        "the frame is a whole one"
    );
    keep_for_fuzzing("view_message", "frame", &bytes);
    feed_damaged("frame", &bytes, body::message);
}
