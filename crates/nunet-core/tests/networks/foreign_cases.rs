//! Foreign networks as users have them: sizes of their own, other inputs, meters for one camera.

use nunet_core::ErrorKind;
use nunet_core::camera::{Camera, Intrinsics};
use nunet_core::depth::ScaleSource;
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::graph::{GraphError, SerialGraph, WiringError};
use nunet_core::pipeline::{Outputs, Pipeline, PipelineOptions};
use nunet_testkit::onnx::{ModelBuilder, OnnxElement};
use nunet_types::ImageSize;

use crate::{Folder, chain, ticking};

const F32: OnnxElement = OnnxElement::F32;

/// `tests/cases/NAME.onnx` with its sidecar, changed by `edit`.
fn case(name: &str, edit: impl Fn(String) -> String) -> Result<SerialGraph, GraphError> {
    let path = |extension: &str| format!("tests/cases/{name}.{extension}");
    let folder = Folder::new();
    std::fs::copy(path("onnx"), folder.path("m.onnx")).unwrap();
    let sidecar = edit(std::fs::read_to_string(path("toml")).unwrap());
    folder.text("m.toml", &sidecar).load("m.onnx")
}

fn refused(result: Result<SerialGraph, GraphError>) -> GraphError {
    result.err().expect("the graph was loaded")
}

fn with_inputs(sidecar: &str, inputs: &str) -> String {
    format!("{sidecar}\n[inputs]\n{inputs}\n")
}

fn camera(fx: f64, width: u32, height: u32) -> Camera {
    Camera::pinhole(Intrinsics::new(fx, fx, 20.0, 13.0, width, height).unwrap())
}

/// Depth of an image of one gray level of the network's size.
fn depth_of(graph: SerialGraph, camera: Option<Camera>, rgb: &[u8]) -> (Vec<f32>, ScaleSource, u64) {
    let options = PipelineOptions { camera, ..PipelineOptions::default() };
    let mut pipeline = Pipeline::new(graph, options).unwrap();
    let ImageSize { width, height } = pipeline.size();
    let frame = ImageView::packed(rgb, width, height, PixelFormat::Rgb8).unwrap();
    let mut depth_m = vec![0.0; rgb.len() / 3];
    let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: None, cloud: None };
    let report = pipeline.process(&frame, outputs, &ticking()).unwrap();
    (depth_m, report.scale_source, report.bytes_copied)
}

#[test]
fn a_size_that_the_network_rounds_is_refused_with_both_sizes() {
    let sizes = |error: &GraphError| match *error {
        GraphError::DepthSize { width, height, depth_width, depth_height, .. } => {
            (width, height, depth_width, depth_height)
        }
        _ => panic!("{error}"),
    };
    let enlarged = refused(case("patch14", |text| text.replace("[30, 45]", "[10, 45]")));
    assert_eq!(sizes(&enlarged), (45, 10, 42, 14));
    let error = refused(case("patch14", |text| text));
    assert_eq!(sizes(&error), (45, 30, 42, 28));
    assert!(chain(&error).contains("hint: set `size = [28, 42]` in the sidecar"), "{}", chain(&error));
    assert_eq!(error.kind(), ErrorKind::Model);
}

#[test]
fn a_size_at_which_the_network_fails_is_refused_with_the_size() {
    // Depth is all values of the image in rows of 42: at other sizes, they do not fill the last row.
    let rows_of_42 = ModelBuilder::new()
        .input("x", F32, &[1, 3, -1, -1])
        .constant_i64("rows", &[3], &[1, -1, 42])
        .node("Reshape", &["x", "rows"], &["y"], &[])
        .output("y", F32, &[1, -1, 42]);
    let load = |size: &str| {
        let sidecar = format!(
            "[input]\ntensor = \"x\"\nlayout = \"nchw\"\nsize = {size}\n\
             [output]\ndepth = \"y\"\nencoding = \"relative\""
        );
        Folder::new().model("m.onnx", &rows_of_42).text("m.toml", &sidecar).load("m.onnx")
    };
    let error = refused(load("[10, 45]"));
    assert!(matches!(error, GraphError::ImageSize { width: 45, height: 10, .. }), "{error}");
    assert_eq!(error.kind(), ErrorKind::Model);
    assert_eq!(load("[28, 42]").unwrap().size(), (42, 28).into());
}

