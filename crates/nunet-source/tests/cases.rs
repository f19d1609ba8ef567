//! Inputs that users really have, and what is right for them.
#![cfg(feature = "mcap")]
#![expect(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

use nunet_core::camera::{Distortion, KannalaBrandt};
use nunet_source::{Fill, Frame, OpenOptions, SourceErrorKind, SourceName};
use nunet_testkit::cases;
use nunet_types::{ImageSize, PixelFormat};

/// Every frame of a case: its first pixel's channels and its camera.
fn frames(name: &str) -> Vec<Result<Frame, String>> {
    let mut source =
        SourceName::parse(cases::path(name).to_str().unwrap()).open(OpenOptions::default()).unwrap();
    let mut frames = Vec::new();
    for _ in 0..10_000 {
        let mut frame = Frame::default();
        match source.fill(&mut frame) {
            Fill::Frame => frames.push(Ok(frame)),
            Fill::Failed(error) => frames.push(Err(format!("{error:#}"))),
            Fill::Nothing | Fill::Crowded => {}
            Fill::End => return frames,
            Fill::Cut(error) | Fill::Broken(error) => panic!("{error:#}"),
        }
    }
    panic!("it has no end")
}

#[track_caller]
fn first(name: &str) -> Frame {
    frames(name).into_iter().next().unwrap().unwrap()
}

#[test]
fn a_calibration_in_json_is_read_in_both_spellings() {
    for name in ["fj_cal_upper", "fj_cal_lower"] {
        let camera = first(&format!("foxglove_json_calibration/{name}.mcap")).camera.unwrap();
        let intrinsics = camera.intrinsics;
        let numbers = [intrinsics.fx_px, intrinsics.fy_px, intrinsics.cx_px, intrinsics.cy_px];
        assert_eq!(numbers, [50.0, 51.0, 31.5, 24.5], "{name}");
        assert!(matches!(camera.distortion, Distortion::BrownConrady(_)));
    }
}

#[test]
fn the_camera_is_rotated_with_its_image() {
    let camera = first("exif_turned_calibration/rec3.mcap").camera.unwrap();
    assert_eq!((camera.intrinsics.cx_px, camera.intrinsics.cy_px), (43.0, 32.0));
}

/// What follows for depth in meters is tested with `nunetd`.
#[test]
fn a_fifth_coefficient_of_zero_is_ignored() {
    let lens = Distortion::KannalaBrandt(KannalaBrandt::new(&[-0.01, 0.04, -0.03, 0.006]).unwrap());
    for (name, expected) in [
        ("cam_t265_equi5", [50.0, 51.0, 31.5, 24.5]),
        ("t265_4", [216.0, 216.0, 320.0, 240.0]),
        ("t265_5", [216.0, 216.0, 320.0, 240.0]),
    ] {
        let camera = first(&format!("camera_info_coefficients/{name}.mcap")).camera.unwrap();
        let intrinsics = camera.intrinsics;
        let numbers = [intrinsics.fx_px, intrinsics.fy_px, intrinsics.cx_px, intrinsics.cy_px];
        assert_eq!(numbers, expected, "{name}");
        assert_eq!(camera.distortion, lens, "{name}");
    }
}

#[test]
fn a_skew_follows_the_same_rule_in_a_recording_as_in_a_file() {
    let camera = first("fisheye_with_skew/cam_fisheye_skew.mcap").camera.unwrap();
    assert!(matches!(camera.distortion, Distortion::KannalaBrandt(_)));
    assert_eq!(camera.intrinsics.fx_px, 50.0);
}

/// Each recording has one image of each topic. Depth has other numbers than these.
#[test]
fn color_is_chosen_beside_depth() {
    for (name, size, color) in [
        ("depth_counts_as_colour/ch_aligned.mcap", ImageSize::new(6, 4), [90; 3]),
        ("compressed_depth_eval/rgbd_compressed.mcap", ImageSize::new(64, 48), CORNER),
    ] {
        let all = frames(name);
        assert_eq!(all.len(), 1, "{name}");
        let frame = all[0].as_ref().unwrap();
        assert_eq!((frame.format, frame.size), (Some(PixelFormat::Rgb8), size), "{name}");
        assert_near(&frame.view().unwrap().bytes()[..3], color);
    }
}

/// The upper left corner of the JPEG of several cases.
const CORNER: [u8; 3] = [201, 40, 30];

/// JPEG decoders differ by a few levels.
#[track_caller]
fn assert_near(pixel: &[u8], expected: [u8; 3]) {
    let is_near = pixel.iter().zip(expected).all(|(&value, expected)| value.abs_diff(expected) <= 3);
    assert!(pixel.len() == 3 && is_near, "{pixel:?} instead of {expected:?}");
}

#[test]
fn a_motion_jpeg_without_tables_has_the_pixels_of_the_same_image_with_tables() {
    let expected = first("motion_photo/plain.jpg");
    let expected = expected.view().unwrap();
    assert_eq!(expected.size(), (64, 48).into());
    for name in ["mjpeg_without_tables/comp_no_dht.mcap", "mjpeg_without_tables/no_dht.jpg"] {
        let frame = first(name);
        let view = frame.view().unwrap();
        assert_eq!(view.size(), expected.size(), "{name}");
        assert!(view.bytes() == expected.bytes(), "{name}");
        assert_near(&view.bytes()[..3], CORNER);
        assert_near(&view.bytes()[3 * 63..3 * 64], [230, 60, 89]);
        assert_near(&view.bytes()[3 * (64 * 48 - 1)..], [231, 201, 91]);
    }
}

#[test]
fn a_mosaic_becomes_color_and_sixteen_bits_gray() {
    let bayer = first("recorded_encodings/enc_bayer_rggb8.mcap");
    let view = bayer.view().unwrap();
    // Rows are 14 32 50 6e 8c aa: red and the green beside it rise along them.
    assert_eq!(view.size(), (6, 4).into());
    assert_eq!(view.bytes()[..3], [0x14, 0x23, 0x32]);
    let gray = first("recorded_encodings/enc_mono16.mcap");
    assert_eq!(gray.view().unwrap().bytes()[..6], [0x14, 0x32, 0x50, 0x6e, 0x8c, 0xaa]);
}

#[test]
fn the_parts_of_a_split_bag_are_played_in_order() {
    let all = frames("hints_for_other_files/split");
    assert_eq!(all.len(), 3);
    let stamps: Vec<i64> = all.iter().map(|frame| frame.as_ref().unwrap().capture.nanos).collect();
    assert!(stamps.is_sorted() && stamps[0] < stamps[2], "{stamps:?}");
    assert_eq!(frames("hints_for_other_files/split/metadata.yaml").len(), 3);
}

#[test]
fn a_ros_1_bag_is_named_with_its_conversion() {
    let name = cases::path("hints_for_other_files/drive.bag");
    let error = SourceName::parse(name.to_str().unwrap()).open(OpenOptions::default()).err().unwrap();
    assert_eq!(error.kind(), SourceErrorKind::Argument);
    insta::assert_snapshot!(
        error.to_string().replace(name.parent().unwrap().to_str().unwrap(), "FOLDER"),
        @"`FOLDER/drive.bag` is not a source: it is a ROS 1 bag"
    );
}
