//! Small networks of every kind, run by ONNX Runtime and compared with answers computed by hand.
#![expect(clippy::unwrap_used, reason = "helpers of tests are tests")]

mod answers;
mod bad_models;
mod buffers;
mod confidence;
mod filters;
mod foreign;
mod foreign_cases;
mod framing;
mod pipeline;
mod recurrent;
mod runtime;
mod shared_sessions;
mod shipped;

use std::path::{Path, PathBuf};

use nunet_core::graph::{
    GraphError, GraphInput, GraphOptions, GraphOutputs, GraphReport, Runtime, SerialGraph, WiringError,
};
use nunet_testkit::onnx::ModelBuilder;
use nunet_types::ImageSize;
use tempfile::TempDir;

/// An odd, wide size: swapped sides, or a transposed image, cannot pass.
const SIZE: ImageSize = ImageSize::new(6, 3);

fn runtime() -> Runtime {
    Runtime::load(&nunet_testkit::runtime_library()).unwrap()
}

/// One thread per session, because the tests run in parallel.
fn options() -> GraphOptions {
    GraphOptions { threads: std::num::NonZeroUsize::new(1), ..GraphOptions::default() }
}

fn load(path: &Path) -> Result<SerialGraph, GraphError> {
    SerialGraph::load(path, &runtime(), &options())
}

/// A folder with files in it.
struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn model(self, name: &str, model: &ModelBuilder) -> Self {
        model.write(self.path(name));
        self
    }

    fn text(self, name: &str, text: &str) -> Self {
        std::fs::write(self.path(name), text).unwrap();
        self
    }

    fn load(&self, name: &str) -> Result<SerialGraph, GraphError> {
        load(&self.path(name))
    }
}

/// An image without symmetry: every pixel and every channel differs from its neighbors.
fn image(ImageSize { width, height }: ImageSize) -> Vec<u8> {
    let pixels = u32::from(u8::MAX) - 5;
    (0..width * height)
        .flat_map(|i| [(i * 37 + 11) % pixels, (i * 59 + 83) % pixels, (i * 23 + 149) % pixels])
        .map(|v| v as u8)
        .collect()
}

fn pixels(rgb: &[u8]) -> impl Iterator<Item = [u8; 3]> {
    rgb.as_chunks().0.iter().copied()
}

/// A graph's results for one image.
struct Answer {
    depth: Vec<f32>,
    labels: Vec<u8>,
    report: GraphReport,
}

/// Runs a graph, with labels if it has any. Each reading of the clock is a millisecond later than the one
/// before.
fn run(graph: &mut SerialGraph, rgb: &[u8]) -> Answer {
    let clock = ticking();
    let pixels = rgb.len() / 3;
    // Values that no network here returns, so that memory that was not written shows.
    let (mut depth, mut labels) = (vec![-1.0; pixels], vec![99; pixels]);
    let wanted = graph.has_labels().then_some(&mut labels[..]);
    let outputs = GraphOutputs { depth: &mut depth, labels: wanted, confidence: None };
    let report = graph.run(GraphInput::Rgb(rgb), outputs, &clock).unwrap();
    Answer { depth, labels, report }
}

fn ticking() -> impl Fn() -> u64 {
    let now = std::cell::Cell::new(0);
    move || {
        now.set(now.get() + 1_000_000);
        now.get()
    }
}

/// The error's whole chain with its hints, as a front end prints it.
fn chain(error: &(dyn std::error::Error + 'static)) -> String {
    let (mut text, mut hints) = (String::new(), String::new());
    let mut cause = Some(error);
    while let Some(error) = cause {
        let separator = if text.is_empty() { "" } else { ": " };
        text += &format!("{separator}{error}");
        hints.extend(nunet_core::hint_of(error).map(|hint| format!("\nhint: {hint}")));
        cause = error.source();
    }
    text + &hints
}

/// The error of a load that must fail.
fn error_of(result: Result<SerialGraph, GraphError>) -> GraphError {
    match result {
        Ok(_) => panic!("the graph was loaded"),
        Err(error) => error,
    }
}

/// Its chain.
fn refusal(result: Result<SerialGraph, GraphError>) -> String {
    chain(&error_of(result))
}

/// Why the stages do not fit together.
fn wiring_error(error: GraphError) -> WiringError {
    match error {
        GraphError::Wiring { source, .. } => *source,
        other => panic!("{}", chain(&other)),
    }
}
