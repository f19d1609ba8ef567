//! The layout of the header, said a second time: a change here is a new version of the contract.

use nunet_ipc::contract::{BLOCK, ENUMS, HEADER, OBSTACLE_POINT, OBSTACLE_SECTOR, OBSTACLES, POINT, STATS};
use nunet_ipc::{
    Clock, DistortionModel, Encoding, FrameHeader, PixelRect, Quality, ScaleSource, Topic, Units,
};

fn filled() -> FrameHeader {
    let mut header = FrameHeader {
        sequence: 0x0102_0304_0506_0708,
        capture_nanos: -2,
        capture_unix_nanos: 1_700_000_000_000_000_000,
        publish_nanos: 3,
        width: 640,
        height: 480,
        row_stride_bytes: 2560,
        payload_bytes: 1_228_800,
        fx: 518.9,
        fy: 519.5,
        cx: 325.6,
        cy: 253.7,
        distortion: std::array::from_fn(|index| index as f64),
        model_hash: std::array::from_fn(|index| index as u8),
        bytes_copied: 5,
        invalid_pixels: 6,
        scale_factor: 0.75,
        scale_age_nanos: 9,
        view_x: 160,
        view_y: 1,
        view_width: 960,
        view_height: 720,
        ..Default::default()
    };
    header.set_topic(Topic::Depth);
    header.set_capture_clock(Clock::Media);
    header.set_encoding(Encoding::DepthF32);
    header.set_units(Units::Metre);
    header.set_scale_source(ScaleSource::FocalScaled);
    header.set_quality(Quality::ReusedLabels);
    header.set_distortion_model(DistortionModel::BrownConrady);
    header.set_stages([100, 200, 300]);
    header.set_frame_id("camera_optical");
    header
}

/// Offsets and values written by hand from INTERFACE, not taken from the struct.
fn golden() -> Vec<u8> {
    let mut bytes = vec![0; 1024];
    let mut put = |offset: usize, value: &[u8]| bytes[offset..offset + value.len()].copy_from_slice(value);
    put(0, &1_u32.to_le_bytes()); // contract_version
    put(4, &1_u32.to_le_bytes()); // topic: depth
    put(8, &0x0102_0304_0506_0708_u64.to_le_bytes()); // sequence
    put(16, &(-2_i64).to_le_bytes()); // capture_nanos
    put(24, &1_700_000_000_000_000_000_i64.to_le_bytes()); // capture_unix_nanos
    put(32, &3_i64.to_le_bytes()); // publish_nanos
    put(40, &2_u32.to_le_bytes()); // capture_clock: media
    put(44, &5_u32.to_le_bytes()); // encoding: depth_f32
    put(48, &640_u32.to_le_bytes()); // width
    put(52, &480_u32.to_le_bytes()); // height
    put(56, &2560_u32.to_le_bytes()); // row_stride_bytes
    put(60, &1_u32.to_le_bytes()); // units: metre
    put(64, &1_228_800_u64.to_le_bytes()); // payload_bytes
    put(72, &1_u32.to_le_bytes()); // scale_source: focal_scaled
    put(76, &1_u32.to_le_bytes()); // quality: reused_labels
    put(80, &518.9_f64.to_le_bytes()); // fx
    put(88, &519.5_f64.to_le_bytes()); // fy
    put(96, &325.6_f64.to_le_bytes()); // cx
    put(104, &253.7_f64.to_le_bytes()); // cy
    for index in 0..14 {
        put(112 + index * 8, &(index as f64).to_le_bytes()); // distortion
    }
    put(224, &1_u32.to_le_bytes()); // distortion_model: brown_conrady
    put(228, &3_u32.to_le_bytes()); // stage_count
    put(232, &std::array::from_fn::<u8, 32, _>(|index| index as u8)); // model_hash
    put(264, &100_u32.to_le_bytes()); // stage_micros
    put(268, &200_u32.to_le_bytes());
    put(272, &300_u32.to_le_bytes());
    put(328, &5_u64.to_le_bytes()); // bytes_copied
    put(336, &6_u64.to_le_bytes()); // invalid_pixels
    put(344, b"camera_optical"); // frame_id
    put(408, &0.75_f64.to_le_bytes()); // scale_factor
    put(416, &9_i64.to_le_bytes()); // scale_age_nanos
    put(424, &160_u32.to_le_bytes()); // view_x
    put(428, &1_u32.to_le_bytes()); // view_y
    put(432, &960_u32.to_le_bytes()); // view_width
    put(436, &720_u32.to_le_bytes()); // view_height
    bytes
}

