//! Filters in the pipeline: sizes, cameras, times, and what is forgotten.

use std::num::NonZeroU32;

use nunet_core::ErrorKind;
use nunet_core::camera::{Camera, Intrinsics};
use nunet_core::cloud::CloudPoint;
use nunet_core::filter::{FilterError, FilterOptions, FilterSpec};
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::model::selftest;
use nunet_core::pipeline::{FrameReport, Outputs, Pipeline, PipelineError, PipelineOptions};
use nunet_core::scale::ScaleMode;
use nunet_testkit::models;
use nunet_testkit::onnx::ModelBuilder;
use nunet_types::ImageSize;

use crate::{Folder, chain, image, pixels, ticking};

/// No multiple of 3: a column is left over at the right and a row at the bottom.
const LARGE: ImageSize = ImageSize::new(10, 7);

fn filters(texts: &[&str]) -> FilterOptions {
    let specs: Vec<FilterSpec> = texts.iter().map(|text| text.parse().unwrap()).collect();
    FilterOptions::new(&specs).unwrap()
}

fn camera() -> Camera {
    Camera::pinhole(Intrinsics::new(9.0, 8.0, 4.25, 3.5, LARGE.width, LARGE.height).unwrap())
}

fn pipeline(model: &ModelBuilder, texts: &[&str]) -> Pipeline {
    let graph = Folder::new().model("m.onnx", model).load("m.onnx").unwrap();
    let options = PipelineOptions {
        camera: Some(camera()),
        scale: ScaleMode::Off,
        filters: filters(texts),
        ..PipelineOptions::default()
    };
    Pipeline::new(graph, options).unwrap()
}

struct Answer {
    depth_m: Vec<f32>,
    labels: Vec<u8>,
    cloud: Vec<CloudPoint>,
    report: FrameReport,
}

fn run(pipeline: &mut Pipeline, rgb: &[u8], labels_wanted: bool) -> Answer {
    let mut depth_m = vec![-1.0; pipeline.size().pixel_count()];
    let mut labels = vec![99; pipeline.size().pixel_count()];
    let mut cloud = vec![CloudPoint::NONE; pipeline.cloud_size().pixel_count()];
    let frame = ImageView::packed(rgb, LARGE.width, LARGE.height, PixelFormat::Rgb8).unwrap();
    let outputs = Outputs {
        depth_m: &mut depth_m,
        labels: labels_wanted.then_some(&mut labels[..]),
        confidence: None,
        cloud: Some(&mut cloud),
    };
    let report = pipeline.process(&frame, outputs, &ticking()).unwrap();
    Answer { depth_m, labels, cloud, report }
}

/// The values of a block of 3x3 pixels.
fn block<T: Copy>(values: &[T], column: usize, row: usize) -> Vec<T> {
    let at = |i: usize| (3 * row + i / 3) * LARGE.width as usize + 3 * column + i % 3;
    (0..9).map(|i| values[at(i)]).collect()
}

