//! Recordings of every kind, cut off anywhere and damaged: an error or images, never a panic, never a
//! mixture.
#![expect(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

#[expect(unreachable_pub, reason = "the fuzz targets are another crate")]
#[path = "../../../fuzz/src/recording.rs"]
mod body;

use std::collections::BTreeMap;
use std::io::Cursor;

use foxglove::Encode;
use foxglove::messages::{CameraCalibration, CompressedImage, RawImage, Timestamp};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use nunet_testkit::hostile;
use proptest::prelude::*;

/// The smallest PNG: one gray pixel.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\0\0\0\0:~\x9bU\0\0\0\nIDAT\x08\xd7ch\0\0\0\x82\0\x81\xddCj\xf4\0\0\0\0IEND\xaeB`\x82";

/// One message: topic, schema, encoding, bytes.
type Message = (&'static str, &'static str, &'static str, Vec<u8>);

fn text(text: &str, cdr: &mut Vec<u8>) {
    cdr.resize(cdr.len().next_multiple_of(4), 0);
    cdr.extend((text.len() as u32 + 1).to_le_bytes());
    cdr.extend(text.as_bytes());
    cdr.push(0);
}

fn words(words: &[u32], cdr: &mut Vec<u8>) {
    cdr.resize(cdr.len().next_multiple_of(4), 0);
    cdr.extend(words.iter().flat_map(|word| word.to_le_bytes()));
}

/// ROS 2's messages in CDR, laid out by hand; the four bytes in front do not count for alignment.
fn cdr(lay: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut body = Vec::new();
    words(&[7, 8], &mut body);
    text("eye", &mut body);
    lay(&mut body);
    [&[0, 1, 0, 0][..], &body].concat()
}

fn ros_messages() -> Vec<Message> {
    let image = |encoding: &'static str, step: u32| {
        cdr(|body| {
            words(&[2, 4], body);
            text(encoding, body);
            body.push(0);
            words(&[step, 2 * step], body);
            body.extend(vec![5; 2 * step as usize]);
        })
    };
    let file = cdr(|body| {
        text("png", body);
        words(&[PNG.len() as u32], body);
        body.extend(PNG);
    });
    let info = cdr(|body| {
        words(&[2, 4], body);
        text("plumb_bob", body);
        words(&[5], body);
        // Doubles stand at multiples of eight.
        body.resize(body.len().next_multiple_of(8), 0);
        let k = [5.0, 0.0, 2.0, 0.0, 5.0, 1.0, 0.0, 0.0, 1.0];
        let p = [5.0, 0.0, 2.0, 0.0, 0.0, 5.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let numbers = [0.1, 0.0, 0.0, 0.0, 0.0].into_iter().chain(k).chain(k).chain(p);
        body.extend(numbers.flat_map(f64::to_le_bytes));
        words(&[0; 6], body);
        body.push(0);
    });
    vec![
        ("/eye/camera_info", "sensor_msgs/msg/CameraInfo", "cdr", info),
        ("/eye/image_raw", "sensor_msgs/msg/Image", "cdr", image("rgba8", 16)),
        ("/eye/image_raw", "sensor_msgs/msg/Image", "cdr", image("uyvy", 8)),
        ("/eye/depth/image_raw", "sensor_msgs/msg/Image", "cdr", image("32FC1", 16)),
        ("/eye/image_raw", "sensor_msgs/msg/CompressedImage", "cdr", file),
    ]
}

fn foxglove_messages(encoding: &'static str) -> Vec<Message> {
    fn encoded<T: Encode + serde::Serialize>(encoding: &str, message: &T) -> Vec<u8>
    where
        T::Error: std::fmt::Debug,
    {
        let mut bytes = Vec::new();
        match encoding {
            "json" => bytes = serde_json::to_vec(message).unwrap(),
            _ => message.encode(&mut bytes).unwrap(),
        }
        bytes
    }
    let timestamp = Some(Timestamp::new(3, 5));
    let raw = RawImage {
        timestamp,
        frame_id: "eye".into(),
        width: 2,
        height: 2,
        encoding: "nv12".into(),
        step: 2,
        data: vec![7; 6].into(),
    };
    let file = CompressedImage {
        timestamp,
        frame_id: "eye".into(),
        data: PNG.to_vec().into(),
        format: "png".into(),
    };
    let camera = CameraCalibration {
        timestamp,
        frame_id: "eye".into(),
        width: 2,
        height: 2,
        distortion_model: "kannala_brandt".into(),
        d: vec![0.1, 0.2, 0.0, 0.0],
        k: vec![5.0, 0.0, 1.0, 0.0, 5.0, 1.0, 0.0, 0.0, 1.0],
        ..CameraCalibration::default()
    };
    vec![
        ("/calibration", "foxglove.CameraCalibration", encoding, encoded(encoding, &camera)),
        ("/image", "foxglove.RawImage", encoding, encoded(encoding, &raw)),
        ("/image", "foxglove.CompressedImage", encoding, encoded(encoding, &file)),
    ]
}

fn file(options: WriteOptions, messages: &[Message]) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let mut writer = options.create(&mut file).unwrap();
    for (log_time, (topic, schema, encoding, data)) in (1..).zip(messages) {
        let schema = writer.add_schema(schema, "none", b"").unwrap();
        let channel_id = writer.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    file.into_inner()
}

fn chunks(compression: Option<Compression>) -> WriteOptions {
    WriteOptions::new().compression(compression).compression_threads(0).chunk_size(Some(200))
}

/// Every kind of message in every kind of file.
fn files() -> Vec<(String, Vec<u8>)> {
    let messages = [
        ("cdr", ros_messages()),
        ("protobuf", foxglove_messages("protobuf")),
        ("json", foxglove_messages("json")),
    ];
    let mut all = Vec::new();
    for (name, messages) in messages {
        let unindexed =
            chunks(Some(Compression::Zstd)).emit_summary_records(false).emit_summary_offsets(false);
        for (how, options) in [
            ("no_chunks", WriteOptions::new().use_chunks(false)),
            ("plain", chunks(None)),
            ("zstd", chunks(Some(Compression::Zstd))),
            ("lz4", chunks(Some(Compression::Lz4))),
            ("no_index", unindexed),
        ] {
            all.push((format!("{name}_{how}"), file(options, &messages)));
        }
    }
    all
}

/// `NUNET_CORPUS=fuzz/corpus` leaves them there for the fuzzers to begin with.
#[test]
fn every_kind_of_recording_is_read_before_it_is_damaged() {
    for (name, bytes) in files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        std::fs::write(&path, &bytes).unwrap();
        let topic = if name.starts_with("cdr") { "/eye/image_raw" } else { "/image" };
        let mut recording = nunet_mcap::Recording::open(&path, Some(topic)).unwrap();
        let mut image = nunet_mcap::RecordedImage::default();
        let mut good = 0;
        loop {
            match recording.next(&mut image) {
                nunet_mcap::Next::Image => good += 1,
                nunet_mcap::Next::Nothing => {}
                nunet_mcap::Next::End => break,
                other => panic!("{name}: {other:?}"),
            }
        }
        assert_eq!(good, if name.starts_with("cdr") { 3 } else { 2 }, "{name}");
        assert!(recording.camera().is_some(), "{name}");
        hostile::keep_for_fuzzing("recording", &name, &bytes);
    }
}