#[test]
fn a_filled_header_has_the_expected_bytes() {
    let header = filled();
    let mut bytes = Vec::new();
    // Field by field through the table that other languages read: it proves the table as well as the struct.
    for field in HEADER.fields {
        assert_eq!(bytes.len(), field.offset, "{} leaves a gap", field.name);
        bytes.extend(bytes_of_field(&header, field.name));
    }
    assert_eq!(bytes, golden());
}

fn bytes_of_field(header: &FrameHeader, name: &str) -> Vec<u8> {
    match name {
        "contract_version" => header.contract_version.to_le_bytes().to_vec(),
        "topic" => header.topic.to_le_bytes().to_vec(),
        "sequence" => header.sequence.to_le_bytes().to_vec(),
        "capture_nanos" => header.capture_nanos.to_le_bytes().to_vec(),
        "capture_unix_nanos" => header.capture_unix_nanos.to_le_bytes().to_vec(),
        "publish_nanos" => header.publish_nanos.to_le_bytes().to_vec(),
        "capture_clock" => header.capture_clock.to_le_bytes().to_vec(),
        "encoding" => header.encoding.to_le_bytes().to_vec(),
        "width" => header.width.to_le_bytes().to_vec(),
        "height" => header.height.to_le_bytes().to_vec(),
        "row_stride_bytes" => header.row_stride_bytes.to_le_bytes().to_vec(),
        "units" => header.units.to_le_bytes().to_vec(),
        "payload_bytes" => header.payload_bytes.to_le_bytes().to_vec(),
        "scale_source" => header.scale_source.to_le_bytes().to_vec(),
        "quality" => header.quality.to_le_bytes().to_vec(),
        "fx" => header.fx.to_le_bytes().to_vec(),
        "fy" => header.fy.to_le_bytes().to_vec(),
        "cx" => header.cx.to_le_bytes().to_vec(),
        "cy" => header.cy.to_le_bytes().to_vec(),
        "distortion" => header.distortion.iter().flat_map(|value| value.to_le_bytes()).collect(),
        "distortion_model" => header.distortion_model.to_le_bytes().to_vec(),
        "stage_count" => header.stage_count.to_le_bytes().to_vec(),
        "model_hash" => header.model_hash.to_vec(),
        "stage_micros" => header.stage_micros.iter().flat_map(|value| value.to_le_bytes()).collect(),
        "bytes_copied" => header.bytes_copied.to_le_bytes().to_vec(),
        "invalid_pixels" => header.invalid_pixels.to_le_bytes().to_vec(),
        "frame_id" => header.frame_id.to_vec(),
        "scale_factor" => header.scale_factor.to_le_bytes().to_vec(),
        "scale_age_nanos" => header.scale_age_nanos.to_le_bytes().to_vec(),
        "view_x" => header.view_x.to_le_bytes().to_vec(),
        "view_y" => header.view_y.to_le_bytes().to_vec(),
        "view_width" => header.view_width.to_le_bytes().to_vec(),
        "view_height" => header.view_height.to_le_bytes().to_vec(),
        "reserved" => header.reserved.to_vec(),
        other => panic!("field `{other}` is new: say here what its bytes are"),
    }
}

