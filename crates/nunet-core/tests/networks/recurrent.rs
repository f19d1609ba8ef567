//! Networks with a memory: carried from frame to frame, forgotten on demand, whole after a failure.

use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::graph::{GraphError, GraphInput, GraphOutputs, SerialGraph, WiringError};
use nunet_core::hint_of;
use nunet_core::model::ModelError;
use nunet_core::pipeline::{Outputs, Pipeline, PipelineOptions};
use nunet_testkit::models;
use nunet_testkit::onnx::{ModelBuilder, OnnxElement};

use crate::{Folder, SIZE, error_of, image, pixels, run, ticking, wiring_error};

/// An image of its own for each number; the first pixel's red is the number too.
fn numbered(number: u8) -> Vec<u8> {
    let mut rgb: Vec<u8> = image(SIZE).iter().map(|value| value.wrapping_mul(number | 1)).collect();
    rgb[0] = number;
    rgb
}

/// The memory of [`models::remembering`], computed by hand.
struct Trail(Vec<f32>);

impl Trail {
    fn new() -> Self {
        Self(vec![0.0; image(SIZE).len() / 3])
    }

    fn remember(&mut self, rgb: &[u8]) {
        for (trail, pixel) in self.0.iter_mut().zip(pixels(rgb)) {
            *trail = models::next_trail(*trail, pixel);
        }
    }

    /// The depth of the next frame.
    fn depth(&mut self, rgb: &[u8]) -> Vec<f32> {
        let depth = pixels(rgb).zip(&self.0).map(|(pixel, trail)| models::plain_depth(pixel) + trail);
        let depth = depth.collect();
        self.remember(rgb);
        depth
    }
}

fn load(model: &ModelBuilder) -> SerialGraph {
    Folder::new().model("m.onnx", model).load("m.onnx").unwrap()
}

fn refused(model: &ModelBuilder) -> GraphError {
    error_of(Folder::new().model("m.onnx", model).load("m.onnx"))
}

fn floats(graph: &SerialGraph, tensor: &str) -> Vec<f32> {
    let bytes = graph.tensor(tensor).unwrap().bytes;
    bytes.as_chunks().0.iter().map(|&bytes| f32::from_ne_bytes(bytes)).collect()
}

/// A run that must fail in a stage; ONNX Runtime's message.
#[track_caller]
fn fail(graph: &mut SerialGraph, rgb: &[u8], expected_stage: &str) -> String {
    let mut depth = vec![0.0; rgb.len() / 3];
    let outputs = GraphOutputs { depth: &mut depth, labels: None, confidence: None };
    let error = graph.run(GraphInput::Rgb(rgb), outputs, &ticking()).unwrap_err();
    let GraphError::Run { stage, reason } = &error else { panic!("{error}") };
    assert_eq!(stage, expected_stage, "{error}");
    reason.to_string()
}

#[test]
fn state_is_passed_from_frame_to_frame_without_a_copy() {
    let mut graph = load(&models::remembering(SIZE));
    let mut trail = Trail::new();
    for number in 0..7 {
        let answer = run(&mut graph, &numbered(number));
        assert_eq!(answer.depth, trail.depth(&numbered(number)), "frame {number}");
        assert_eq!(answer.report.bytes_copied, 0);
        assert_eq!(floats(&graph, "network.trail_out"), trail.0, "what it remembers is a result too");
        assert_eq!(floats(&graph, "network.count_out"), [f32::from(number) + 1.0]);
    }
    assert_eq!(graph.stages()[0].state.len(), 2);
}

#[test]
fn a_reset_clears_state_after_an_even_and_an_odd_number_of_frames() {
    let mut graph = load(&models::remembering(SIZE));
    for frames in 0..4 {
        let mut trail = Trail::new();
        for number in 0..frames {
            assert_eq!(run(&mut graph, &numbered(number)).depth, trail.depth(&numbered(number)));
        }
        graph.reset();
        assert!(graph.tensor("network.trail_out").is_none(), "there is no last run");
    }
}

