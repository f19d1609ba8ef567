//! The optional output `confidence`: which pixel it belongs to, where it is 0, and into whose memory it is
//! written.

use nunet_core::ErrorKind;
use nunet_core::cloud::CloudPoint;
use nunet_core::depth::BorderFill;
use nunet_core::filter::{FilterOptions, FilterSpec};
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::framing::AspectMode;
use nunet_core::graph::{GraphError, GraphInput, GraphOutputs, WiringError};
use nunet_core::pipeline::{FrameReport, Outputs, Pipeline, PipelineError, PipelineOptions};
use nunet_core::scale::ScaleMode;
use nunet_testkit::onnx::{ModelBuilder, OnnxElement};
use nunet_testkit::{manifests, models};
use nunet_types::ImageSize;

use crate::{Folder, SIZE, error_of, image, pixels, ticking, wiring_error};

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

fn filters(text: &str) -> FilterOptions {
    FilterOptions::new(&[text.parse::<FilterSpec>().unwrap()]).unwrap()
}

/// Depth of an image; its confidence is written into `memory`, if there is any.
fn process(
    pipeline: &mut Pipeline,
    rgb: &[u8],
    size: ImageSize,
    memory: Option<&mut [u8]>,
) -> Result<(Vec<f32>, FrameReport), PipelineError> {
    let mut depth_m = vec![-1.0; pipeline.size().pixel_count()];
    let frame = ImageView::packed(rgb, size.width, size.height, PixelFormat::Rgb8).unwrap();
    let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: memory, cloud: None };
    let report = pipeline.process(&frame, outputs, &|| 0)?;
    Ok((depth_m, report))
}

/// Depth and confidence of an image, and how many bytes were copied: the same whether the confidence is
/// written into memory of the caller or stays inside.
fn run(pipeline: &mut Pipeline, rgb: &[u8], size: ImageSize) -> (Vec<f32>, Vec<u8>, u64) {
    let mut memory = vec![99; pipeline.size().pixel_count()];
    let (depth_m, lent) = process(pipeline, rgb, size, Some(&mut memory)).unwrap();
    assert_eq!(pipeline.confidence(), None, "it is in the caller's memory");
    let (_, kept) = process(pipeline, rgb, size, None).unwrap();
    assert_eq!(pipeline.confidence(), Some(&memory[..]));
    assert_eq!(lent.bytes_copied, kept.bytes_copied);
    (depth_m, memory, lent.bytes_copied)
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
        let (depth_m, confidence, bytes_copied) = run(&mut pipeline, &rgb, SIZE);
        assert_eq!(bytes_copied, 0);
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
    let outputs = Outputs { depth_m: &mut [0.0; 18], labels: None, confidence: None, cloud: None };
    let report = pipeline.process(&frame, outputs, &|| 0).unwrap();
    assert_eq!((pipeline.confidence(), report.bytes_copied), (None, 0));
    assert!(!pipeline.graph().has_confidence());
}

#[test]
fn the_confidence_of_a_padded_image_lies_where_its_colors_lie() {
    let size = ImageSize::new(4, 7); // portrait, in a landscape network
    let rgb = image(size);
    let options = PipelineOptions { aspect: AspectMode::Letterbox, ..PipelineOptions::default() };
    let (_, without) = process(&mut pipeline(&models::unet(LARGE), options), &rgb, size, None).unwrap();
    let mut pipeline = pipeline(&models::with_confidence(models::unet(LARGE), LARGE), options);
    let (depth_m, confidence, bytes_copied) = run(&mut pipeline, &rgb, size);
    assert_eq!(bytes_copied, without.bytes_copied + 54, "it is taken out of its padding once");
    assert!(depth_m.iter().all(|depth| depth.is_finite()));
    let frame = ImageView::packed(&rgb, size.width, size.height, PixelFormat::Rgb8).unwrap();
    let colors = pipeline.network_image(&frame);
    assert_eq!(confidence, pixels(colors).map(|[r, ..]| r).collect::<Vec<_>>());
}