#[test]
fn a_size_that_the_network_takes_is_run() {
    let graph = case("patch14", |text| text.replace("[30, 45]", "[28, 42]")).unwrap();
    let (depth, ..) = depth_of(graph, None, &[70; 3 * 28 * 42]);
    assert!(depth.iter().all(|&value| (value - 70.0).abs() < 1e-3), "{:?}", &depth[..4]);
}

#[test]
fn depth_of_half_the_size_is_resized_to_the_image() {
    let graph = case("half_out", |text| text).unwrap();
    assert_eq!(graph.size(), (42, 28).into());
    // Left half black, right half white; the sidecar normalizes by the means of ImageNet.
    let rgb: Vec<u8> = (0..28 * 42).flat_map(|i| [if i % 42 < 20 { 0 } else { 255 }; 3]).collect();
    let (depth, _, bytes_copied) = depth_of(graph, None, &rgb);
    let level = |value: f32| {
        let channels = [(0.485, 0.229), (0.456, 0.224), (0.406, 0.225)];
        channels.map(|(mean, std)| (value - mean) / std).iter().sum::<f32>() / 3.0
    };
    for row in depth.chunks(42) {
        assert!((row[0] - level(0.0)).abs() < 1e-4 && (row[18] - level(0.0)).abs() < 1e-4, "{row:?}");
        assert!((row[21] - level(1.0)).abs() < 1e-4 && (row[41] - level(1.0)).abs() < 1e-4, "{row:?}");
        // The edge is between the tenth and the eleventh of the network's columns, at 19.5 of the image's.
        let middle = row[19] + row[20];
        assert!((middle - level(0.0) - level(1.0)).abs() < 1e-3, "{row:?}");
    }
    // The tensor of the image, and the resized depth.
    assert_eq!(bytes_copied, 4 * 3 * 28 * 42 + 4 * 28 * 42);
}

#[test]
fn meters_of_a_canonical_camera_are_corrected_by_its_focal_length() {
    let with_camera = |text: String| format!("{}\n[camera]\nfx = 1000\n", text.replace("fx = 1000\n", ""));
    let rgb = [4; 3 * 28 * 42];
    let (depth, source, _) =
        depth_of(case("canonical", with_camera).unwrap(), Some(camera(500.0, 42, 28)), &rgb);
    assert_eq!((depth[0], source), (2.0, ScaleSource::FocalScaled));
    let (depth, source, _) = depth_of(case("canonical", with_camera).unwrap(), None, &rgb);
    assert_eq!((depth[0], source), (4.0, ScaleSource::AssumedCamera));
}

#[test]
fn an_input_without_a_source_says_how_the_sidecar_feeds_it() {
    let error = refused(case("moge", |text| text));
    let GraphError::Wiring { source, .. } = &error else { panic!("{error}") };
    let is_tokens = |tensor: &str| tensor == "num_tokens";
    assert!(matches!(&**source, WiringError::Unbound { tensor, in_sidecar: true, .. } if is_tokens(tensor)));
    assert!(chain(&error).contains("`num_tokens = 1800`"), "{}", chain(&error));
    assert_eq!(error.kind(), ErrorKind::Wiring);
}

#[test]
fn a_constant_is_fed_to_a_second_input() {
    let feed = |inputs: &'static str, depth: &'static str| {
        case("moge", move |text| {
            let text = text.replace("depth = \"depth\"", &format!("depth = \"{depth}\""));
            with_inputs(&text, inputs)
        })
    };
    let rgb = [128; 3 * 28 * 42];
    let (plain, ..) = depth_of(feed("num_tokens = 1800", "depth").unwrap(), None, &rgb);
    let (scaled, ..) = depth_of(feed("num_tokens = 1800", "metric_scale").unwrap(), None, &rgb);
    assert!(plain[0] != 0.0 && (scaled[0] - 1800.0 * plain[0]).abs() <= 1e-3 * scaled[0].abs());
    for inputs in ["num_tokens = 1.5", "num_tokens = [1, 2]", "num_tokens = \"intrinsics\"", "tokens = 1"] {
        let error = refused(feed(inputs, "depth"));
        assert_eq!(error.kind(), ErrorKind::Wiring, "{inputs}: {error}");
    }
}

