//! The optional output `confidence`: which pixel it belongs to, and where it is 0.

use nunet_core::filter::{FilterOptions, FilterSpec};
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::framing::AspectMode;
use nunet_core::pipeline::{Outputs, Pipeline, PipelineOptions};
use nunet_core::scale::ScaleMode;
use nunet_testkit::models;
use nunet_testkit::onnx::{ModelBuilder, OnnxElement};
use nunet_types::ImageSize;

use crate::{Folder, SIZE, image, pixels, refusal};

/// The network's size in tests of framing and decimation.
const LARGE: ImageSize = ImageSize::new(9, 6);

/// Depth is valid up to this: some pixels of the test image are farther.
const MAX_M: f32 = 12.0;

fn model(size: ImageSize) -> ModelBuilder {
    let model = models::with_confidence(models::unet(size), size);
    model.metadata("nunet.depth.max_m", &MAX_M.to_string())
}

fn pipeline(model: &ModelBuilder, options: PipelineOptions) -> Pipeline {
    let graph = Folder::new().model("m.onnx", model).load("m.onnx").unwrap();
    Pipeline::new(graph, PipelineOptions { scale: ScaleMode::Off, ..options }).unwrap()
}

/// Depth and confidence of an image.
fn run(pipeline: &mut Pipeline, rgb: &[u8], size: ImageSize) -> (Vec<f32>, Vec<u8>) {
    let mut depth_m = vec![-1.0; pipeline.size().pixel_count()];
    let frame = ImageView::packed(rgb, size.width, size.height, PixelFormat::Rgb8).unwrap();
    let outputs = Outputs { depth_m: &mut depth_m, labels: None, cloud: None };
    pipeline.process(&frame, outputs, &|| 0).unwrap();
    (depth_m, pipeline.confidence().unwrap().to_vec())
}

/// The confidence of a pixel: 0 where its depth is invalid.
fn expected(pixel: [u8; 3]) -> u8 {
    if models::plain_depth(pixel) <= MAX_M { pixel[0] } else { 0 }
}

#[test]
fn each_pixel_has_its_confidence_and_invalid_depth_has_none() {
    let rgb = image(SIZE);
    let mut pipeline = pipeline(&model(SIZE), PipelineOptions::default());
    assert!(pipeline.graph().has_confidence());
    for _ in 0..2 {
        let (depth_m, confidence) = run(&mut pipeline, &rgb, SIZE);
        let wanted: Vec<u8> = pixels(&rgb).map(expected).collect();
        assert_eq!(confidence, wanted);
        let invalid = depth_m.iter().filter(|depth| depth.is_nan()).count();
        assert!((1..depth_m.len()).contains(&invalid), "{invalid} pixels without depth");
    }
}

#[test]
fn a_model_without_it_has_none() {
    let mut pipeline = pipeline(&models::unet(SIZE), PipelineOptions::default());
    let rgb = image(SIZE);
    let frame = ImageView::packed(&rgb, SIZE.width, SIZE.height, PixelFormat::Rgb8).unwrap();
    let outputs = Outputs { depth_m: &mut [0.0; 18], labels: None, cloud: None };
    let report = pipeline.process(&frame, outputs, &|| 0).unwrap();
    assert_eq!((pipeline.confidence(), report.bytes_copied), (None, 0));
    assert!(!pipeline.graph().has_confidence());
}

#[test]
fn the_confidence_of_a_padded_image_lies_where_its_colors_lie() {
    let size = ImageSize::new(4, 7); // portrait, in a landscape network
    let rgb = image(size);
    let options = PipelineOptions { aspect: AspectMode::Letterbox, ..PipelineOptions::default() };
    let mut pipeline = pipeline(&models::with_confidence(models::unet(LARGE), LARGE), options);
    let (depth_m, confidence) = run(&mut pipeline, &rgb, size);
    assert!(depth_m.iter().all(|depth| depth.is_finite()));
    let frame = ImageView::packed(&rgb, size.width, size.height, PixelFormat::Rgb8).unwrap();
    let colors = pipeline.network_image(&frame);
    assert_eq!(confidence, pixels(colors).map(|[r, ..]| r).collect::<Vec<_>>());
}

