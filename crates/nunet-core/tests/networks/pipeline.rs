//! The whole pipeline: encodings, scale, cloud, self-test.

use nunet_core::camera::{Camera, Intrinsics};
use nunet_core::cloud::CloudPoint;
use nunet_core::depth::{DepthEncoding, ScaleSource, Units};
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::model::selftest;
use nunet_core::pipeline::{FrameReport, Outputs, Pipeline, PipelineOptions};
use nunet_core::scale::ScaleMode;
use nunet_testkit::models;
use nunet_testkit::onnx::ModelBuilder;
use nunet_types::ImageSize;

use crate::{Folder, SIZE, chain, image, pixels, ticking};

fn pipeline(model: &ModelBuilder, options: PipelineOptions) -> Pipeline {
    let graph = Folder::new().model("m.onnx", model).load("m.onnx").unwrap();
    Pipeline::new(graph, options).unwrap()
}

/// A camera that has exactly the networks' size.
fn camera(fx_px: f64) -> Camera {
    Camera::pinhole(Intrinsics::new(fx_px, fx_px, 2.5, 1.0, SIZE.width, SIZE.height).unwrap())
}

fn with_camera(fx_px: f64) -> PipelineOptions {
    PipelineOptions { camera: Some(camera(fx_px)), ..PipelineOptions::default() }
}

fn depth_of(pipeline: &mut Pipeline, rgb: &[u8]) -> (Vec<f32>, FrameReport) {
    let mut depth_m = vec![-1.0; rgb.len() / 3];
    let frame = ImageView::packed(rgb, SIZE.width, SIZE.height, PixelFormat::Rgb8).unwrap();
    let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: None, cloud: None };
    let report = pipeline.process(&frame, outputs, &ticking()).unwrap();
    (depth_m, report)
}

#[test]
fn every_encoding_is_decoded_and_invalid_pixels_are_counted() {
    let rgb = image(SIZE);
    let numbers: Vec<f32> = pixels(&rgb).map(models::plain_depth).collect();
    let cases = [
        ("metric", Units::Metre, (|v| v) as fn(f32) -> f32),
        ("inverse", Units::Metre, |v| 1.0 / v),
        ("log", Units::Metre, f32::exp),
        ("relative", Units::Relative, |v| v),
        ("relative_inverse", Units::Relative, |v| 1.0 / v),
        ("minmax", Units::Relative, |v| v.clamp(0.0, 1.0)),
    ];
    assert_eq!(cases.map(|(encoding, ..)| encoding), DepthEncoding::ALL.map(DepthEncoding::name));
    for (encoding, units, decode) in cases {
        let model = models::unet(SIZE)
            .metadata("nunet.depth.encoding", encoding)
            .metadata("nunet.depth.min_m", "0.0625")
            .metadata("nunet.depth.max_m", "16");
        let mut pipeline =
            pipeline(&model, PipelineOptions { scale: ScaleMode::Off, ..PipelineOptions::default() });
        let (depth, report) = depth_of(&mut pipeline, &rgb);
        let mut invalid = 0;
        for (&got, &number) in depth.iter().zip(&numbers) {
            let z = decode(number);
            if units == Units::Metre && !(0.0625..=16.0).contains(&z) {
                invalid += 1;
                assert!(got.is_nan(), "{encoding} {z}");
            } else {
                assert!((got - z).abs() <= z * 1e-5, "{encoding}: {got} for {z}");
            }
        }
        assert_eq!((report.units, report.invalid_pixels), (units, invalid), "{encoding}");
    }
}

#[test]
fn meters_follow_the_focal_length_at_the_networks_size() {
    // Trained at 640 pixels with fx 525; this network is 6 pixels wide.
    let training_fx_px = 525.0 * f64::from(SIZE.width) / 640.0;
    let rgb = image(SIZE);
    let own: Vec<f32> = pixels(&rgb).map(models::plain_depth).collect();
    let (scaled, report) =
        depth_of(&mut pipeline(&models::unet(SIZE), with_camera(2.0 * training_fx_px)), &rgb);
    assert_eq!(report.scale_source, ScaleSource::FocalScaled);
    assert_eq!(scaled, own.iter().map(|z| 2.0 * z).collect::<Vec<_>>());
    assert_eq!(report.camera, Some(camera(2.0 * training_fx_px)));

    let (assumed, report) = depth_of(&mut pipeline(&models::unet(SIZE), PipelineOptions::default()), &rgb);
    assert_eq!((assumed, report.scale_source), (own.clone(), ScaleSource::AssumedCamera));

    let off = PipelineOptions { scale: ScaleMode::Off, ..with_camera(400.0) };
    let (kept, report) = depth_of(&mut pipeline(&models::unet(SIZE), off), &rgb);
    assert_eq!((kept, report.scale_source), (own, ScaleSource::Metric));
}

