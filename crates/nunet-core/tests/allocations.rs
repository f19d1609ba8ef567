#![expect(clippy::unwrap_used, reason = "helpers of tests are tests")]

//! A steady frame makes no heap allocation in our code, whichever of a few buffers it is given.

use std::num::NonZeroU32;

use nunet_core::camera::{Camera, Intrinsics, Mount};
use nunet_core::cloud::CloudPoint;
use nunet_core::depth::DepthImage;
use nunet_core::filter::{FilterOptions, FilterSpec};
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::framing::AspectMode;
use nunet_core::graph::{GraphOptions, Runtime, SerialGraph};
use nunet_core::obstacle::{ObstacleDetector, ObstacleOptions};
use nunet_core::pipeline::{Outputs, Pipeline, PipelineOptions};
use nunet_core::preprocess::Preprocessor;
use nunet_testkit::allocations::{CountingAllocator, allocations_during};
use nunet_testkit::{manifests, models};
use nunet_types::ImageSize;

#[global_allocator]
static COUNTING: CountingAllocator = CountingAllocator;

const SIZE: ImageSize = ImageSize::new(64, 48);
/// The caller's memory for one frame.
struct Buffers {
    image: Vec<u8>,
    depth_m: Vec<f32>,
    labels: Vec<u8>,
    confidence: Vec<u8>,
    cloud: Vec<CloudPoint>,
}

impl Buffers {
    fn new(image_bytes: usize, ImageSize { width, height }: ImageSize) -> Self {
        let pixels = (width * height) as usize;
        Self {
            image: (0..image_bytes).map(|i| (i * 31 % 251) as u8).collect(),
            depth_m: vec![0.0; pixels],
            labels: vec![0; pixels],
            confidence: vec![0; pixels],
            cloud: vec![CloudPoint::NONE; pixels],
        }
    }
}

fn pipeline(model: &std::path::Path) -> Pipeline {
    filtering_pipeline(model, FilterOptions::default())
}

fn filtering_pipeline(model: &std::path::Path, filters: FilterOptions) -> Pipeline {
    let runtime = Runtime::load(&nunet_testkit::runtime_library()).unwrap();
    let options = GraphOptions { threads: std::num::NonZeroUsize::new(2), ..GraphOptions::default() };
    let graph = SerialGraph::load(model, &runtime, &options).unwrap();
    let camera = Camera::pinhole(Intrinsics::new(50.0, 50.0, 31.5, 23.5, SIZE.width, SIZE.height).unwrap());
    let options = PipelineOptions {
        camera: Some(camera),
        cloud_stride: NonZeroU32::MIN,
        filters,
        ..Default::default()
    };
    Pipeline::new(graph, options).unwrap()
}

/// Allocations of frames after each set of buffers has been seen once.
fn steady_allocations(pipeline: &mut Pipeline, size: ImageSize, format: PixelFormat) -> u64 {
    let bytes = format.byte_len(size.width, size.height, format.min_stride(size.width));
    let mut buffers: Vec<Buffers> = (0..4).map(|_| Buffers::new(bytes, pipeline.size())).collect();
    let clock = || 0;
    let (labels, confidence) = (pipeline.graph().has_labels(), pipeline.graph().has_confidence());
    let mut frames = |count: usize| {
        for i in 0..count {
            // Images and results do not change in step: 4 of each, in 16 pairs.
            let image = std::mem::take(&mut buffers[i / 4 % 4].image);
            let memory = &mut buffers[i % 4];
            let frame = ImageView::packed(&image, size.width, size.height, format).unwrap();
            let outputs = Outputs {
                depth_m: &mut memory.depth_m,
                labels: labels.then_some(&mut memory.labels[..]),
                // In some frames it stays inside.
                confidence: (confidence && i % 3 > 0).then_some(&mut memory.confidence[..]),
                cloud: Some(&mut memory.cloud),
            };
            pipeline.process(&frame, outputs, &clock).unwrap();
            buffers[i / 4 % 4].image = image;
        }
    };
    frames(16);
    allocations_during(|| frames(100))
}

#[test]
fn a_steady_frame_allocates_nothing() {
    let folder = tempfile::tempdir().unwrap();
    models::segmentation_stage(SIZE).write(folder.path().join("segmentation.onnx"));
    models::depth_stage(SIZE, true).write(folder.path().join("depth.onnx"));
    for every in [1, 2] {
        std::fs::write(folder.path().join("graph.toml"), manifests::two_stages(true, every)).unwrap();
        let mut pipeline = pipeline(&folder.path().join("graph.toml"));
        for (size, format) in [
            (SIZE, PixelFormat::Rgb8),
            (SIZE, PixelFormat::Bgr8),
            (ImageSize::new(128, 96), PixelFormat::Rgb8),
            (ImageSize::new(160, 120), PixelFormat::Nv12),
            (ImageSize::new(160, 90), PixelFormat::Rgb8), // cropped
            (ImageSize::new(161, 90), PixelFormat::Nv12),
        ] {
            let allocations = steady_allocations(&mut pipeline, size, format);
            assert_eq!(allocations, 0, "every {every}, {format} of {size}");
        }
    }
}