#[test]
fn decimation_takes_the_mean_of_a_block() {
    let rgb = image(LARGE);
    let specs: [FilterSpec; 1] = ["decimation=3".parse().unwrap()];
    let filters = FilterOptions::new(&specs).unwrap();
    let mut pipeline = pipeline(&model(LARGE), PipelineOptions { filters, ..PipelineOptions::default() });
    let (_, confidence) = run(&mut pipeline, &rgb, LARGE);
    let of_network: Vec<u8> = pixels(&rgb).map(expected).collect();
    let block = |column: usize, row: usize| {
        let at = |i: usize| (3 * row + i / 3) * LARGE.width as usize + 3 * column + i % 3;
        let sum: u32 = (0..9).map(|i| u32::from(of_network[at(i)])).sum();
        ((sum + 4) / 9) as u8
    };
    assert_eq!(confidence, [block(0, 0), block(1, 0), block(2, 0), block(0, 1), block(1, 1), block(2, 1)]);
}

#[test]
fn depth_that_a_filter_filled_in_is_not_certain() {
    let rgb = image(LARGE);
    let specs: [FilterSpec; 1] = ["holes=nearest".parse().unwrap()];
    let filters = FilterOptions::new(&specs).unwrap();
    let mut pipeline = pipeline(&model(LARGE), PipelineOptions { filters, ..PipelineOptions::default() });
    let (_, confidence) = run(&mut pipeline, &rgb, LARGE);
    assert_eq!(confidence, pixels(&rgb).map(expected).collect::<Vec<_>>());
}

const STAGED: &str = r#"
version = 1
[[stage]]
name = "segmentation"
model = "segmentation.onnx"
inputs = { rgb = "image" }
[[stage]]
name = "depth"
model = "depth.onnx"
inputs = { rgb = "image", features = "segmentation.logits" }
[outputs]
depth = "depth.depth"
labels = "segmentation.labels"
confidence = "depth.confidence"
"#;

fn staged(text: &str) -> Folder {
    Folder::new()
        .model("segmentation.onnx", &models::segmentation_stage(SIZE))
        .model("depth.onnx", &models::with_confidence(models::depth_stage(SIZE, true), SIZE))
        .text("graph.toml", text)
}

#[test]
fn a_staged_graph_names_it_among_its_outputs() {
    let rgb = image(SIZE);
    let graph = staged(STAGED).load("graph.toml").unwrap();
    let mut pipeline = Pipeline::new(graph, PipelineOptions::default()).unwrap();
    let (_, confidence) = run(&mut pipeline, &rgb, SIZE);
    assert_eq!(confidence, pixels(&rgb).map(|[r, ..]| r).collect::<Vec<_>>());
    let without = staged(&STAGED.replace("confidence = \"depth.confidence\"\n", ""));
    assert!(!without.load("graph.toml").unwrap().has_confidence());
}

#[test]
fn a_confidence_of_another_type_or_shape_is_refused() {
    let one_row = models::unet(SIZE)
        .constant_i64("first", &[1], &[0])
        .node("Cast", &["planes"], &["bytes"], &[("to", (OnnxElement::U8 as i64).into())])
        .node("Gather", &["bytes", "first"], &["confidence"], &[("axis", 1.into())])
        .output("confidence", OnnxElement::U8, &[1, 1, 3, 6]);
    let floats = models::unet(SIZE).node("Identity", &["depth"], &["confidence"], &[]).output(
        "confidence",
        OnnxElement::F32,
        &[1, 1, 3, 6],
    );
    for (model, given) in [(one_row, "uint8 [1, 1, 3, 6]"), (floats, "float32 [1, 1, 3, 6]")] {
        let text = refusal(Folder::new().model("m.onnx", &model).load("m.onnx"));
        let wanted = format!(
            "output `confidence` is `network.confidence` of {given}, expected uint8 [1, 3, 6] for an image of 6x3"
        );
        assert!(text.contains(&wanted), "{text}");
    }
}

#[test]
fn a_confidence_of_skipped_frames_and_labels_as_confidence_are_refused() {
    let early = STAGED
        .replace("name = \"segmentation\"\n", "name = \"segmentation\"\nevery = 2\n")
        .replace("confidence = \"depth.confidence\"", "confidence = \"segmentation.labels\"");
    let text = refusal(staged(&early.replace("labels = \"segmentation.labels\"\n", "")).load("graph.toml"));
    assert!(text.contains("has `every = 2`, but computes the confidence"), "{text}");
    let text = refusal(staged(&early).load("graph.toml"));
    assert!(text.contains("`labels` and `confidence` are both `segmentation.labels`"), "{text}");
}
