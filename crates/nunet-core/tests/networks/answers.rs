//! Fused and staged, plain and connected, one to three components.

use nunet_core::graph::{
    GraphError, GraphInput, GraphOptions, GraphOutputs, Quality, SerialGraph, WiringError,
};
use nunet_core::hint_of;
use nunet_testkit::{manifests, models};

use crate::{Folder, SIZE, error_of, image, options, pixels, run, runtime, ticking, wiring_error};

const THREE_STAGES: &str = r#"
version = 1
[[stage]]
name = "segmentation"
model = "segmentation.onnx"
inputs = { rgb = "image" }
[[stage]]
name = "coarse"
model = "depth.onnx"
inputs = { features = "segmentation.logits" }
[[stage]]
name = "refine"
model = "refine.onnx"
inputs = { coarse = "coarse.depth" }
[outputs]
depth = "refine.depth"
labels = "segmentation.labels"
"#;

fn three_stages(is_connected: bool) -> String {
    let image = if is_connected { "{ rgb = \"image\", " } else { "{ " };
    let features = THREE_STAGES.replace("{ features", &format!("{image}features"));
    features.replace("{ coarse", &format!("{image}coarse"))
}

fn two_stages(is_connected: bool) -> Folder {
    let manifest = manifests::two_stages(is_connected, 1);
    Folder::new()
        .model("segmentation.onnx", &models::segmentation_stage(SIZE))
        .model("depth.onnx", &models::depth_stage(SIZE, is_connected))
        .text("graph.toml", &manifest)
}

fn expected(depth: impl Fn([u8; 3]) -> f32) -> (Vec<f32>, Vec<u8>) {
    let rgb = image(SIZE);
    (pixels(&rgb).map(depth).collect(), pixels(&rgb).map(models::label).collect())
}

#[test]
fn one_component_gives_depth_and_no_labels() {
    let folder = Folder::new().model("unet.onnx", &models::unet(SIZE));
    let mut graph = folder.load("unet.onnx").unwrap();
    assert_eq!((graph.size(), graph.has_labels(), graph.stages().len()), (SIZE, false, 1));
    assert_eq!(run(&mut graph, &image(SIZE)).depth, expected(models::plain_depth).0);
}

#[test]
fn one_component_runs_as_a_staged_graph_too() {
    let manifest = "version = 1\n[[stage]]\nname = \"depth\"\nmodel = \"unet.onnx\"\n\
                    inputs = { rgb = \"image\" }\n[outputs]\ndepth = \"depth.depth\"\n";
    let folder = Folder::new().model("unet.onnx", &models::unet(SIZE)).text("graph.toml", manifest);
    let mut graph = folder.load("graph.toml").unwrap();
    assert_eq!(run(&mut graph, &image(SIZE)).depth, expected(models::plain_depth).0);
}

#[test]
fn two_components_agree_fused_and_staged() {
    for (is_connected, depth) in
        [(false, models::plain_depth as fn([u8; 3]) -> f32), (true, models::connected_depth)]
    {
        let fused = Folder::new().model("wnet.onnx", &models::wnet(SIZE, is_connected));
        let mut graphs =
            [fused.load("wnet.onnx").unwrap(), two_stages(is_connected).load("graph.toml").unwrap()];
        assert_eq!(graphs.each_ref().map(|graph| graph.stages().len()), [1, 2]);
        for graph in &mut graphs {
            let answer = run(graph, &image(SIZE));
            assert_eq!((answer.depth, answer.labels), expected(depth));
            assert_eq!((answer.report.quality, answer.report.bytes_copied), (Quality::Full, 0));
        }
    }
}

#[test]
fn three_components_run_in_series_plain_and_connected() {
    for is_connected in [false, true] {
        let folder = two_stages(is_connected)
            .model("refine.onnx", &models::refine_stage(SIZE, is_connected))
            .text("graph.toml", &three_stages(is_connected));
        let mut graph = folder.load("graph.toml").unwrap();
        let answer = run(&mut graph, &image(SIZE));
        let expected = expected(|pixel| match is_connected {
            false => 2.0 * models::plain_depth(pixel),
            true => 2.0 * models::connected_depth(pixel) + f32::from(pixel[1]) / 32.0,
        });
        assert_eq!((answer.depth, answer.labels), expected);
        assert_eq!(answer.report.stages.micros(), [1000, 1000, 1000]);
    }
}

#[test]
fn inner_outputs_are_results_too() {
    let mut graph = two_stages(true).load("graph.toml").unwrap();
    assert!(graph.tensor("segmentation.logits").is_none(), "nothing has run yet");
    let rgb = image(SIZE);
    run(&mut graph, &rgb);
    let logits = graph.tensor("segmentation.logits").unwrap();
    assert_eq!(logits.spec.shape, [1, 3, 3, 6]);
    assert!(logits.bytes.as_ptr().cast::<[u8; 64]>().cast::<u64>().is_aligned());
    let values: Vec<f32> =
        logits.bytes.as_chunks().0.iter().map(|&bytes| f32::from_ne_bytes(bytes)).collect();
    let planes: Vec<f32> = (0..3).flat_map(|c| pixels(&rgb).map(move |pixel| f32::from(pixel[c]))).collect();
    assert_eq!(values, planes);
    assert!(graph.tensor("depth.depth").is_none(), "the caller has it");
    assert!(graph.tensor("depth.nothing").is_none());
}