#[test]
fn decimation_takes_the_mean_of_a_block() {
    let rgb = image(LARGE);
    let options = PipelineOptions { filters: filters("decimation=3"), ..PipelineOptions::default() };
    let (_, confidence, bytes_copied) = run(&mut pipeline(&model(LARGE), options), &rgb, LARGE);
    assert_eq!(bytes_copied, 0);
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
    let options = PipelineOptions { filters: filters("holes=nearest"), ..PipelineOptions::default() };
    let (_, confidence, _) = run(&mut pipeline(&model(LARGE), options), &rgb, LARGE);
    assert_eq!(confidence, pixels(&rgb).map(expected).collect::<Vec<_>>());
}

#[test]
fn at_the_border_it_is_that_of_the_pixels_whose_depth_is_taken() {
    let size = ImageSize::new(140, 128);
    let rgb = image(size);
    let mut pipeline = pipeline(&model(size).metadata("nunet.trained", "true"), PipelineOptions::default());
    let (depth_m, confidence, bytes_copied) = run(&mut pipeline, &rgb, size);
    let border = BorderFill::new(size).unwrap();
    let mut wanted: Vec<u8> = pixels(&rgb).map(expected).collect();
    let plain = wanted.clone();
    border.apply(&mut wanted);
    assert!(confidence == wanted && wanted != plain);
    assert!(depth_m.iter().zip(&confidence).all(|(depth, value)| !depth.is_nan() || *value == 0));
    assert_eq!(bytes_copied, 0);
}

#[test]
fn memory_of_another_length_or_for_a_network_without_it_is_refused() {
    let rgb = image(LARGE);
    let letterbox = PipelineOptions { aspect: AspectMode::Letterbox, ..PipelineOptions::default() };
    let decimated = PipelineOptions { filters: filters("decimation=3"), ..PipelineOptions::default() };
    for (options, size) in [
        (PipelineOptions::default(), LARGE),
        (letterbox, ImageSize::new(6, 9)), // of as many pixels
        (decimated, LARGE),
    ] {
        let mut sure = pipeline(&model(LARGE), options);
        let mut memory = vec![0; sure.size().pixel_count() + 1];
        let error = process(&mut sure, &rgb, size, Some(&mut memory)).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Buffer, "{error}");
        let mut without = pipeline(&models::unet(LARGE), options);
        memory.pop();
        let error = process(&mut without, &rgb, size, Some(&mut memory)).unwrap_err();
        assert!(matches!(error, PipelineError::Graph(GraphError::NoConfidence)), "{error}");
        assert!(process(&mut sure, &rgb, size, Some(&mut memory)).is_ok(), "an error leaves it usable");
    }
}

#[test]
fn memory_of_another_length_is_refused_before_a_network_with_a_state_takes_the_frame() {
    let (rgb, model) = (image(LARGE), models::with_confidence(models::remembering(LARGE), LARGE));
    let frame = ImageView::packed(&rgb, LARGE.width, LARGE.height, PixelFormat::Rgb8).unwrap();
    let decimated = PipelineOptions { filters: filters("decimation=3"), ..PipelineOptions::default() };
    for options in [PipelineOptions::default(), decimated] {
        let [mut sure, mut mistaken] = [(); 2].map(|()| pipeline(&model, options));
        let pixels = sure.size().pixel_count();
        for more in [[1, 0, 0], [0, 1, 0], [0, 0, 1]] {
            let [depth, confidence, cloud] = more.map(|more| pixels + more);
            let (mut depth, mut confidence) = (vec![0.0; depth], vec![0; confidence]);
            let mut cloud = vec![CloudPoint::NONE; cloud];
            let outputs = Outputs {
                depth_m: &mut depth,
                labels: None,
                confidence: Some(&mut confidence),
                cloud: Some(&mut cloud),
            };
            let error = mistaken.process(&frame, outputs, &|| 0).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Buffer, "{error}");
            let [expected, found] =
                [&mut sure, &mut mistaken].map(|pipeline| process(pipeline, &rgb, LARGE, None).unwrap().0);
            assert_eq!(found, expected, "{more:?}");
        }
    }
}