/// Depth of a network that takes the camera matrix: element `element` of K.
fn takes_camera(element: i64) -> ModelBuilder {
    ModelBuilder::new()
        .input("x", F32, &[1, 3, 2, 4])
        .input("K", F32, &[-1, 3, 3])
        .constant_f32("none", &[1, 3, 1, 1], &[0.0; 3])
        .constant_i64("flat", &[1], &[-1])
        .constant_i64("index", &[1], &[element])
        .node("Conv", &["x", "none"], &["zeros"], &[])
        .node("Reshape", &["K", "flat"], &["numbers"], &[])
        .node("Gather", &["numbers", "index"], &["number"], &[])
        .node("Add", &["zeros", "number"], &["y"], &[])
        .output("y", F32, &[1, 1, 2, 4])
}

#[test]
fn a_network_that_takes_the_camera_gets_it_at_its_own_size_and_is_not_corrected_again() {
    let sidecar = with_inputs(
        "[input]\ntensor = \"x\"\nlayout = \"nchw\"\nsize = [2, 4]\n[output]\ndepth = \"y\"\nencoding = \"metric\"",
        "K = \"intrinsics\"",
    );
    // At 8x4 the camera has fx 6, at the network's 4x2 it has 3; cx 5 becomes 2.25.
    let known = Camera::pinhole(Intrinsics::new(6.0, 6.0, 5.0, 3.0, 8, 4).unwrap());
    for (element, expected) in [(0, 3.0), (2, 2.25), (4, 3.0), (5, 1.25), (8, 1.0)] {
        let load = || {
            let folder = Folder::new().model("m.onnx", &takes_camera(element)).text("m.toml", &sidecar);
            folder.load("m.onnx").unwrap()
        };
        assert!(load().needs_camera());
        let (depth, source, _) = depth_of(load(), Some(known), &[0; 24]);
        assert_eq!((depth[0], source), (expected, ScaleSource::Metric), "element {element}");
        let (assumed, source, _) = depth_of(load(), None, &[0; 24]);
        assert_eq!(source, ScaleSource::AssumedCamera);
        assert!(assumed[0] > 0.0 && (element == 8 || assumed[0] != depth[0]));
    }
    let folder = Folder::new().model("m.onnx", &takes_camera(0)).text("m.toml", &sidecar);
    let mut pipeline = Pipeline::new(folder.load("m.onnx").unwrap(), PipelineOptions::default()).unwrap();
    pipeline.set_camera(Some(known)).unwrap();
    let frame = ImageView::packed(&[0; 24], 4, 2, PixelFormat::Rgb8).unwrap();
    let mut depth_m = [0.0; 8];
    let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: None, cloud: None };
    pipeline.process(&frame, outputs, &ticking()).unwrap();
    assert_eq!(depth_m, [3.0; 8], "a camera that is set later is fed too");
}

#[test]
fn constants_of_every_shape_are_fed_to_sessions_that_are_shared_too() {
    let model = ModelBuilder::new()
        .input("x", F32, &[1, 3, 2, 4])
        .input("shift", F32, &[1, 1, 2, 4])
        .constant_f32("none", &[1, 3, 1, 1], &[0.0; 3])
        .node("Conv", &["x", "none"], &["zeros"], &[])
        .node("Add", &["zeros", "shift"], &["y"], &[])
        .output("y", F32, &[1, 1, 2, 4]);
    let sidecar = with_inputs(
        "[input]\ntensor = \"x\"\nlayout = \"nchw\"\nsize = [2, 4]\n[output]\ndepth = \"y\"\nencoding = \"relative\"",
        "shift = [[1, 2, 3, 4], [5, 6, 7, 8.5]]",
    );
    let folder = Folder::new().model("m.onnx", &model).text("m.toml", &sidecar);
    let graph = folder.load("m.onnx").unwrap();
    let shared = graph.share_sessions().unwrap();
    for graph in [graph, shared] {
        let (depth, ..) = depth_of(graph, None, &[9; 24]);
        assert_eq!(depth, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.5]);
    }
}
