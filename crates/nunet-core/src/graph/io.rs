//! Inputs and outputs of a serial graph: options at load; image, buffers and report of each run.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use nunet_types::Quality;

use crate::graph::wiring::{Wired, WiredStage};
use crate::graph::{Provider, Signature, StageTimes, TensorSpec};
use crate::model::StateTensor;

/// Options for loading a graph.
#[derive(Debug, Clone, Default)]
pub struct GraphOptions {
    /// The execution provider.
    pub provider: Provider,
    /// Threads of one stage; `None` for as many as the process may use.
    pub threads: Option<NonZeroUsize>,
    /// `(stage, n)`: run that stage each n-th frame, overriding the manifest. A stage may be named once.
    pub every: Vec<(String, u32)>,
    /// SHA-256 of the files that may be loaded ([`model_hashes`](crate::graph::model_hashes)); empty for any.
    pub allowed_hashes: Vec<[u8; 32]>,
}

/// A stage of a loaded graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StageInfo {
    /// Its name.
    pub name: String,
    /// Its model file.
    pub model: PathBuf,
    /// Its inputs.
    pub inputs: Vec<TensorSpec>,
    /// Its outputs.
    pub outputs: Vec<TensorSpec>,
    /// It runs each n-th frame.
    pub every: u32,
    /// Its state tensors; empty for most.
    pub state: Vec<StateTensor>,
}

impl StageInfo {
    /// Inputs as the file has them, outputs as the plan fetches them, without the stage's name in front.
    pub(super) fn new(stage: &WiredStage, plan: &Wired, model: PathBuf, signature: &Signature) -> Self {
        let prefix = stage.name.len() + 1;
        let output = |spec: &TensorSpec| TensorSpec { name: spec.name[prefix..].to_owned(), ..spec.clone() };
        Self {
            name: stage.name.clone(),
            model,
            inputs: signature.inputs.clone(),
            outputs: plan.tensors[stage.outputs.clone()].iter().map(output).collect(),
            every: stage.every,
            state: stage.state.clone(),
        }
    }
}

/// The image that enters a graph, at the graph's size.
#[derive(Debug, Clone, Copy)]
pub enum GraphInput<'a> {
    /// `[1, H, W, 3]`, `u8`, RGB, rows top to bottom: for networks of the contract.
    Rgb(&'a [u8]),
    /// A foreign network's `f32` tensor, filled as its [`crate::preprocess::TensorFormat`] says.
    Float(&'a [f32]),
}

/// Memory of the caller into which a graph's results are written.
#[derive(Debug)]
pub struct GraphOutputs<'a> {
    /// `[H, W]`, `f32`, in the network's encoding.
    pub depth: &'a mut [f32],
    /// `[H, W]`, `u8`, class indices; `None` if they are not wanted.
    pub labels: Option<&'a mut [u8]>,
    /// `[H, W]`, `u8`, confidence of depth, 255 = certain; `None` keeps it in the graph's own memory
    /// ([`crate::graph::SerialGraph::confidence`]).
    pub confidence: Option<&'a mut [u8]>,
}

impl GraphOutputs<'_> {
    /// The same memory, borrowed for a shorter time.
    pub(crate) fn reborrow(&mut self) -> GraphOutputs<'_> {
        GraphOutputs {
            depth: &mut *self.depth,
            labels: self.labels.as_deref_mut(),
            confidence: self.confidence.as_deref_mut(),
        }
    }
}

/// The report of one run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GraphReport {
    /// The time of each stage, in the order of [`crate::graph::SerialGraph::stages`]; 0 for a skipped one.
    pub stages: StageTimes,
    /// Whether a stage was skipped.
    pub quality: Quality,
    /// Bytes of results that were copied or resized: labels of a stage that does not run for each frame, and
    /// depth of another size than the image.
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