#[test]
fn decimation_makes_depth_labels_and_cloud_smaller_and_the_camera_follows() {
    let rgb = image(LARGE);
    let mut pipeline = pipeline(&models::wnet(LARGE, true), &["decimation=3"]);
    assert_eq!(
        (pipeline.size(), pipeline.cloud_size(), pipeline.graph().size()),
        ((3, 2).into(), (3, 2).into(), LARGE)
    );
    assert_eq!(pipeline.decimation(), NonZeroU32::new(3).unwrap());
    let depth: Vec<f32> = pixels(&rgb).map(models::connected_depth).collect();
    let classes: Vec<u8> = pixels(&rgb).map(models::label).collect();
    for labels_wanted in [true, false] {
        let answer = run(&mut pipeline, &rgb, labels_wanted);
        let camera = answer.report.camera.unwrap();
        assert_eq!(camera, self::camera().decimated(NonZeroU32::new(3).unwrap()));
        for (i, point) in answer.cloud.iter().enumerate() {
            let (column, row) = (i % 3, i / 3);
            let mut of_block = block(&depth, column, row);
            of_block.sort_by(f32::total_cmp);
            assert_eq!(answer.depth_m[i], of_block[4], "pixel {i}");
            let of_block = block(&classes, column, row);
            let votes = |class| of_block.iter().filter(|&&label| label == class).count();
            let most = (0..3).rev().max_by_key(|&class| votes(class)).unwrap();
            assert_eq!(point.label, most, "pixel {i}");
            assert_eq!(answer.labels[i], if labels_wanted { most } else { 99 }, "pixel {i}");
            let red: u32 =
                block(rgb.as_chunks::<3>().0, column, row).iter().map(|rgb| u32::from(rgb[0])).sum();
            assert_eq!(u32::from(point.r), (red + 4) / 9, "pixel {i}");

            let [u, v] = camera.project([point.x, point.y, point.z].map(f64::from)).unwrap();
            assert!((u - column as f64).abs() < 1e-5 && (v - row as f64).abs() < 1e-5, "{i}: {u} {v}");
            // The middle of the block is its middle pixel: the large image's camera sees the point there.
            let [u, v] = self::camera().project([point.x, point.y, point.z].map(f64::from)).unwrap();
            let (middle_u, middle_v) = ((3 * column + 1) as f64, (3 * row + 1) as f64);
            assert!((u - middle_u).abs() < 1e-5 && (v - middle_v).abs() < 1e-5, "{i}: {u} {v}");
        }
    }
}

#[test]
fn a_cloud_stride_counts_pixels_of_the_smaller_depth_map() {
    let graph = Folder::new().model("m.onnx", &models::unet(LARGE)).load("m.onnx").unwrap();
    let options = PipelineOptions {
        filters: filters(&["decimation=2"]),
        cloud_stride: NonZeroU32::new(2).unwrap(),
        ..PipelineOptions::default()
    };
    let mut pipeline = Pipeline::new(graph, options).unwrap();
    assert_eq!((pipeline.size(), pipeline.cloud_size()), ((5, 3).into(), (3, 2).into()));
    let answer = run(&mut pipeline, &image(LARGE), false);
    assert_eq!(answer.cloud[4].z, answer.depth_m[2 * 5 + 2]);
    assert!(answer.report.camera.is_none());
}

#[test]
fn meters_are_scaled_by_the_focal_length_at_the_networks_size_whatever_the_decimation() {
    let scale = |texts: &[&str]| {
        let graph = Folder::new().model("m.onnx", &models::unet(LARGE)).load("m.onnx").unwrap();
        let options =
            PipelineOptions { camera: Some(camera()), filters: filters(texts), ..PipelineOptions::default() };
        let mut pipeline = Pipeline::new(graph, options).unwrap();
        let at_first = pipeline.scale();
        pipeline.set_camera(Some(camera())).unwrap();
        assert_eq!(pipeline.scale(), at_first);
        at_first
    };
    assert_eq!(scale(&["decimation=3"]), scale(&[]));
}

#[test]
fn each_filter_that_is_on_has_its_time_in_the_order_in_which_they_run() {
    let all = ["holes", "temporal", "spatial", "decimation"];
    let mut every = pipeline(&models::unet(LARGE), &all);
    let names = ["preprocess", "network", "decode", "decimation", "spatial", "temporal", "holes", "cloud"];
    assert_eq!(every.stage_names(), names);
    assert!(pipeline(&models::unet(LARGE), &["decimation", "spatial", "holes"]).is_stateless());
    let report = run(&mut every, &image(LARGE), false).report;
    assert_eq!(report.stages.micros(), [1000; 8], "one tick of the clock each");
    let mut two = pipeline(&models::unet(LARGE), &["holes", "spatial"]);
    assert_eq!(two.stage_names(), ["preprocess", "network", "decode", "spatial", "holes", "cloud"]);
    assert_eq!(run(&mut two, &image(LARGE), false).report.stages.micros(), [1000; 6]);
}

