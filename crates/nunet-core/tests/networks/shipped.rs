//! The files of `models/tiny`, made by the recipe: what one side of the contract writes, the other must read.

use std::path::{Path, PathBuf};

use nunet_core::graph::SerialGraph;
use nunet_core::model::selftest;
use nunet_core::pipeline::{Pipeline, PipelineOptions};

use crate::{load, run, ticking};

fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/tiny")
}

/// All fused and staged graphs of the folder. The files of stages alone have a dot in their stem.
fn graphs() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(tiny()).unwrap();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| {
        let stem = path.file_stem().unwrap().to_string_lossy();
        let extension = path.extension().unwrap_or_default();
        !stem.contains('.') && (extension == "onnx" || extension == "toml")
    });
    paths.sort();
    paths
}

#[test]
fn every_tiny_model_passes_its_own_self_test() {
    let graphs = graphs();
    assert!(graphs.len() > 3, "{graphs:?}");
    for path in graphs {
        let graph =
            load(&path).unwrap_or_else(|error| panic!("{}: {}", path.display(), crate::chain(&error)));
        let mut pipeline = Pipeline::new(graph, PipelineOptions::default()).unwrap();
        let report = pipeline
            .selftest(&ticking())
            .unwrap_or_else(|error| panic!("{}: {}", path.display(), crate::chain(&error)));
        assert!(report.checked, "{}", path.display());
        let again = pipeline.selftest(&ticking()).unwrap();
        assert_eq!(again, report, "{}: a self-test begins without a memory", path.display());
    }
}

/// Against ONNX Runtime's own Python package a whole sequence is compared in `tests/python`.
#[test]
fn the_recurrent_model_answers_differently_in_the_second_frame_until_a_reset() {
    let mut graph = load(&tiny().join("tiny_wnet_c_lstm.onnx")).unwrap();
    let rgb = selftest::image(graph.size().width, graph.size().height);
    let [first, second, third] = [(); 3].map(|()| run(&mut graph, &rgb).depth);
    assert_ne!(first, second);
    assert_ne!(second, third);
    graph.reset();
    assert_eq!(run(&mut graph, &rgb).depth, first);
    assert_eq!(run(&mut graph, &rgb).depth, second);
}

#[test]
fn labels_are_optional_in_a_staged_graph() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["tiny_wnet_c.segmentation.onnx", "tiny_wnet_c.depth.onnx"] {
        std::fs::copy(tiny().join(name), folder.path().join(name)).unwrap();
    }
    let manifest = std::fs::read_to_string(tiny().join("tiny_wnet_c.toml")).unwrap();
    let without: Vec<_> = manifest.lines().filter(|line| !line.starts_with("labels =")).collect();
    std::fs::write(folder.path().join("depth.toml"), without.join("\n")).unwrap();
    let graph = load(&folder.path().join("depth.toml")).unwrap();
    assert!(!graph.has_labels());
    let mut pipeline = Pipeline::new(graph, PipelineOptions::default()).unwrap();
    assert!(pipeline.selftest(&|| 0).unwrap().checked, "its depth is tested");
}

#[test]
fn fused_and_staged_w_net_connected_give_equal_depth_and_labels() {
    let load = |name: &str| load(&tiny().join(name)).unwrap();
    let (mut fused, mut staged) = (load("tiny_wnet_c.onnx"), load("tiny_wnet_c.toml"));
    let parts =
        |graph: &SerialGraph| (graph.size(), graph.has_labels(), graph.description().architecture.clone());
    assert_eq!(parts(&fused), parts(&staged));
    let rgb = selftest::image(fused.size().width, fused.size().height);
    let (one, two) = (run(&mut fused, &rgb), run(&mut staged, &rgb));
    let largest = one.depth.iter().fold(0.0_f32, |most, z| most.max(z.abs()));
    for (one, two) in one.depth.iter().zip(&two.depth) {
        // Operators fuse differently across a file's border, so sums round differently.
        assert!((one - two).abs() <= 1e-5 * largest, "{one} and {two}");
    }
    assert_eq!(one.labels, two.labels);
}
