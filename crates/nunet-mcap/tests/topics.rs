//! Which topics of a recording are its image, its depth and its camera.
#![expect(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use mcap::WriteOptions;
use mcap::records::MessageHeader;
use nunet_mcap::ros::{Header, ImagePixels, RosMessage, Time};
use nunet_mcap::{
    CameraDescription, EncodedImage, Next, RecordedImage, Recording, RecordingError, RecordingErrorKind,
};

/// A message on a topic.
type Message<'a> = (&'a str, RosMessage<'a>);

/// Writes a recording. Its channels are in the order of their first messages.
fn write(folder: &Path, messages: &[Message<'_>]) -> PathBuf {
    let mut file = Cursor::new(Vec::new());
    let mut writer = WriteOptions::new().create(&mut file).unwrap();
    for (log_time, (topic, message)) in (1..).zip(messages) {
        let schema_name = match message {
            RosMessage::CameraInfo(_) => "sensor_msgs/msg/CameraInfo",
            RosMessage::CompressedImage(_) => "sensor_msgs/msg/CompressedImage",
            _ => "sensor_msgs/msg/Image",
        };
        let schema = writer.add_schema(schema_name, "ros2msg", b"").unwrap();
        let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
        let mut data = Vec::new();
        let header = Header { stamp: Time { sec: 3, nanosec: 0 }, frame_id: "eye".into() };
        message.encode(&header, &mut data).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let path = folder.join("a.mcap");
    std::fs::write(&path, file.into_inner()).unwrap();
    path
}

fn camera(fx_px: f64) -> CameraDescription {
    CameraDescription {
        width: 4,
        height: 2,
        intrinsics: [fx_px, fx_px, 1.5, 0.5],
        ..CameraDescription::default()
    }
}

const GRAY: RosMessage<'_> =
    RosMessage::Image(ImagePixels { width: 4, height: 2, encoding: "mono8", pixel_bytes: 1, data: &[7; 8] });

/// A PNG of two pixels of 16 bits.
fn png(values: [u16; 2]) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let image = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(2, 1, values.to_vec()).unwrap();
    image.write_to(&mut file, image::ImageFormat::Png).unwrap();
    file.into_inner()
}

#[test]
fn the_camera_is_chosen_by_its_name_and_not_by_its_place_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let (right, wrong) = (camera(100.0), camera(200.0));
    for (image, good, other) in [
        ("/left/image_raw", "/left/camera_info", "/left/camera_info_rect"),
        ("/cam/left_image", "/cam/left_camera_info", "/cam/right_camera_info"),
    ] {
        let infos = [(other, RosMessage::CameraInfo(&wrong)), (good, RosMessage::CameraInfo(&right))];
        for infos in [[infos[0], infos[1]], [infos[1], infos[0]]] {
            let path = write(folder.path(), &[infos[0], infos[1], (image, GRAY)]);
            let recording = Recording::open(&path, None).unwrap();
            assert_eq!(recording.camera().unwrap().intrinsics[0], 100.0, "{image}");
        }
    }
}

#[test]
fn cameras_that_match_equally_well_are_a_fault_for_the_whole_recording() {
    let folder = tempfile::tempdir().unwrap();
    let one = camera(100.0);
    let messages =
        [("/c/b", RosMessage::CameraInfo(&one)), ("/c/a", RosMessage::CameraInfo(&one)), ("/c/image", GRAY)];
    let mut recording = Recording::open(&write(folder.path(), &messages), None).unwrap();
    for _ in 0..2 {
        let fault = recording.camera().unwrap().fault.as_deref();
        assert_eq!(fault, Some("several topics may describe it: `/c/a`, `/c/b`"));
        while !matches!(recording.next(&mut RecordedImage::default()), Next::End) {}
        recording.rewind().unwrap();
    }
}