#[test]
fn labels_that_were_not_requested_are_not_written() {
    let folder = Folder::new().model("wnet.onnx", &models::wnet(SIZE, true));
    let mut graph = folder.load("wnet.onnx").unwrap();
    let rgb = image(SIZE);
    let mut depth = vec![0.0; rgb.len() / 3];
    let outputs = GraphOutputs { depth: &mut depth, labels: None, confidence: None };
    graph.run(GraphInput::Rgb(&rgb), outputs, &ticking()).unwrap();
    let (depth_expected, labels_expected) = expected(models::connected_depth);
    assert_eq!(graph.labels(), Some(&labels_expected[..]));
    assert_eq!(depth, depth_expected);
    run(&mut graph, &rgb);
    assert_eq!(graph.labels(), None, "they went into the caller's memory");
}

#[test]
fn a_skipped_stage_is_reused_stamped_and_its_copy_counted() {
    let folder = two_stages(true).text("graph.toml", &manifests::two_stages(true, 2));
    let mut graph = folder.load("graph.toml").unwrap();
    let first = image(SIZE);
    let second: Vec<u8> = first.iter().map(|value| 255 - value).collect();
    let labels_of = |rgb: &[u8]| pixels(rgb).map(models::label).collect::<Vec<_>>();
    let pixel_count = first.len() as u64 / 3;
    assert!(!graph.is_stateless(), "whether the stage is skipped depends on the runs before");

    let answer = run(&mut graph, &first);
    assert_eq!((answer.labels, answer.report.quality), (labels_of(&first), Quality::Full));

    let answer = run(&mut graph, &second);
    assert_eq!((&answer.labels, answer.report.quality), (&labels_of(&first), Quality::ReusedLabels));
    assert_eq!(answer.report.bytes_copied, pixel_count);
    // Features of the first image, the image itself of the second.
    let mixed: Vec<f32> = pixels(&first)
        .zip(pixels(&second))
        .map(|(old, new)| models::plain_depth(old) + f32::from(new[0]) / 32.0)
        .collect();
    assert_eq!(answer.depth, mixed);

    let answer = run(&mut graph, &second);
    assert_eq!((answer.labels, answer.report.quality), (labels_of(&second), Quality::Full));

    run(&mut graph, &first);
    graph.reset();
    assert_eq!(run(&mut graph, &first).report.quality, Quality::Full, "a reset makes every stage due");
}

#[test]
fn every_can_be_set_from_outside_for_stages_that_exist() {
    let folder = two_stages(true);
    let load = |every: &[(String, u32)]| {
        let options = GraphOptions { every: every.to_vec(), ..options() };
        SerialGraph::load(&folder.path("graph.toml"), &runtime(), &options)
    };
    let graph = load(&[("segmentation".to_owned(), 3)]).unwrap();
    assert_eq!(graph.stages().iter().map(|stage| stage.every).collect::<Vec<_>>(), [3, 1]);
    let error = error_of(load(&[("segmantation".to_owned(), 3)]));
    let is_unknown = matches!(
        &error,
        GraphError::UnknownStage { stage, stages }
            if stage == "segmantation" && stages == "`segmentation`, `depth`"
    );
    assert!(is_unknown && hint_of(&error).is_some(), "{error}");
    let twice = [("segmentation".to_owned(), 3), ("segmentation".to_owned(), 2)];
    let error = error_of(load(&twice));
    let is_twice = matches!(
        &error,
        GraphError::EveryTwice { stage, first: 3, second: 2 } if stage == "segmentation"
    );
    assert!(is_twice && hint_of(&error).is_some(), "{error}");
    let skipped = WiringError::DepthSkipped { role: "depth", stage: "depth".into(), every: 2 };
    assert_eq!(wiring_error(error_of(load(&[("depth".to_owned(), 2)]))), skipped);
}

#[test]
fn stages_of_mixed_sizes_are_refused_with_both_sides() {
    let folder = two_stages(false).model("depth.onnx", &models::depth_stage((12, 6), false));
    let mismatch = WiringError::Mismatch {
        stage: "depth".into(),
        input: "features".into(),
        expected: "float32 [1, 3, 6, 12]".into(),
        from: "segmentation".into(),
        tensor: "logits".into(),
        given: "float32 [1, 3, 3, 6]".into(),
    };
    assert!(hint_of(&mismatch).is_some());
    assert_eq!(wiring_error(error_of(folder.load("graph.toml"))), mismatch);
    let folder = two_stages(true).model("depth.onnx", &models::depth_stage((12, 6), true));
    let differ = WiringError::ImagesDiffer {
        first: "segmentation".into(),
        first_kind: "uint8 [1, 3, 6, 3]".into(),
        stage: "depth".into(),
        kind: "uint8 [1, 6, 12, 3]".into(),
    };
    assert_eq!(wiring_error(error_of(folder.load("graph.toml"))), differ);
}

#[test]
fn the_hash_of_a_staged_graph_covers_manifest_and_files() {
    let hash = |folder: &Folder| folder.load("graph.toml").unwrap().description().hash;
    let first = hash(&two_stages(true));
    assert_eq!(first, hash(&two_stages(true)));
    let other_file = two_stages(true)
        .model("segmentation.onnx", &models::segmentation_stage(SIZE).metadata("note", "retrained"));
    assert_ne!(first, hash(&other_file));
    let commented = manifests::two_stages(true, 1) + "\n# comment";
    let other_text = two_stages(true).text("graph.toml", &commented);
    assert_ne!(first, hash(&other_text));
}
