//! The files of `models/tiny`, made by the recipe: what one side of the contract writes, the other must read.

use std::path::{Path, PathBuf};

use nunet_core::graph::SerialGraph;
use nunet_core::model::selftest;
use nunet_core::pipeline::{Pipeline, PipelineOptions};

use crate::{load, refusal, run, ticking};

fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/tiny")
}

/// The one with a memory, which waits for a program that carries it from frame to frame.
const RECURRENT: &str = "tiny_wnet_c_lstm";

/// All fused and staged graphs of the folder. The files of stages alone have a dot in their stem.
fn graphs() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(tiny()).unwrap();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| {
        let stem = path.file_stem().unwrap().to_string_lossy();
        let extension = path.extension().unwrap_or_default();
        stem != RECURRENT && !stem.contains('.') && (extension == "onnx" || extension == "toml")
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
    }
}

#[test]
fn a_recurrent_model_is_refused_for_its_memory() {
    let message = refusal(load(&tiny().join(format!("{RECURRENT}.onnx"))));
    assert!(message.contains("`nunet.state`: the network's memory goes from frame to frame"), "{message}");
}

#[test]
fn fused_and_staged_w_net_connected_give_equal_depth_and_labels() {
    let load = |name: &str| load(&tiny().join(name)).unwrap();
    let (mut fused, mut staged) = (load("tiny_wnet_c.onnx"), load("tiny_wnet_c.toml"));
    let parts =
        |graph: &SerialGraph| (graph.size(), graph.has_labels(), graph.description().architecture.clone());
    assert_eq!(parts(&fused), parts(&staged));
    let rgb = selftest::picture(fused.size().0, fused.size().1);
    let (one, two) = (run(&mut fused, &rgb), run(&mut staged, &rgb));
    let largest = one.depth.iter().fold(0.0_f32, |most, z| most.max(z.abs()));
    for (one, two) in one.depth.iter().zip(&two.depth) {
        // Operators fuse differently across a file's border, so sums round differently.
        assert!((one - two).abs() <= 1e-5 * largest, "{one} and {two}");
    }
    assert_eq!(one.labels, two.labels);
}