#[test]
fn damaged_recordings_of_every_kind_never_panic() {
    for (name, bytes) in files() {
        hostile::feed_damaged(&name, &bytes, body::recording);
    }
}

/// Checksums and compression stop most damage in front of the messages; without them it goes through.
#[test]
fn damaged_messages_never_panic() {
    let all = [ros_messages(), foxglove_messages("protobuf"), foxglove_messages("json")].concat();
    for (topic, schema, encoding, data) in all {
        hostile::feed_damaged(schema, &data, |bytes| {
            let message = (topic, schema, encoding, bytes.to_vec());
            body::recording(&file(WriteOptions::new().use_chunks(false), &[message]));
        });
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn random_bytes_after_the_magic_bytes_never_panic(
        records in proptest::collection::vec((0_u8..18, proptest::collection::vec(any::<u8>(), 0..80)), 0..12),
        lie in 0_u64..8,
    ) {
        let mut bytes = mcap::MAGIC.to_vec();
        for (opcode, data) in records {
            bytes.push(opcode);
            bytes.extend((data.len() as u64 + lie / 7).to_le_bytes());
            bytes.extend(data);
        }
        body::recording(&bytes);
    }
}

/// mcap's reader counts below zero there.
#[test]
fn a_message_that_is_longer_than_its_chunk_loses_the_chunk() {
    let whole = file(chunks(None), &ros_messages());
    // The first record in the first chunk: a schema of the camera's description.
    let at = whole.windows(11).position(|window| window == b"sensor_msgs").unwrap() - 6 - 9;
    assert_eq!(whole[at], 0x03, "a schema record");
    let mut longer = whole.clone();
    longer[at + 1..at + 9].copy_from_slice(&600_u64.to_le_bytes());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    std::fs::write(&path, &longer).unwrap();
    let mut recording = nunet_mcap::Recording::open(&path, Some("/eye/image_raw")).unwrap();
    let end = recording.next(&mut nunet_mcap::RecordedImage::default());
    // The chunk has no image, and those behind it are read.
    assert!(!matches!(end, nunet_mcap::Next::Cut(_) | nunet_mcap::Next::End), "{end:?}");
    body::recording(&longer);
}

#[test]
fn an_error_shortens_a_name_of_a_million_letters() {
    let endless: &'static str = "x".repeat(1_000_000).leak();
    let image = cdr(|body| {
        words(&[2, 4], body);
        text(endless, body);
        body.push(0);
        words(&[4, 8], body);
        body.extend([5; 8]);
    });
    let plain = |topic, schema, encoding| {
        body::recording(&file(WriteOptions::new(), &[(topic, schema, encoding, image.clone())]));
    };
    plain("/eye/image_raw", "sensor_msgs/msg/Image", "cdr");
    plain(endless, "sensor_msgs/msg/Image", "cdr");
    plain("/eye", endless, "cdr");
    plain("/eye", "sensor_msgs/msg/Imu", endless);
}