#[test]
fn a_failed_run_keeps_the_state_of_the_last_good_one() {
    // The failing node reads what the network remembers next, so that has been written by then.
    let mut graph = load(&models::fragile(models::remembering(SIZE), "trail_out"));
    let mut trail = Trail::new();
    for number in [32, 64, 48] {
        assert_eq!(run(&mut graph, &numbered(number)).depth, trail.depth(&numbered(number)));
        for _ in 0..3 {
            fail(&mut graph, &numbered(255), "network");
        }
    }
}

const TRAIL_AND_DEPTH: &str = r#"
version = 1
[[stage]]
name = "trail"
model = "trail.onnx"
inputs = { rgb = "image" }
[[stage]]
name = "depth"
model = "depth.onnx"
inputs = { coarse = "trail.trail_out" }
[outputs]
depth = "depth.depth"
"#;

/// Depth is twice the trail.
fn staged(manifest: &str) -> SerialGraph {
    let second = models::fragile(models::refine_stage(SIZE, false), "coarse");
    let folder = Folder::new().model("trail.onnx", &models::trail_stage(SIZE)).model("depth.onnx", &second);
    folder.text("graph.toml", manifest).load("graph.toml").unwrap()
}

#[test]
fn a_stage_may_have_state_and_later_stages_read_its_new_value() {
    let mut graph = staged(TRAIL_AND_DEPTH);
    let mut trail = Trail::new();
    for number in [32, 64, 48] {
        trail.remember(&numbered(number));
        let expected: Vec<f32> = trail.0.iter().map(|trail| 2.0 * trail).collect();
        assert_eq!(run(&mut graph, &numbered(number)).depth, expected);
        // The first stage has run by then, the second one fails.
        fail(&mut graph, &numbered(255), "depth");
    }
}

#[test]
fn a_skipped_stage_keeps_the_state_of_its_last_run() {
    let manifest = TRAIL_AND_DEPTH.replacen(
        "inputs = { rgb = \"image\" }",
        "inputs = { rgb = \"image\" }\nevery = 2",
        1,
    );
    let mut graph = staged(&manifest);
    let mut trail = Trail::new();
    for number in [10, 20, 30, 40, 50] {
        if number % 20 == 10 {
            trail.remember(&numbered(number));
        }
        let expected: Vec<f32> = trail.0.iter().map(|trail| 2.0 * trail).collect();
        assert_eq!(run(&mut graph, &numbered(number)).depth, expected, "frame {number}");
        assert_eq!(floats(&graph, "trail.trail_out"), trail.0);
    }
    assert_eq!(floats(&graph, "trail.count_out"), [3.0]);
}

#[test]
fn a_self_test_and_a_reset_of_the_pipeline_leave_zeros() {
    let mut pipeline = Pipeline::new(load(&models::remembering(SIZE)), PipelineOptions::default()).unwrap();
    assert!(!pipeline.is_stateless());
    let depth_of = |pipeline: &mut Pipeline, number: u8| {
        let (rgb, mut depth_m) = (numbered(number), vec![0.0; 18]);
        let frame = ImageView::packed(&rgb, SIZE.width, SIZE.height, PixelFormat::Rgb8).unwrap();
        let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: None, cloud: None };
        pipeline.process(&frame, outputs, &ticking()).unwrap();
        depth_m
    };
    for selftest in [true, false, true] {
        if selftest {
            pipeline.selftest(&ticking()).unwrap();
        } else {
            pipeline.reset();
        }
        let mut trail = Trail::new();
        for number in 0..3 {
            assert_eq!(depth_of(&mut pipeline, number), trail.depth(&numbered(number)));
        }
    }
}

