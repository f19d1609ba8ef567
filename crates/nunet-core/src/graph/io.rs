//! What enters and leaves a serial graph: options at load, a picture and buffers for each run, a report back.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use nunet_types::Quality;

use crate::graph::wiring::{Wired, WiredStage};
use crate::graph::{Provider, Signature, StageTimes, TensorSpec};
use crate::model::StateTensor;

/// How a graph is to be loaded.
#[derive(Debug, Clone, Default)]
pub struct GraphOptions {
    /// Who does the arithmetic.
    pub provider: Provider,
    /// Threads of one stage's arithmetic; `None` for as many as the process may use.
    pub threads: Option<NonZeroUsize>,
    /// `(stage, n)`: run that stage each n-th frame, whatever the manifest says.
    pub every: Vec<(String, u32)>,
    /// SHA-256 of the files that may be loaded, see [`model_hashes`](crate::graph::model_hashes); empty where any may.
    pub only: Vec<[u8; 32]>,
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
    /// What it remembers from one of its runs to the next; empty for most.
    pub memory: Vec<StateTensor>,
}

impl StageInfo {
    /// Inputs as the file has them, outputs as the plan fetches them, without the stage's name before theirs.
    pub(super) fn new(stage: &WiredStage, plan: &Wired, model: PathBuf, signature: &Signature) -> Self {
        let prefix = stage.name.len() + 1;
        let output = |spec: &TensorSpec| TensorSpec { name: spec.name[prefix..].to_owned(), ..spec.clone() };
        Self {
            name: stage.name.clone(),
            model,
            inputs: signature.inputs.clone(),
            outputs: plan.tensors[stage.outputs.clone()].iter().map(output).collect(),
            every: stage.every,
            memory: stage.memory.clone(),
        }
    }
}

/// The picture that enters a graph, at the graph's size.
#[derive(Debug, Clone, Copy)]
pub enum GraphInput<'a> {
    /// `[1, H, W, 3]`, `u8`, RGB, rows top to bottom: what every network of the contract takes.
    Rgb(&'a [u8]),
    /// A foreign network's `f32` tensor, filled as its [`crate::preprocess::TensorFormat`] says.
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

/// What happened in one run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GraphReport {
    /// The time of each stage, in the order of [`crate::graph::SerialGraph::stages`]; 0 for a skipped one.
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