#[test]
fn a_graph_writes_it_into_the_callers_memory() {
    let rgb = image(SIZE);
    let mut graph = Folder::new().model("m.onnx", &model(SIZE)).load("m.onnx").unwrap();
    let reds: Vec<u8> = pixels(&rgb).map(|[r, ..]| r).collect();
    for is_lent in [true, false, true] {
        let (mut depth, mut memory) = ([0.0; 18], [99; 18]);
        let confidence = is_lent.then_some(&mut memory[..]);
        let outputs = GraphOutputs { depth: &mut depth, labels: None, confidence };
        let report = graph.run(GraphInput::Rgb(&rgb), outputs, &ticking()).unwrap();
        assert_eq!(report.bytes_copied, 0);
        assert_eq!(graph.confidence(), (!is_lent).then_some(&reds[..]));
        assert_eq!(graph.tensor("network.confidence").is_none(), is_lent);
        assert_eq!(memory[..] == reds[..], is_lent);
    }
    let mut without = Folder::new().model("m.onnx", &models::unet(SIZE)).load("m.onnx").unwrap();
    let (mut depth, mut memory) = ([0.0; 18], [0; 18]);
    let outputs = GraphOutputs { depth: &mut depth, labels: None, confidence: Some(&mut memory) };
    let error = without.run(GraphInput::Rgb(&rgb), outputs, &ticking()).unwrap_err();
    assert!(matches!(error, GraphError::NoConfidence), "{error}");
}

/// A manifest whose last line is the output of the confidence.
fn manifest(every: u32, confidence: &str) -> String {
    manifests::two_stages(true, every) + &format!("confidence = \"{confidence}\"\n")
}

fn staged(text: &str) -> Folder {
    Folder::new()
        .model("segmentation.onnx", &models::segmentation_stage(SIZE))
        .model("depth.onnx", &models::with_confidence(models::depth_stage(SIZE, true), SIZE))
        .text("graph.toml", text)
}

#[test]
fn a_staged_graph_names_it_among_its_outputs() {
    let rgb = image(SIZE);
    let graph = staged(&manifest(1, "depth.confidence")).load("graph.toml").unwrap();
    let mut pipeline = Pipeline::new(graph, PipelineOptions::default()).unwrap();
    let (_, confidence, bytes_copied) = run(&mut pipeline, &rgb, SIZE);
    assert_eq!(confidence, pixels(&rgb).map(|[r, ..]| r).collect::<Vec<_>>());
    assert_eq!(bytes_copied, 0);
    let without = staged(&manifests::two_stages(true, 1));
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
        let error = wiring_error(error_of(Folder::new().model("m.onnx", &model).load("m.onnx")));
        let expected = WiringError::Result {
            role: "confidence",
            reference: "network.confidence".into(),
            given: given.into(),
            expected: "uint8 [1, 3, 6]".into(),
            width: 6,
            height: 3,
        };
        assert_eq!(error, expected);
    }
}

#[test]
fn a_confidence_of_skipped_frames_and_labels_as_confidence_are_refused() {
    let early = manifest(2, "segmentation.labels");
    let error = |manifest: &str| wiring_error(error_of(staged(manifest).load("graph.toml")));
    let without_labels = early.replace("labels = \"segmentation.labels\"\n", "");
    let skipped = WiringError::DepthSkipped { role: "confidence", stage: "segmentation".into(), every: 2 };
    assert_eq!(error(&without_labels), skipped);
    assert_eq!(error(&early), WiringError::SameResult { reference: "segmentation.labels".into() });
}