#[test]
fn a_padded_frame_allocates_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.onnx");
    models::with_confidence(models::wnet(SIZE, true), SIZE).write(&path);
    let runtime = Runtime::load(&nunet_testkit::runtime_library()).unwrap();
    let graph = SerialGraph::load(&path, &runtime, &GraphOptions::default()).unwrap();
    let options = PipelineOptions { aspect: AspectMode::Letterbox, ..Default::default() };
    let mut pipeline = Pipeline::new(graph, options).unwrap();
    assert_eq!(steady_allocations(&mut pipeline, ImageSize::new(160, 90), PixelFormat::Rgb8), 0);
    assert_eq!(steady_allocations(&mut pipeline, ImageSize::new(90, 160), PixelFormat::Bgr8), 0);
}

#[test]
fn state_is_kept_and_reset_without_allocation() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("remembering.onnx");
    models::remembering(SIZE).write(&path);
    let mut pipeline = pipeline(&path);
    assert_eq!(steady_allocations(&mut pipeline, SIZE, PixelFormat::Rgb8), 0);
    assert_eq!(allocations_during(|| pipeline.reset()), 0);
    assert_eq!(steady_allocations(&mut pipeline, SIZE, PixelFormat::Rgb8), 0);
}

#[test]
fn filters_and_their_reset_allocate_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wnet.onnx");
    models::with_confidence(models::wnet(SIZE, true), SIZE).write(&path);
    for texts in [
        &[][..],
        &["decimation=3", "spatial=fill:2", "temporal", "holes"],
        &["spatial", "temporal", "holes=nearest"],
        &["decimation=8"],
    ] {
        let specs: Vec<FilterSpec> = texts.iter().map(|text| text.parse().unwrap()).collect();
        let mut pipeline = filtering_pipeline(&path, FilterOptions::new(&specs).unwrap());
        assert_eq!(steady_allocations(&mut pipeline, SIZE, PixelFormat::Rgb8), 0, "{texts:?}");
        assert_eq!(allocations_during(|| pipeline.reset()), 0, "{texts:?}");
    }
}

#[test]
fn later_images_of_the_same_size_are_preprocessed_without_allocation() {
    for &format in PixelFormat::ALL {
        for ImageSize { width, height } in [SIZE, ImageSize::new(131, 97), ImageSize::new(40, 20)] {
            let bytes = vec![100; format.byte_len(width, height, format.min_stride(width))];
            let frame = ImageView::packed(&bytes, width, height, format).unwrap();
            let mut preprocessor = Preprocessor::new(SIZE.width, SIZE.height);
            preprocessor.prepare(&frame);
            let allocations = allocations_during(|| {
                preprocessor.prepare(&frame);
            });
            assert_eq!(allocations, 0, "{format} {width}x{height}");
        }
    }
}

#[test]
fn obstacles_allocate_nothing() {
    let camera = Camera::pinhole(Intrinsics::new(50.0, 50.0, 31.5, 23.5, SIZE.width, SIZE.height).unwrap());
    let mount = Mount::new([0.0, 0.0, 0.5], [0.0; 3]).unwrap();
    let options = ObstacleOptions { hold_s: 1.0, ..ObstacleOptions::default() };
    let mut detector = ObstacleDetector::new(&camera, mount, &["floor".to_owned()], options).unwrap();
    let pixels = (SIZE.width * SIZE.height) as usize;
    // Floor in the lower half, and behind it a wall; then noise, which has more points than there is room
    // for.
    let room = |i: usize| 0.5 * 50.0 / ((i / 64) as f32 - 23.5).max(10.0);
    let noise = |i: usize| 0.3 + (i * 7919 % 1000) as f32 * 0.01;
    let images: [Vec<f32>; 2] = [(0..pixels).map(room).collect(), (0..pixels).map(noise).collect()];
    let labels = vec![0; pixels];
    let mut points = 0;
    let allocations = allocations_during(|| {
        for (time, depth_m) in images.iter().chain(&images).enumerate() {
            for labels in [None, Some(&labels[..])] {
                let image = DepthImage { depth_m, labels, confidence: labels };
                points += detector.detect(&image, time as i64).unwrap().points.len();
            }
        }
    });
    assert_eq!(allocations, 0);
    assert!(points > 0);
}

#[test]
fn a_mount_that_was_used_before_allocates_nothing() {
    let camera = Camera::pinhole(Intrinsics::new(50.0, 50.0, 31.5, 23.5, SIZE.width, SIZE.height).unwrap());
    let mounts = [0.0, 0.3, -0.2].map(|pitch| Mount::new([0.0, 0.0, 0.5], [0.05, pitch, 0.1]).unwrap());
    let options = ObstacleOptions { hold_s: 1.0, ..ObstacleOptions::default() };
    let mut detector = ObstacleDetector::new(&camera, mounts[0], &["floor".to_owned()], options).unwrap();
    mounts.iter().for_each(|&mount| detector.set_mount(mount));
    let depth_m = vec![1.0; (SIZE.width * SIZE.height) as usize];
    let image = DepthImage { depth_m: &depth_m, labels: None, confidence: None };
    let allocations = allocations_during(|| {
        for (time, &mount) in mounts.iter().chain(&mounts).enumerate() {
            detector.set_mount(mount);
            detector.detect(&image, time as i64).unwrap();
        }
    });
    assert_eq!(allocations, 0);
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocations_during(|| drop(std::hint::black_box(vec![1_u8]))), 1);
}
