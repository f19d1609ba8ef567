//! Truncated and damaged descriptions of cameras and networks: a short error, never a panic.

#[expect(unreachable_pub, reason = "the fuzz targets are another crate")]
#[path = "../../../fuzz/src/description.rs"]
mod body;

use nunet_testkit::hostile::{feed_damaged, greedy_texts, keep_for_fuzzing};
use nunet_testkit::manifests::two_stages;
use proptest::prelude::*;

const CALIBRATION: &str = "image_width: 640
image_height: 480
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [518.5, 0, 325.25, 0, 519, 253.5, 0, 0, 1]
distortion_model: rational_polynomial
distortion_coefficients: {rows: 1, cols: 8, data: [-0.31, 0.11, 7.0e-4, -.0004, 0, .1, .2, .3]}
rectification_matrix: &r {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: *r
";

const FISHEYE: &str = "image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [300, 0, 320, 0, 300, 240, 0, 0, 1]}
distortion_model: equidistant
distortion_coefficients: {rows: 1, cols: 4, data: [0.01, -0.002, 0.0003, 0]}
";

/// With a file in a folder.
fn manifest() -> String {
    two_stages(true, 2).replace("\"segmentation.onnx\"", "\"parts/segmentation.onnx\"")
}

const SIDECAR: &str = r#"[input]
tensor = "pixel_values"
layout = "nchw"
dtype = "float32"
color = "bgr"
size = [392, 518]
scale = 0.0039
mean = [0.485, 0.456, 0.406]
std = [0.229, 0.224, 0.225]
[output]
depth = "predicted_depth"
encoding = "metric"
min_m = 0.1
max_m = 20.0
"#;

fn metadata() -> String {
    let row = |cell: &str| format!("[{}]", [cell; 8].join(", "));
    let grid = |cell: &str| format!("[{}]", [row(cell).as_str(); 6].join(", "));
    format!(
        r#"version=1
architecture=wnet_c_lstm
components=[{{"name": "depth", "task": "depth", "backbone": "resnet34", "connected": true, "parameters": 24436369, "gflop": 73.3}}]
depth.encoding=metric
depth.min_m=0.3
depth.max_m=10
classes=["wall", "floor", "table", "chair"]
camera={{"width": 640, "height": 480, "fx": 518.9, "fy": 519.5}}
inner_size=[240, 320]
trained=true
training={{"epochs": 20}}
accuracy={{"rmse": 0.6}}
license=MIT
targets=cpu, openvino
state=[{{"input": "hidden_in", "output": "hidden_out", "shape": [1, 4, 3, 4]}}]
selftest={{"version": 1, "picture": "nunet-selftest-1", "precision": "fp32", "depth": {}, "labels": {}, "tolerance": {{"fp32": {{"depth": 0.002, "label_cells": 1}}}}}}
"#,
        grid("1.5"),
        grid("3")
    )
}

/// The target's name, its function, and good texts to damage.
type Target = (&'static str, fn(&[u8]), Vec<String>);

fn all() -> [Target; 4] {
    [
        ("calibration", body::calibration, vec![CALIBRATION.to_owned(), FISHEYE.to_owned()]),
        ("manifest", body::manifest, vec![manifest()]),
        ("sidecar", body::sidecar, vec![SIDECAR.to_owned()]),
        ("metadata", body::metadata, vec![metadata()]),
    ]
}

/// Damaged copies of a text that is invalid to begin with would test nothing.
#[test]
fn every_text_is_valid_before_it_is_damaged() {
    assert!(nunet_core::camera::Calibration::parse(CALIBRATION).is_ok());
    assert!(nunet_core::camera::Calibration::parse(FISHEYE).is_ok());
    assert!(nunet_core::graph::Manifest::parse(&manifest()).is_ok());
    assert!(nunet_core::model::Sidecar::parse(SIDECAR).is_ok());
    let entries = metadata();
    let entries = entries.lines().filter_map(|line| line.split_once('='));
    let entries = entries.map(|(key, value)| (format!("nunet.{key}"), value.to_owned())).collect();
    let description = nunet_core::model::ModelDescription::from_metadata(&entries, [0; 32]);
    assert!(description.is_ok_and(|description| description.selftest.is_some()));
    assert!(nunet_core::model::StateTensor::list(&entries).is_ok_and(|tensors| tensors.len() == 1));
    for (target, _, texts) in all() {
        for (number, text) in texts.iter().enumerate() {
            keep_for_fuzzing(target, &number.to_string(), text.as_bytes());
        }
    }
}

#[test]
fn damaged_texts_never_panic() {
    for (target, take, texts) in all() {
        for text in texts {
            feed_damaged(target, text.as_bytes(), take);
        }
    }
}

/// A test's thread has 2 MB of stack, less than any thread of the daemon.
#[test]
fn deeply_nested_texts_do_not_overflow_a_small_stack() {
    for (_, take, _) in all() {
        for text in greedy_texts() {
            take(text.as_bytes());
        }
        for text in greedy_texts() {
            for key in ["components", "classes", "camera", "training", "selftest", "state", "trained"] {
                let text = text.replace('\n', " ");
                take(format!("version=1\narchitecture=a\ndepth.encoding=relative\n{key}={text}").as_bytes());
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn arbitrary_text_and_bytes_never_panic(text in any::<String>(), bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        for (_, take, _) in all() {
            take(text.as_bytes());
            take(&bytes);
        }
    }
}
