//! Images of another aspect ratio than the network's: which pixel of the image a pixel of the results is, and
//! its ray.

use nunet_core::camera::{Camera, Intrinsics};
use nunet_core::cloud::CloudPoint;
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::framing::AspectMode;
use nunet_core::pipeline::{FrameReport, Outputs, Pipeline, PipelineError, PipelineOptions};
use nunet_core::scale::ScaleMode;
use nunet_testkit::models;
use nunet_types::{ImageSize, PixelRect};

use crate::{Folder, image, pixels, ticking};

/// The network's size: 4:3.
const NETWORK: ImageSize = ImageSize::new(8, 6);

struct Answer {
    depth_m: Vec<f32>,
    labels: Vec<u8>,
    cloud: Vec<CloudPoint>,
    report: FrameReport,
}

fn pipeline(aspect: AspectMode, camera: Option<Camera>) -> Pipeline {
    let graph = Folder::new().model("m.onnx", &models::wnet(NETWORK, false)).load("m.onnx").unwrap();
    let options = PipelineOptions {
        aspect,
        camera,
        scale: ScaleMode::Off,
        max_range_m: Some(1e6),
        ..PipelineOptions::default()
    };
    Pipeline::new(graph, options).unwrap()
}

fn run(pipeline: &mut Pipeline, frame: &ImageView<'_>) -> Answer {
    let pixels = pipeline.size().pixel_count();
    let (mut depth_m, mut labels) = (vec![-1.0; pixels], vec![99; pixels]);
    let mut cloud = vec![CloudPoint::NONE; pixels];
    let outputs = Outputs {
        depth_m: &mut depth_m,
        labels: Some(&mut labels),
        confidence: None,
        cloud: Some(&mut cloud),
    };
    let report = pipeline.process(frame, outputs, &ticking()).unwrap();
    Answer { depth_m, labels, cloud, report }
}

fn camera(ImageSize { width, height }: ImageSize) -> Camera {
    let (cx, cy) = (0.4 * f64::from(width), 0.55 * f64::from(height));
    let focal = f64::from(width.max(height));
    Camera::pinhole(Intrinsics::new(focal, 1.1 * focal, cx, cy, width, height).unwrap())
}

#[test]
fn a_crop_is_the_same_as_cropping_the_image_before() {
    for (size, view) in [
        ((14, 6), PixelRect { x: 3, y: 0, width: 8, height: 6 }), // no resizing
        ((29, 12), PixelRect { x: 6, y: 0, width: 16, height: 12 }), // half a pixel left of the center
        ((9, 12), PixelRect { x: 0, y: 2, width: 9, height: 7 }), // portrait
        ((5, 40), PixelRect { x: 0, y: 18, width: 5, height: 4 }), // 1:8
    ] {
        let size = ImageSize::from(size);
        let rgb = image(size);
        let frame = ImageView::packed(&rgb, size.width, size.height, PixelFormat::Rgb8).unwrap();
        let cropped = run(&mut pipeline(AspectMode::Crop, Some(camera(size))), &frame);
        let part = frame.part(view).unwrap();
        let own = camera(size).cropped(view);
        let expected = run(&mut pipeline(AspectMode::Stretch, Some(own)), &part);
        assert_eq!(cropped.report.view, view, "{size}");
        assert_eq!(cropped.depth_m, expected.depth_m, "{size}");
        assert_eq!(cropped.labels, expected.labels, "{size}");
        assert_eq!(cropped.cloud, expected.cloud, "{size}");
        assert_eq!(cropped.report.camera, expected.report.camera, "{size}");
        assert_eq!(expected.report.view, PixelRect::whole(part.size()));
    }
}

