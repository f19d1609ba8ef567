//! Where a run reads and writes: the caller's memory, at any alignment, and nowhere else.

use nunet_core::graph::{ElementType, GraphError, GraphInput, GraphOutputs, SerialGraph, WiringError};
use nunet_testkit::models;
use nunet_testkit::onnx::{ModelBuilder, OnnxElement};

use crate::{Folder, SIZE, error_of, image, pixels, ticking, wiring_error};

fn wnet() -> SerialGraph {
    Folder::new().model("wnet.onnx", &models::wnet(SIZE, true)).load("wnet.onnx").unwrap()
}

#[test]
fn each_of_many_buffers_gets_its_own_result() {
    let mut graph = wnet();
    let pixel_count = image(SIZE).len() / 3;
    // More than are remembered, so that remembered ones are forgotten and met again.
    let mut buffers: Vec<(Vec<u8>, Vec<f32>, Vec<u8>)> = (0..150_u8)
        .map(|i| {
            let rgb = image(SIZE).iter().map(|value| value.wrapping_add(i)).collect();
            (rgb, vec![-1.0; pixel_count], vec![99; pixel_count])
        })
        .collect();
    for _ in 0..2 {
        for (rgb, depth, labels) in &mut buffers {
            depth.fill(-1.0);
            labels.fill(99);
            let outputs = GraphOutputs { depth, labels: Some(labels), confidence: None };
            graph.run(GraphInput::Rgb(rgb), outputs, &ticking()).unwrap();
        }
        for (rgb, depth, labels) in &buffers {
            assert!(pixels(rgb).map(models::connected_depth).eq(depth.iter().copied()));
            assert!(pixels(rgb).map(models::label).eq(labels.iter().copied()));
        }
    }
}

#[test]
fn an_address_that_was_freed_and_allocated_again_is_safe() {
    let mut graph = wnet();
    for i in 0..200_u8 {
        // Fresh allocations each time: the allocator hands the same addresses out again and again.
        let rgb: Vec<u8> = image(SIZE).iter().map(|value| value.wrapping_mul(i | 1)).collect();
        let mut depth = vec![-1.0; rgb.len() / 3];
        let outputs = GraphOutputs { depth: &mut depth, labels: None, confidence: None };
        graph.run(GraphInput::Rgb(&rgb), outputs, &ticking()).unwrap();
        assert!(pixels(&rgb).map(models::connected_depth).eq(depth.iter().copied()));
    }
}

#[test]
fn memory_may_have_any_address() {
    let mut graph = wnet();
    let rgb = image(SIZE);
    let pixel_count = rgb.len() / 3;
    let mut bytes = vec![0; rgb.len() + 64];
    let mut floats = vec![0.0; pixel_count + 64];
    let mut classes = vec![0; pixel_count + 64];
    for offset in 0..64 {
        bytes[offset..offset + rgb.len()].copy_from_slice(&rgb);
        floats.fill(-1.0);
        classes.fill(99);
        let outputs = GraphOutputs {
            depth: &mut floats[offset..offset + pixel_count],
            labels: Some(&mut classes[offset..offset + pixel_count]),
            confidence: None,
        };
        graph.run(GraphInput::Rgb(&bytes[offset..offset + rgb.len()]), outputs, &ticking()).unwrap();
        assert!(
            pixels(&rgb)
                .map(models::connected_depth)
                .eq(floats[offset..offset + pixel_count].iter().copied())
        );
        let outside = |i: &usize| *i < offset || *i >= offset + pixel_count;
        assert!((0..floats.len()).filter(outside).all(|i| floats[i] == -1.0), "nothing beside it is touched");
        assert!((0..classes.len()).filter(outside).all(|i| classes[i] == 99), "nothing beside it is touched");
    }
}

#[test]
fn buffers_of_another_length_or_type_are_refused() {
    let mut graph = wnet();
    let rgb = image(SIZE);
    let mut run = |rgb: GraphInput<'_>, depth_len: usize, labels_len: usize| {
        let (mut depth, mut labels) = (vec![0.0; depth_len], vec![0; labels_len]);
        let outputs = GraphOutputs { depth: &mut depth, labels: Some(&mut labels), confidence: None };
        graph.run(rgb, outputs, &ticking()).map(drop)
    };
    let lengths = |result: Result<(), GraphError>| match result.unwrap_err() {
        GraphError::Buffer { tensor, got, expected } => (tensor, got, expected),
        other => panic!("{other}"),
    };
    assert_eq!(lengths(run(GraphInput::Rgb(&rgb[..51]), 18, 18)), ("image", 51, 54));
    assert_eq!(lengths(run(GraphInput::Rgb(&rgb), 17, 18)), ("depth", 17, 18));
    assert_eq!(lengths(run(GraphInput::Rgb(&rgb), 18, 19)), ("labels", 19, 18));
    let error = run(GraphInput::Float(&[0.0; 54]), 18, 18).unwrap_err();
    assert!(
        matches!(
            error,
            GraphError::ElementType {
                tensor: "image",
                got: ElementType::Float32,
                expected: ElementType::Uint8
            }
        ),
        "{error}"
    );
    assert!(run(GraphInput::Rgb(&rgb), 18, 18).is_ok(), "an error leaves the graph usable");
}