#[test]
fn state_that_contradicts_the_file_is_refused_naming_both_sides() {
    let refused_with = |from: &str, to: &str| {
        let state = models::trail_state(SIZE).replace(from, to);
        refused(&models::remembering(SIZE).metadata("nunet.state", &state))
    };
    let differs = |tensor: &str, expected: &str, given: &str| WiringError::StateKind {
        stage: "network".into(),
        side: "input",
        tensor: tensor.into(),
        expected: expected.into(),
        given: given.into(),
    };
    let missing = WiringError::StateMissing {
        stage: "network".into(),
        side: "input",
        tensor: "trial_in".into(),
        there: "`rgb`, `trail_in`, `count_in`".into(),
    };
    assert!(hint_of(&missing).is_some());
    for (from, to, expected) in [
        ("[1]", "[2]", differs("count_in", "float32 [2]", "float32 [1]")),
        ("trail_in", "rgb", differs("rgb", "float32 [1, 1, 3, 6]", "uint8 [1, 3, 6, 3]")),
        ("trail_in", "trial_in", missing),
        ("trail_out", "depth", WiringError::StateIsDepth { reference: "network.depth".into() }),
    ] {
        assert_eq!(wiring_error(refused_with(from, to)), expected);
    }
    let error = refused_with("count_in", "trail_in");
    assert!(is_bad_state(&error, "m.onnx"), "{error}");
}

/// Whether the description of the state in a file is invalid.
fn is_bad_state(error: &GraphError, file: &str) -> bool {
    matches!(
        error,
        GraphError::Description { path, source: ModelError::Invalid { key: "nunet.state", .. } }
            if path.ends_with(file)
    )
}

#[test]
fn the_state_of_a_stage_is_described_in_its_own_file() {
    let wrong = models::trail_stage(SIZE).metadata("nunet.state", "trail");
    let folder = Folder::new().model("trail.onnx", &wrong);
    let folder = folder.model("depth.onnx", &models::refine_stage(SIZE, false));
    let error = error_of(folder.text("graph.toml", TRAIL_AND_DEPTH).load("graph.toml"));
    assert!(is_bad_state(&error, "trail.onnx"), "{error}");
}

/// Remembers where the image is not 0: two places by its declaration, but as many as there are. Depth is the
/// sum of the places of the image before. The state is made of `tensor`: `where` of shape [1, n], or `places`
/// of shape [n].
fn remembering_places(tensor: &str) -> ModelBuilder {
    let shape: &[i64] = &[1, 1, 3, 6];
    let model = ModelBuilder::new()
        .input("rgb", OnnxElement::U8, &[1, 3, 6, 3])
        .input("kept_in", OnnxElement::F32, &[2])
        .constant_i64("shape", &[4], shape)
        .constant_i64("line", &[1], &[-1])
        .node("ReduceSum", &["kept_in"], &["sum"], &[])
        .node("Expand", &["sum", "shape"], &["depth"], &[])
        .node("Cast", &["rgb"], &["float"], &[("to", 1.into())])
        .node("Reshape", &["float", "line"], &["values"], &[])
        .node("NonZero", &["values"], &["where"], &[])
        .node("Reshape", &["where", "line"], &["places"], &[])
        .node("Cast", &[tensor], &["kept_out"], &[("to", 1.into())])
        .output("depth", OnnxElement::F32, shape)
        .output("kept_out", OnnxElement::F32, &[2])
        .metadata("nunet.state", r#"[{"input": "kept_in", "output": "kept_out", "shape": [2]}]"#);
    models::describe(model, "places", false)
}

#[test]
fn state_whose_computed_shape_is_not_the_declared_one_is_refused_at_load() {
    let error = wiring_error(refused(&remembering_places("where")));
    let WiringError::StateKind { side: "output", tensor, expected, .. } = &error else { panic!("{error}") };
    assert_eq!((&**tensor, &**expected), ("kept_out", "float32 [2]"));
}

#[test]
fn state_of_another_shape_than_declared_is_an_error_of_the_run() {
    let image_with = |places: &[usize]| {
        let mut rgb = vec![0; image(SIZE).len()];
        places.iter().for_each(|&place| rgb[place] = 1);
        rgb
    };
    let mut graph = load(&remembering_places("places"));
    run(&mut graph, &image_with(&[3, 5]));
    assert_eq!(floats(&graph, "network.kept_out"), [3.0, 5.0]);
    let none: &[usize] = &[];
    for places in [none, &[7], &[7, 8, 9]] {
        let message = fail(&mut graph, &image_with(places), "network");
        assert!(message.contains("kept_out"), "{message}");
    }
    assert_eq!(run(&mut graph, &image_with(&[0, 1])).depth, [8.0; 18], "that of the last good run");
}