#[test]
fn depth_in_a_png_is_not_color() {
    let folder = tempfile::tempdir().unwrap();
    let (depth, gray) = (png([0, 1500]), png([7, 9]));
    let compressed = |format, data| RosMessage::CompressedImage(EncodedImage { format, data });
    let messages = [
        ("/oak/left/image_raw/compressed", compressed("mono16; png compressed ", &gray)),
        ("/oak/stereo/image_raw/compressed", compressed("16UC1; png compressed ", &depth)),
    ];
    let path = write(folder.path(), &messages);
    assert_eq!(Recording::open(&path, None).unwrap().topic(), "/oak/left/image_raw/compressed");
    let mut depths = Recording::open_depth(&path, None).unwrap();
    assert_eq!(depths.topic(), "/oak/stereo/image_raw/compressed");
    let mut image = RecordedImage::default();
    while !matches!(depths.next(&mut image), Next::Image) {}
    assert_eq!(image.depth_m()[1], 1.5);
}

#[test]
fn sixteen_bits_of_a_thermal_camera_are_brightness() {
    let folder = tempfile::tempdir().unwrap();
    let raw = ImagePixels { width: 1, height: 1, encoding: "16UC1", pixel_bytes: 2, data: &[7, 1] };
    let path = write(folder.path(), &[("/thermal/image_raw", RosMessage::Image(raw))]);
    assert_eq!(Recording::open(&path, None).unwrap().topic(), "/thermal/image_raw");
}

/// The error of a recording whose images are read from a topic.
fn refused(path: &Path, topic: Option<&str>) -> RecordingError {
    Recording::open(path, topic).map(drop).expect_err("its images cannot be used")
}

#[test]
fn a_named_topic_of_which_no_image_can_be_used_is_refused_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let raw =
        |encoding, pixel_bytes| ImagePixels { width: 2, height: 1, encoding, pixel_bytes, data: &[7; 16] };
    let depth_png = png([0, 1500]);
    let compressed = |format| RosMessage::CompressedImage(EncodedImage { format, data: &depth_png });
    let unusable = [
        ("/c/meters", RosMessage::Image(raw("32FC1", 4))),
        ("/c/millimeters", RosMessage::Image(raw("16UC1", 2))),
        ("/c/png", compressed("16UC1; png compressed ")),
        ("/c/depth/compressedDepth", compressed("16UC1; compressedDepth png")),
        ("/c/flow", RosMessage::Image(raw("32FC2", 8))),
        ("/c/labels", RosMessage::Image(raw("32SC1", 4))),
    ];
    let path = write(folder.path(), &[&unusable[..], &[("/c/image", GRAY)]].concat());
    for (topic, _) in unusable {
        let error = refused(&path, Some(topic));
        assert!(matches!(error, RecordingError::UnusableImages { .. }), "{topic}: {error}");
        assert_eq!(error.kind(), RecordingErrorKind::Topic);
    }
    assert_eq!(Recording::open(&path, Some("/c/image")).unwrap().topic(), "/c/image");
    let path = write(folder.path(), &[("/c/image", RosMessage::Image(raw("32FC2", 8)))]);
    assert_eq!(refused(&path, None).kind(), RecordingErrorKind::Topic, "the only one is not named");
}

#[test]
fn the_first_undamaged_image_stands_for_its_topic() {
    let folder = tempfile::tempdir().unwrap();
    let raw = |encoding, data| ImagePixels { width: 2, height: 1, encoding, pixel_bytes: 4, data };
    let empty = RosMessage::Image(ImagePixels { width: 0, height: 0, ..raw("", &[]) });
    let cut = RosMessage::Image(raw("rgba8", &[7; 3]));
    let messages = [("/c/image", empty), ("/c/image", cut)];
    for (last, is_good) in [(GRAY, true), (RosMessage::Image(raw("32FC1", &[7; 8])), false)] {
        let path = write(folder.path(), &[&messages[..], &[("/c/image", last)]].concat());
        assert_eq!(Recording::open(&path, Some("/c/image")).is_ok(), is_good);
    }
    assert!(Recording::open(&write(folder.path(), &messages), Some("/c/image")).is_ok(), "none is known");
}
