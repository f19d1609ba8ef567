//! The serial graph by itself: image in, depth and labels out, no preprocessing and no decoding.
//!
//! Uses the networks of `models/`, and skips those that are not there.
#![allow(missing_docs, reason = "criterion's macros make undocumented items")]

use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use nunet_core::graph::{GraphInput, GraphOptions, GraphOutputs, Runtime, SerialGraph};
use nunet_core::model::selftest;
use nunet_types::ImageSize;

/// Case and file: the smallest shows the cost of a run around the arithmetic, the two W-Nets that of a joint.
const CASES: [(&str, &str); 4] = [
    ("tiny_unet", "tiny/tiny_unet.onnx"),
    ("tiny_wnet_c_fused", "tiny/tiny_wnet_c.onnx"),
    ("tiny_wnet_c_staged", "tiny/tiny_wnet_c.toml"),
    ("wnet_c", "wnet_c.onnx"),
];

fn graph(criterion: &mut Criterion) {
    let runtime = Runtime::load(&nunet_testkit::runtime_library()).expect("a tested library");
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let mut group = criterion.benchmark_group("graph");
    group.sample_size(20).measurement_time(Duration::from_secs(8));
    for (case, file) in CASES {
        let path = models.join(file);
        if !path.exists() {
            continue;
        }
        let mut graph =
            SerialGraph::load(&path, &runtime, &GraphOptions::default()).expect("a shipped model");
        let ImageSize { width, height } = graph.size();
        let rgb = selftest::image(width, height);
        let mut depth = vec![0.0; rgb.len() / 3];
        let mut labels = graph.has_labels().then(|| vec![0; rgb.len() / 3]);
        group.bench_function(format!("{case}/{width}x{height}"), |bencher| {
            bencher.iter(|| {
                let outputs =
                    GraphOutputs { depth: &mut depth, labels: labels.as_deref_mut(), confidence: None };
                graph.run(GraphInput::Rgb(black_box(&rgb)), outputs, &|| 0).expect("a run")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, graph);
criterion_main!(benches);