#[test]
fn the_ray_of_a_result_is_that_of_its_pixel_in_the_image() {
    let size = ImageSize::new(29, 12);
    let of_image = camera(size);
    for aspect in [AspectMode::Crop, AspectMode::Stretch, AspectMode::Letterbox] {
        let mut pipeline = pipeline(aspect, Some(of_image));
        let rgb = image(size);
        let answer =
            run(&mut pipeline, &ImageView::packed(&rgb, size.width, size.height, PixelFormat::Rgb8).unwrap());
        let (view, points) = (answer.report.view, *pipeline.points_camera());
        assert_eq!(answer.report.camera, Some(points));
        let scale = f64::from(view.width) / f64::from(NETWORK.width);
        for column in 0..NETWORK.width {
            // The documented mapping of pixels.
            let u = (f64::from(column) + 0.5) * scale - 0.5 + f64::from(view.x);
            let expected = (u - of_image.intrinsics.cx_px) / of_image.intrinsics.fx_px;
            let got = (f64::from(column) - points.intrinsics.cx_px) / points.intrinsics.fx_px;
            assert!((got - expected).abs() < 1e-12, "{aspect:?} {column}: {got} {expected}");
        }
    }
}

#[test]
fn every_format_is_cropped_to_the_same_part() {
    let size = ImageSize::new(30, 12);
    for &format in PixelFormat::ALL {
        let stride = format.min_stride(size.width) + 3;
        let bytes: Vec<u8> =
            (0..format.byte_len(size.width, size.height, stride)).map(|i| (i * 31 % 251) as u8).collect();
        let frame = ImageView::new(&bytes, size.width, size.height, stride, format).unwrap();
        let mut rgb = nunet_core::preprocess::Preprocessor::new(size.width, size.height);
        let whole = rgb.prepare(&frame).rgb.to_vec();
        let view = PixelRect { x: 7, y: 0, width: 16, height: 12 };
        let part = ImageView::packed(&whole, size.width, size.height, PixelFormat::Rgb8).unwrap();
        let expected = run(&mut pipeline(AspectMode::Stretch, None), &part.part(view).unwrap());
        let got = run(&mut pipeline(AspectMode::Crop, None), &frame);
        assert_eq!(got.report.view, view);
        let differ = got.depth_m.iter().zip(&expected.depth_m).any(|(a, b)| (a - b).abs() > 0.1);
        assert!(!differ, "{format}: {:?} {:?}", got.depth_m, expected.depth_m);
    }
}

#[test]
fn a_letterbox_covers_the_whole_image_and_its_padding_is_not_in_the_results() {
    // 16 columns become 8, 6 rows become 3: one network pixel is a block of 2x2 pixels, in rows 1 to 3 of 6.
    let size = ImageSize::new(16, 6);
    let colors = [[200, 10, 20], [30, 180, 40], [50, 60, 220]];
    let rgb: Vec<u8> = (0..6).flat_map(|row| (0..16).flat_map(move |_| colors[row / 2])).collect();
    let frame = ImageView::packed(&rgb, size.width, size.height, PixelFormat::Rgb8).unwrap();
    let mut pipeline = pipeline(AspectMode::Letterbox, Some(camera(size)));
    let answer = run(&mut pipeline, &frame);
    assert_eq!(answer.report.view, PixelRect::whole(size));
    // The middle row of the three has no neighbor in the padding, and its results are rows 2 and 3 of 6.
    let band = |row: usize| &answer.labels[8 * row..8 * (row + 1)];
    assert_eq!([0, 1, 2, 3, 4, 5].map(|row| band(row)[3]), [0, 0, 1, 1, 2, 2]);
    let depth = |row: usize| answer.depth_m[8 * row + 3];
    let values: Vec<f32> = network_rows(&rgb, size);
    for (row, expected) in [values[0], 0.75 * values[0] + 0.25 * values[1]].into_iter().enumerate() {
        assert!((depth(row) - expected).abs() < 1e-4, "{row}: {} {expected}", depth(row));
    }
    assert!((depth(5) - values[2]).abs() < 1e-4);
    // Colors lie pixel on pixel with depth, and the camera is that of the whole image.
    assert_eq!(pipeline.network_image(&frame).len(), 3 * NETWORK.pixel_count());
    assert_eq!(answer.report.camera.unwrap(), camera(size).scaled_to(8, 6).unwrap());
}