#[test]
fn the_cloud_has_colors_and_labels_whether_or_not_labels_are_requested() {
    let rgb = image(SIZE);
    let focal_off = PipelineOptions { scale: ScaleMode::Off, ..with_camera(4.0) };
    let mut pipeline = pipeline(&models::wnet(SIZE, true), focal_off);
    assert_eq!(pipeline.cloud_size(), SIZE);
    assert_eq!(pipeline.stage_names(), ["preprocess", "network", "decode", "cloud"]);
    let frame = ImageView::packed(&rgb, SIZE.width, SIZE.height, PixelFormat::Rgb8).unwrap();
    for labels_wanted in [true, false] {
        let (mut depth_m, mut labels) = (vec![0.0; 18], vec![0; 18]);
        let mut cloud = vec![CloudPoint::NONE; 18];
        let outputs = Outputs {
            depth_m: &mut depth_m,
            labels: labels_wanted.then_some(&mut labels[..]),
            confidence: None,
            cloud: Some(&mut cloud),
        };
        let report = pipeline.process(&frame, outputs, &ticking()).unwrap();
        assert_eq!((report.bytes_copied, report.stages.micros().len()), (0, 4));
        for (i, (pixel, point)) in pixels(&rgb).zip(&cloud).enumerate() {
            let z = models::connected_depth(pixel);
            let (x, y) = ((i % 6) as f32, (i / 6) as f32);
            assert_eq!(
                [point.r, point.g, point.b, point.label],
                [pixel[0], pixel[1], pixel[2], models::label(pixel)]
            );
            assert_eq!([point.x, point.y, point.z], [(x - 2.5) / 4.0 * z, (y - 1.0) / 4.0 * z, z]);
        }
    }
}

/// The cloud of one image of a pipeline, and where its scale comes from.
fn cloud_of(pipeline: &mut Pipeline, rgb: &[u8]) -> (Vec<CloudPoint>, FrameReport) {
    let (mut depth_m, mut cloud) = (vec![0.0; 18], vec![CloudPoint::NONE; 18]);
    let frame = ImageView::packed(rgb, SIZE.width, SIZE.height, PixelFormat::Rgb8).unwrap();
    let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: None, cloud: Some(&mut cloud) };
    let report = pipeline.process(&frame, outputs, &ticking()).unwrap();
    (cloud, report)
}

#[test]
fn without_a_camera_points_are_the_training_cameras_and_marked_so() {
    let mut pipeline = pipeline(&models::unet(SIZE), PipelineOptions::default());
    let (cloud, report) = cloud_of(&mut pipeline, &image(SIZE));
    assert_eq!((report.scale_source, report.camera), (ScaleSource::AssumedCamera, None));
    // The training camera stretched to this size, looking through the middle.
    let fx_px = (525.0 * 6.0 / 640.0) as f32;
    assert!((cloud[0].x - (0.0 - 2.5) / fx_px * cloud[0].z).abs() < 1e-5);
}

#[test]
fn a_camera_may_be_set_later_and_taken_away_again() {
    let mut pipeline = pipeline(&models::unet(SIZE), PipelineOptions::default());
    let (assumed, _) = cloud_of(&mut pipeline, &image(SIZE));
    pipeline.set_camera(Some(camera(9.0))).unwrap();
    let (known, report) = cloud_of(&mut pipeline, &image(SIZE));
    assert_eq!((report.scale_source, report.camera), (ScaleSource::FocalScaled, Some(camera(9.0))));
    assert_ne!(known, assumed);
    pipeline.set_camera(None).unwrap();
    assert_eq!(cloud_of(&mut pipeline, &image(SIZE)).0, assumed);
}

