//! The run: each stage in turn, each reading what the earlier ones left.

use std::path::{Path, PathBuf};

use crate::clock::Clock;
use crate::graph::{GraphError, Provider, Runtime, StageTimes, TensorSpec};
use crate::model::ModelDescription;
use crate::preprocess::TensorFormat;

/// How a graph is to be loaded.
#[derive(Debug, Clone, Default)]
pub struct GraphOptions {
    /// Who does the arithmetic.
    pub provider: Provider,
    /// Threads of one stage's arithmetic; `None` for as many as the process may use.
    pub threads: Option<std::num::NonZeroUsize>,
    /// `(stage, n)`: run that stage each n-th frame, whatever the manifest says.
    pub every: Vec<(String, u32)>,
}

/// What a stage is, as `inspect` shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StageInfo {
    /// Its name.
    pub name: String,
    /// Its model file.
    pub model: PathBuf,
    /// What it takes.
    pub inputs: Vec<TensorSpec>,
    /// What it gives.
    pub outputs: Vec<TensorSpec>,
    /// It runs each n-th frame.
    pub every: u32,
}

/// The picture that enters a graph, at the graph's size.
#[derive(Debug, Clone, Copy)]
pub enum GraphInput<'a> {
    /// `[1, H, W, 3]`, `u8`, RGB, rows top to bottom: what every network of the contract takes.
    Rgb(&'a [u8]),
    /// A foreign network's `f32` tensor, filled as its [`TensorFormat`] says.
    Float(&'a [f32]),
}

/// Where a graph's results go: memory of the caller, into which ONNX Runtime writes.
#[derive(Debug)]
pub struct GraphOutputs<'a> {
    /// `[H, W]`, `f32`, in the network's encoding.
    pub depth: &'a mut [f32],
    /// `[H, W]`, `u8`, class indices; `None` where nobody wants them.
    pub labels: Option<&'a mut [u8]>,
}

/// How much of a frame's result was computed from this frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Quality {
    /// All of it.
    #[default]
    Full,
    /// A stage was skipped (`every`), and its earlier result used again.
    ReusedLabels,
    /// Something simpler stood in for the network.
    Fallback,
}

/// What happened in one run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GraphReport {
    /// The time of each stage, in the order of [`SerialGraph::stages`]; 0 for a skipped one.
    pub stages: StageTimes,
    /// Whether a stage was skipped.
    pub quality: Quality,
    /// Bytes of results that had to be copied, because their stage runs less often than each frame.
    pub bytes_copied: u64,
}

/// A tensor of the last run.
#[derive(Debug, Clone, Copy)]
pub struct TensorView<'a> {
    /// Name, type and shape.
    pub spec: &'a TensorSpec,
    /// Its bytes, in this machine's byte order, aligned to 64.
    pub bytes: &'a [u8],
}

/// N components in series, proved to fit, ready to run.
pub struct SerialGraph {
    description: ModelDescription,
    stages: Vec<StageInfo>,
    size: (u32, u32),
}

impl SerialGraph {
    /// Loads a fused `.onnx` file, or a staged graph's `.toml` with the files that it names.
    ///
    /// # Errors
    /// Files that cannot be read or that ONNX Runtime does not take, stages that do not fit, and a description that
    /// is missing or wrong.
    pub fn load(path: &Path, runtime: &Runtime, options: &GraphOptions) -> Result<Self, GraphError> {
        todo!("{} {} {options:?}", path.display(), runtime.version())
    }

    /// What the model file says of itself.
    #[must_use]
    pub fn description(&self) -> &ModelDescription {
        &self.description
    }

    /// The stages in the order in which they run.
    #[must_use]
    pub fn stages(&self) -> &[StageInfo] {
        &self.stages
    }

    /// Width and height of the picture, the depth map and the labels, in pixels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Whether the graph gives labels.
    #[must_use]
    pub fn has_labels(&self) -> bool {
        todo!()
    }

    /// The provider that does the arithmetic; never [`Provider::Auto`].
    #[must_use]
    pub fn provider(&self) -> Provider {
        todo!()
    }

    /// How a foreign network wants its picture; `None` where it takes camera bytes ([`GraphInput::Rgb`]).
    #[must_use]
    pub fn float_input(&self) -> Option<&TensorFormat> {
        todo!()
    }

    /// Runs all stages that are due on one picture; their results are in `outputs` when it returns.
    ///
    /// The picture is read where it lies and the results are written where they shall be: nothing is copied, and
    /// nothing allocated on the Rust side once each buffer's address has been seen.
    ///
    /// # Errors
    /// Buffers of another length or type than the graph's, and what ONNX Runtime reports.
    pub fn run(
        &mut self,
        image: GraphInput<'_>,
        outputs: GraphOutputs<'_>,
        clock: &dyn Clock,
    ) -> Result<GraphReport, GraphError> {
        todo!("{image:?} {outputs:?} {}", clock.nanos())
    }

    /// Forgets earlier frames: the next run runs every stage.
    pub fn reset(&mut self) {
        todo!()
    }

    /// A tensor of the last run by `stage.tensor`, inner ones too.
    ///
    /// `None` for a name that no stage gives, before the first run, and for a result that went into the caller's
    /// memory.
    #[must_use]
    pub fn tensor(&self, name: &str) -> Option<TensorView<'_>> {
        todo!("{name}")
    }
}
