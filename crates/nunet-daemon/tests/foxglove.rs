//! `--foxglove`: messages over the WebSocket have the values of shared memory.

use std::net::TcpListener;
use std::time::Duration;

use futures_util::StreamExt as _;
use nunet_ipc::{CameraName, Reader, Topic};
use nunet_mcap::{RecordedImage, TopicDecoder};
use serde_json::Value;
use tokio_tungstenite::tungstenite::Message;

use crate::foxglove_subscription::subscribe;
use crate::support::{Bench, Guarded, TIMEOUT, camera, nunetd, run, text, wait_for};

#[test]
fn depth_in_foxglove_is_that_of_shared_memory() {
    let bench = Bench::new();
    (0..3).for_each(|number| bench.add_image(&format!("images/{number}.png"), number));
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let (model, images, name) = (bench.arg("model.onnx"), bench.arg("images"), camera("foxglove"));
    let mut command = nunetd(&["-q", "--model", &model, "--source", &images, "--loop", "--rate", "10"]);
    let stats = bench.arg("stats.json");
    command.args(["--camera", &name, "--foxglove", &format!("127.0.0.1:{port}"), "--stats-json", &stats]);
    let mut daemon = Guarded::start(command);
    let mut reader = Reader::open(&CameraName::new(&name).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    wait_for("the server", || std::net::TcpStream::connect(("127.0.0.1", port)).ok());
    let topic = format!("/{name}/depth/image_raw");
    let decoder = TopicDecoder::new(&topic, "sensor_msgs/msg/Image").unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let mut socket = runtime.block_on(async {
        tokio::time::timeout(TIMEOUT, subscribe(([127, 0, 0, 1], port).into(), &topic))
            .await
            .expect("it takes too long")
    });
    let (mut published, mut compared) = (Vec::new(), 0);
    while compared < 5 {
        let next = async { tokio::time::timeout(TIMEOUT, socket.next()).await.expect("no message comes") };
        let message = runtime.block_on(next).unwrap().unwrap();
        while let Some(set) = reader.next_set().unwrap() {
            let map = set.get(Topic::Depth).unwrap();
            published.push((map.header().capture_unix_nanos, map.depth().unwrap().to_vec()));
        }
        let Message::Binary(data) = message else {
            let report = message.to_text().unwrap();
            assert!(!report.contains("Unknown channel"), "{report}");
            continue;
        };
        let mut image = RecordedImage::default();
        decoder.image(&data[13..], &mut image).unwrap();
        let Some((_, depth)) = published.iter().find(|(stamp, _)| *stamp == image.stamp_nanos) else {
            reader.wait(Duration::from_millis(10)).unwrap();
            continue;
        };
        assert_eq!(&image.depth_m(), depth);
        compared += 1;
    }
    assert_eq!(daemon.stop(), Some(0));
    let stats: Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
    assert!(stats["foxglove"]["sent"].as_u64() > Some(0), "{stats}");
    assert!(stats.get("ros2").is_none(), "{stats}");
}

#[test]
fn an_address_in_use_or_reachable_by_others_is_an_error_before_the_model_is_loaded() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let bench = Bench::new();
    std::fs::write(bench.path("model.onnx"), "no model").unwrap();
    let model = bench.arg("model.onnx");
    for (address, code, expected) in [
        (address.as_str(), 1, "os error 98"),
        ("0.0.0.0:8765", 2, "--foxglove-public"),
        ("localhost", 2, "`localhost`"),
    ] {
        let output = run(nunetd(&["-q", "--model", &model, "--source", "demo", "--foxglove", address]));
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{error}");
        assert!(error.contains(expected) && !error.contains("model.onnx"), "{error}");
    }
    let output = run(nunetd(&["-q", "--model", &model, "--source", "demo", "--foxglove-public"]));
    assert!(
        ["`--foxglove-public`", "`--foxglove`"].iter().all(|flag| text(&output.stderr).contains(*flag)),
        "{}",
        text(&output.stderr)
    );
}