#[test]
fn sizes_and_alignments_are_those_of_the_contract() {
    assert_eq!((HEADER.type_name, HEADER.bytes, HEADER.alignment), ("nunet.v1.FrameHeader", 1024, 8));
    assert_eq!((BLOCK.type_name, BLOCK.bytes, BLOCK.alignment), ("nunet.v1.Block64", 64, 64));
    assert_eq!((POINT.bytes, POINT.alignment), (16, 4));
    assert_eq!((STATS.type_name, STATS.bytes), ("nunet.v1.StatsRecord", 2560));
}

#[test]
fn a_point_is_a_ros_point_with_rgb_at_12_and_label_at_15() {
    let offsets: Vec<_> = POINT.fields.iter().map(|field| (field.name, field.offset)).collect();
    assert_eq!(offsets, [("x", 0), ("y", 4), ("z", 8), ("b", 12), ("g", 13), ("r", 14), ("label", 15)]);
}

#[test]
fn a_point_of_an_obstacle_is_a_ros_point_and_the_record_has_its_arrays_at_the_end() {
    let offsets: Vec<_> = OBSTACLE_POINT.fields.iter().map(|field| (field.name, field.offset)).collect();
    let expected =
        [("x", 0), ("y", 4), ("z", 8), ("height", 12), ("label", 16), ("confidence", 17), ("reserved", 18)];
    assert_eq!((offsets, OBSTACLE_POINT.bytes), (expected.to_vec(), 20));
    let arrays: Vec<_> = OBSTACLES.fields.iter().rev().take(2).collect();
    assert_eq!(
        (arrays[1].name, arrays[1].offset, arrays[1].kind),
        ("sectors", 160, OBSTACLE_SECTOR.type_name)
    );
    assert_eq!((arrays[0].name, arrays[0].offset, arrays[0].count), ("points", 11_680, 5000));
    assert_eq!((OBSTACLE_SECTOR.bytes, OBSTACLES.bytes), (32, 111_680));
}

/// The header's numbers as a reader knew them before obstacles: fields of the first 408 bytes, and the words
/// of its enumerations. Neither may move: such a reader goes on working, and meets at most a word that it
/// does not know.
#[test]
fn a_reader_from_before_obstacles_and_calibrated_scale_still_reads_every_frame() {
    let mut header = filled();
    header.set_scale_source(ScaleSource::Floor);
    let bytes = bytemuck::bytes_of(&header);
    let u32_at = |offset: usize| u32::from_le_bytes(bytes[offset..offset + 4].try_into().unwrap());
    assert_eq!((u32_at(0), u32_at(4), u32_at(48), u32_at(52)), (1, 1, 640, 480));
    assert_eq!(&bytes[..72], &golden()[..72]);
    assert_eq!(&bytes[76..408], &golden()[76..408]);
    assert!(u32_at(72) > 3, "the new word has a number of its own, which the old reader cannot mistake");

    let known = [
        ("topic", "rgb depth labels cloud . stats"),
        ("encoding", "rgb8 bgr8 mono8 yuyv nv12 depth_f32 labels_u8 points stats_record"),
        ("units", "none metre relative"),
        ("scale_source", "metric focal_scaled assumed_camera relative"),
        ("quality", "full reused_labels"),
    ];
    for (name, words) in known {
        let (_, numbers) = ENUMS.iter().find(|(found, _)| *found == name).unwrap();
        for (number, word) in words.split(' ').enumerate().filter(|(_, word)| *word != ".") {
            assert_eq!(numbers[number], (word, number as u32), "{name}");
        }
    }
}

#[test]
fn a_header_from_before_has_no_scale_factor_and_no_view() {
    let mut old = golden();
    old[408..].fill(0);
    let header: FrameHeader = bytemuck::pod_read_unaligned(&old);
    assert_eq!((header.scale_factor, header.scale_age_nanos), (0.0, 0));
    assert_eq!(header.scale_source(), Ok(ScaleSource::FocalScaled));
    assert_eq!(header.view(), None);
    let view = PixelRect { x: 160, y: 1, width: 960, height: 720 };
    assert_eq!(filled().view(), Some(view));
}