#[test]
fn invalid_pixels_are_those_that_are_left_after_the_filters() {
    // Up to 5 m: some of this image is farther, and no measurement.
    let model = models::unet(LARGE).metadata("nunet.depth.max_m", "5");
    let holes = |texts: &[&str]| {
        let answer = run(&mut pipeline(&model, texts), &image(LARGE), false);
        let counted = answer.depth_m.iter().filter(|depth| depth.is_nan()).count();
        assert_eq!(answer.report.invalid_pixels as usize, counted, "{texts:?}");
        assert_eq!(answer.cloud.iter().filter(|point| point.z.is_nan()).count(), counted, "{texts:?}");
        counted
    };
    let decoded = holes(&[]);
    assert!(decoded > 0, "the test needs a hole");
    assert_eq!(holes(&["spatial", "temporal"]), decoded);
    assert!(holes(&["holes"]) < decoded);
    assert!(holes(&["decimation=2"]) < decoded);
}

#[test]
fn a_reset_discards_the_history_of_the_temporal_filter() {
    let mut pipeline = pipeline(&models::unet(LARGE), &["temporal=alpha:0,delta:1"]);
    assert!(!pipeline.is_stateless());
    let (dark, light) = (vec![0; 210], vec![2; 210]);
    let dark_m = models::plain_depth([0; 3]);
    let light_m = models::plain_depth([2; 3]);
    assert_eq!(run(&mut pipeline, &dark, false).depth_m, [dark_m; 70]);
    assert_eq!(run(&mut pipeline, &light, false).depth_m, [dark_m; 70], "alpha 0 takes nothing new");
    pipeline.reset();
    assert_eq!(run(&mut pipeline, &light, false).depth_m, [light_m; 70]);
    // The self-test asks the network alone, in between as well.
    pipeline.selftest(&ticking()).unwrap();
    assert_eq!(run(&mut pipeline, &dark, false).depth_m, [light_m; 70]);
}

#[test]
fn the_self_test_is_of_the_networks_own_size() {
    let size = (64, 48);
    let graph = Folder::new().model("m.onnx", &models::wnet(size, true)).load("m.onnx").unwrap();
    let filters = filters(&["decimation=8", "spatial", "temporal", "holes"]);
    let options = PipelineOptions { filters, ..PipelineOptions::default() };
    let mut pipeline = Pipeline::new(graph, options).unwrap();
    pipeline.selftest(&ticking()).unwrap();
    let rgb = selftest::image(size.0, size.1);
    let frame = ImageView::packed(&rgb, size.0, size.1, PixelFormat::Rgb8).unwrap();
    let mut depth_m = vec![0.0; 8 * 6];
    let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: None, cloud: None };
    assert_eq!(pipeline.process(&frame, outputs, &ticking()).unwrap().invalid_pixels, 0);
}

#[test]
fn options_that_do_not_fit_are_refused() {
    let graph = Folder::new().model("m.onnx", &models::unet(LARGE)).load("m.onnx").unwrap();
    let options = PipelineOptions { filters: filters(&["decimation=8"]), ..PipelineOptions::default() };
    let Err(error) = Pipeline::new(graph, options) else { panic!("7 rows hold no block of 8") };
    let is_too_small =
        matches!(error, PipelineError::Filter(FilterError::TooSmall { width: 10, height: 7, factor: 8 }));
    assert!(is_too_small, "{}", chain(&error));

    let mut pipeline = pipeline(&models::unet(LARGE), &["decimation=2"]);
    let rgb = image(LARGE);
    let frame = ImageView::packed(&rgb, LARGE.width, LARGE.height, PixelFormat::Rgb8).unwrap();
    let mut depth_m = vec![0.0; 70];
    let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: None, cloud: None };
    let error = pipeline.process(&frame, outputs, &ticking()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Buffer, "{error}");
    let outputs =
        Outputs { depth_m: &mut depth_m[..15], labels: Some(&mut [0; 15]), confidence: None, cloud: None };
    assert!(pipeline.process(&frame, outputs, &ticking()).is_err(), "this network has no labels");
}