#[test]
fn a_larger_image_is_resized_and_its_bytes_are_counted() {
    let mut pipeline = pipeline(&models::unet(SIZE), PipelineOptions::default());
    let gray = vec![64; 12 * 6 * 3];
    let frame = ImageView::packed(&gray, 12, 6, PixelFormat::Bgr8).unwrap();
    let mut depth_m = vec![0.0; 18];
    let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: None, cloud: None };
    let report = pipeline.process(&frame, outputs, &ticking()).unwrap();
    assert_eq!(depth_m, [models::plain_depth([64; 3]); 18]);
    assert!(report.bytes_copied >= 54);
}

const SELFTEST_SIZE: ImageSize = ImageSize::new(64, 48);

/// The connected W-Net with the self-test answer that its formula gives, one cell's depth off by `off`.
fn with_answer(off: f32) -> ModelBuilder {
    let ImageSize { width, height } = SELFTEST_SIZE;
    let rgb = selftest::image(width, height);
    let depth: Vec<f32> = pixels(&rgb).map(models::connected_depth).collect();
    let labels: Vec<u8> = pixels(&rgb).map(models::label).collect();
    // Written out here and not taken from the code under test: rows and columns of 8x8 pixels.
    let cell = |row: usize, column: usize| (0..64).map(move |i| (8 * row + i / 8) * 64 + 8 * column + i % 8);
    let median = |row, column| {
        let mut values: Vec<f32> = cell(row, column).map(|i| depth[i]).collect();
        values.sort_by(f32::total_cmp);
        values[31] + if (row, column) == (2, 3) { off } else { 0.0 }
    };
    let majority = |row, column| {
        let count = |class| cell(row, column).filter(|&i| labels[i] == class).count();
        (0..3_u8).rev().max_by_key(|&class| count(class)).unwrap()
    };
    let grid_of = |row| (0..8).map(|column| median(row, column)).collect::<Vec<f32>>();
    let labels_of = |row| (0..8).map(|column| majority(row, column)).collect::<Vec<u8>>();
    let list = |rows: Vec<String>| format!("[{}]", rows.join(", "));
    let answer = format!(
        r#"{{"version": 1, "picture": "nunet-selftest-1", "precision": "fp32", "depth": {}, "labels": {},
            "tolerance": {{"fp32": {{"depth": 0.001, "label_cells": 0}}}}}}"#,
        list((0..6).map(|row| format!("{:?}", grid_of(row))).collect()),
        list((0..6).map(|row| format!("{:?}", labels_of(row))).collect()),
    );
    models::wnet(SELFTEST_SIZE, true).metadata("nunet.selftest", &answer)
}

#[test]
fn a_model_whose_outputs_equal_those_at_export_passes_its_self_test() {
    let mut pipeline = pipeline(&with_answer(0.0), PipelineOptions::default());
    let report = pipeline.selftest(&ticking()).unwrap();
    assert_eq!((report.checked, report.worst_depth, report.label_cells), (true, 0.0, 0));
}

#[test]
fn a_model_whose_outputs_differ_is_refused_naming_the_cell() {
    let mut pipeline = pipeline(&with_answer(0.25), PipelineOptions::default());
    let message = chain(&pipeline.selftest(&ticking()).unwrap_err());
    assert!(message.contains("depth of cell (row 2, column 3) is "), "{message}");
    assert!(message.contains("within 0.001\nhint: "), "{message}");
}

#[test]
fn the_self_test_is_independent_of_the_focal_length() {
    let camera = Camera::pinhole(Intrinsics::new(500.0, 500.0, 32.0, 24.0, 64, 48).unwrap());
    let options = PipelineOptions { camera: Some(camera), ..PipelineOptions::default() };
    assert!(pipeline(&with_answer(0.0), options).selftest(&ticking()).is_ok());
}

#[test]
fn a_model_without_a_self_test_is_warmed_up_and_reported_unchecked() {
    let mut pipeline = pipeline(&models::unet(SELFTEST_SIZE), PipelineOptions::default());
    assert!(!pipeline.selftest(&ticking()).unwrap().checked);
}