/// Depth of each row of the network's image, without padding.
fn network_rows(rgb: &[u8], size: ImageSize) -> Vec<f32> {
    let mut small = nunet_core::preprocess::Preprocessor::new(8, 3);
    let frame = ImageView::packed(rgb, size.width, size.height, PixelFormat::Rgb8).unwrap();
    pixels(small.prepare(&frame).rgb).step_by(8).map(models::plain_depth).collect()
}

#[test]
fn an_aspect_ratio_within_five_percent_is_the_same_in_every_mode() {
    for size in [(8, 6), (21, 15), (100, 77), (77, 60)].map(ImageSize::from) {
        let rgb = image(size);
        let frame = ImageView::packed(&rgb, size.width, size.height, PixelFormat::Rgb8).unwrap();
        let stretched = run(&mut pipeline(AspectMode::Stretch, Some(camera(size))), &frame);
        for aspect in [AspectMode::Crop, AspectMode::Letterbox] {
            let mut pipeline = pipeline(aspect, Some(camera(size)));
            let got = run(&mut pipeline, &frame);
            assert_eq!(got.depth_m, stretched.depth_m, "{size}");
            assert_eq!(got.report, stretched.report, "{size}");
            assert_eq!(pipeline.framing().notice(), None);
        }
    }
}

#[test]
fn images_of_changing_sizes_are_each_cropped_by_their_own_size() {
    let mut pipeline = pipeline(AspectMode::Crop, None);
    for (size, view) in [
        ((16, 6), PixelRect { x: 4, y: 0, width: 8, height: 6 }),
        ((8, 6), PixelRect { x: 0, y: 0, width: 8, height: 6 }),
        ((8, 12), PixelRect { x: 0, y: 3, width: 8, height: 6 }),
        ((16, 6), PixelRect { x: 4, y: 0, width: 8, height: 6 }),
    ] {
        let size = ImageSize::from(size);
        let rgb = image(size);
        let frame = ImageView::packed(&rgb, size.width, size.height, PixelFormat::Rgb8).unwrap();
        let answer = run(&mut pipeline, &frame);
        assert_eq!(answer.report.view, view);
        let expected: Vec<f32> = (0..48)
            .map(|i| {
                let (column, row) = (view.x as usize + i % 8, view.y as usize + i / 8);
                models::plain_depth(pixels(&rgb).nth(row * size.width as usize + column).unwrap())
            })
            .collect();
        assert_eq!(answer.depth_m, expected, "{size}");
    }
}

#[test]
fn buffers_of_a_wrong_length_are_refused_with_padding_too() {
    let size = ImageSize::new(16, 6);
    let rgb = image(size);
    let frame = ImageView::packed(&rgb, size.width, size.height, PixelFormat::Rgb8).unwrap();
    for (depth, labels) in [(47, 48), (48, 47)] {
        let (mut depth_m, mut labels) = (vec![0.0; depth], vec![0; labels]);
        let outputs =
            Outputs { depth_m: &mut depth_m, labels: Some(&mut labels), confidence: None, cloud: None };
        let error = pipeline(AspectMode::Letterbox, None).process(&frame, outputs, &ticking()).unwrap_err();
        assert!(matches!(error, PipelineError::Graph(_)), "{error}");
    }
}

#[test]
fn a_notice_says_what_has_no_depth() {
    let notice = |aspect, width, height| {
        let mut pipeline = pipeline(aspect, None);
        pipeline.fit_to(ImageSize::new(width, height)).unwrap();
        pipeline.framing().notice()
    };
    let crop = notice(AspectMode::Crop, 16, 9).unwrap();
    assert!(crop.contains("12x9 at (2, 0)") && crop.contains("25 % of their width"), "{crop}");
    let tall = notice(AspectMode::Crop, 6, 8).unwrap();
    assert!(tall.contains("% of their height"), "{tall}");
    assert!(notice(AspectMode::Stretch, 16, 9).unwrap().contains("stretched to 8x6"));
    assert_eq!(notice(AspectMode::Letterbox, 16, 9), None);
}
