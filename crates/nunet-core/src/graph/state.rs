//! What stages remember from frame to frame, without a copy: two buffers for each tensor, which swap roles.
//!
//! A run reads the one that is kept and writes the other. They swap when **all** stages have succeeded: a run that
//! fails half-way may have written the other buffer, and the memory of the last good run is whole all the same.

use crate::graph::TensorSpec;
use crate::graph::onnx::OwnTensors;
use crate::graph::wiring::{Wired, is_due};

/// The memory of all stages. Its buffers are among the graph's own tensors; here is which of them are meant.
pub(super) struct State(Vec<Pair>);

/// One tensor of a stage's memory.
struct Pair {
    /// The tensor of the plan that the stage gives.
    tensor: usize,
    /// Its two buffers, as places among the graph's own tensors.
    buffers: [usize; 2],
    /// Which of them holds what the last good run left, 0 or 1.
    kept: usize,
    /// Its stage runs each n-th frame: between those the memory stays as it is.
    every: u32,
}

impl State {
    /// The memory of a plan's stages, in the order in which [`crate::graph::wiring::Source::State`] counts.
    pub(super) fn new(plan: &Wired) -> Self {
        let pairs = plan.states.iter().enumerate().map(|(index, state)| Pair {
            tensor: state.output,
            buffers: [state.output, plan.tensors.len() + index],
            kept: 0,
            every: state.every,
        });
        Self(pairs.collect())
    }

    /// Whether no stage remembers anything.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All tensors of which the graph needs memory of its own: those of the plan, then the second buffers.
    pub(super) fn with_buffers(plan: &Wired) -> Vec<TensorSpec> {
        let second = plan.states.iter().map(|state| plan.tensors[state.output].clone());
        plan.tensors.iter().cloned().chain(second).collect()
    }

    /// Where the memory `index` lies that a run reads.
    pub(super) fn kept(&self, index: usize) -> usize {
        let pair = &self.0[index];
        pair.buffers[pair.kept]
    }

    /// Where the plan's tensor `tensor` lies during run number `run`, for the stage that gives it and for later ones.
    pub(super) fn place_in_run(&self, tensor: usize, run: u64) -> usize {
        self.place(tensor, |pair| if is_due(pair.every, run) { 1 - pair.kept } else { pair.kept })
    }

    /// Where it lies between the runs.
    pub(super) fn place_after_run(&self, tensor: usize) -> usize {
        self.place(tensor, |pair| pair.kept)
    }

    fn place(&self, tensor: usize, buffer: impl Fn(&Pair) -> usize) -> usize {
        let pair = self.0.iter().find(|pair| pair.tensor == tensor);
        pair.map_or(tensor, |pair| pair.buffers[buffer(pair)])
    }

    /// Run number `run` has succeeded: what its stages left is the memory now.
    pub(super) fn keep(&mut self, run: u64) {
        for pair in self.0.iter_mut().filter(|pair| is_due(pair.every, run)) {
            pair.kept = 1 - pair.kept;
        }
    }

    /// Zeros, as before the first frame.
    pub(super) fn forget(&self, own: &mut OwnTensors) {
        for index in 0..self.0.len() {
            own.zero(self.kept(index));
        }
    }
}