#[test]
fn labels_cannot_be_requested_from_a_graph_without_labels() {
    let mut graph = Folder::new().model("unet.onnx", &models::unet(SIZE)).load("unet.onnx").unwrap();
    let (mut depth, mut labels) = ([0.0; 18], [0; 18]);
    let outputs = GraphOutputs { depth: &mut depth, labels: Some(&mut labels), confidence: None };
    let error = graph.run(GraphInput::Rgb(&image(SIZE)), outputs, &ticking()).unwrap_err();
    assert!(matches!(error, GraphError::NoLabels), "{error}");
}

/// Depth of an operator that only renames memory must be written into the caller's memory too.
#[test]
fn a_last_operator_that_moves_nothing_still_writes_the_callers_memory() {
    let model = ModelBuilder::new()
        .input("rgb", OnnxElement::U8, &[1, 3, 6, 3])
        .constant_i64("start", &[1], &[0])
        .constant_i64("end", &[1], &[1])
        .constant_i64("axis", &[1], &[3])
        .constant_i64("shape", &[4], &[1, 1, 3, 6])
        .node("Slice", &["rgb", "start", "end", "axis"], &["red"], &[])
        .node("Cast", &["red"], &["float"], &[("to", 1.into())])
        .node("Reshape", &["float", "shape"], &["depth"], &[])
        .output("depth", OnnxElement::F32, &[1, 1, 3, 6]);
    let model = models::describe(model, "red", false);
    let mut graph = Folder::new().model("red.onnx", &model).load("red.onnx").unwrap();
    let rgb = image(SIZE);
    let red: Vec<f32> = pixels(&rgb).map(|[r, _, _]| f32::from(r)).collect();
    assert_eq!(crate::run(&mut graph, &rgb).depth, red);
}

#[test]
fn a_model_whose_output_has_another_rank_than_its_signature_is_refused_at_load() {
    let model = ModelBuilder::new()
        .input("rgb", OnnxElement::U8, &[1, 3, 6, 3])
        .node("Cast", &["rgb"], &["float"], &[("to", 1.into())])
        .node("NonZero", &["float"], &["where"], &[])
        .node("Cast", &["where"], &["depth"], &[("to", 1.into())])
        .output("depth", OnnxElement::F32, &[1, 1, 3, 6]);
    let folder = Folder::new().model("liar.onnx", &models::describe(model, "liar", false));
    let error = wiring_error(error_of(folder.load("liar.onnx")));
    let WiringError::Result { role: "depth", reference, expected, .. } = &error else { panic!("{error}") };
    assert_eq!((&**reference, &**expected), ("network.depth", "float32 [1, 1, 3, 6]"));
}

/// Depth is where the image is not 0: row, column and channel of each such value. Its width is 6 by the file,
/// but as many as there are.
fn places() -> ModelBuilder {
    let model = ModelBuilder::new()
        .input("rgb", OnnxElement::U8, &[1, 3, 6, 3])
        .constant_i64("shape", &[3], &[3, 6, 3])
        .constant_i64("axes", &[2], &[0, 1])
        .node("Cast", &["rgb"], &["float"], &[("to", 1.into())])
        .node("Reshape", &["float", "shape"], &["values"], &[])
        .node("NonZero", &["values"], &["where"], &[])
        .node("Unsqueeze", &["where", "axes"], &["places"], &[])
        .node("Cast", &["places"], &["depth"], &[("to", 1.into())])
        .output("depth", OnnxElement::F32, &[1, 1, 3, 6]);
    models::describe(model, "places", false)
}

/// What the file promises and what it computes may differ: that is an error of the run, not a write past the
/// end.
#[test]
fn an_output_of_another_size_than_its_signature_is_an_error_of_the_run() {
    let mut graph = Folder::new().model("places.onnx", &places()).load("places.onnx").unwrap();
    let mut memory = [-1.0; 18 + 64];
    for count in [0, 5, 7, 54] {
        let mut rgb = vec![0_u8; image(SIZE).len()];
        rgb[..count].fill(1);
        let outputs = GraphOutputs { depth: &mut memory[..18], labels: None, confidence: None };
        let error = graph.run(GraphInput::Rgb(&rgb), outputs, &ticking()).unwrap_err();
        assert!(matches!(&error, GraphError::Run { stage, .. } if stage == "network"), "{error}");
        assert_eq!(memory[18..], [-1.0; 64], "{count}: nothing behind it is touched");
    }
    let mut rgb = vec![0_u8; image(SIZE).len()];
    rgb[..6].fill(1);
    let fitting: [[f32; 6]; 3] = [[0.0; 6], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0], [0.0, 1.0, 2.0, 0.0, 1.0, 2.0]];
    assert_eq!(crate::run(&mut graph, &rgb).depth, fitting.concat());
}
