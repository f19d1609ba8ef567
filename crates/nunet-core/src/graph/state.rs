//! The state of recurrent stages, without a copy: two buffers for each tensor, which swap roles.
//!
//! A run reads the current buffer and writes the other. They swap when **all** stages have succeeded: a run
//! that fails half-way may have written the other buffer, but the state of the last good run is intact.

use crate::graph::TensorSpec;
use crate::graph::onnx::OwnTensors;
use crate::graph::wiring::{Wired, is_due};

/// The state of all stages: which of the graph's own tensors are its buffers.
pub(super) struct GraphState(Vec<Pair>);

/// One state tensor.
struct Pair {
    /// The index of its output in the plan's tensors.
    tensor: usize,
    /// Its two buffers, as indices of the graph's own tensors.
    buffers: [usize; 2],
    /// Which of them holds the state after the last good run, 0 or 1.
    current: usize,
    /// Its stage runs each n-th frame; in between the state does not change.
    every: u32,
}

impl GraphState {
    /// The state of a plan's stages, in the order in which [`crate::graph::wiring::InputSource::State`]
    /// counts.
    pub(super) fn new(plan: &Wired) -> Self {
        let pairs = plan.states.iter().enumerate().map(|(index, state)| Pair {
            tensor: state.output,
            buffers: [state.output, plan.tensors.len() + index],
            current: 0,
            every: state.every,
        });
        Self(pairs.collect())
    }

    /// Whether no stage has state.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All tensors for which the graph allocates memory: those of the plan, the second buffers, then the
    /// extra inputs.
    pub(super) fn with_buffers(plan: &Wired) -> Vec<TensorSpec> {
        let second = plan.states.iter().map(|state| plan.tensors[state.output].clone());
        let extras = plan.extras.iter().map(|extra| extra.spec.clone());
        plan.tensors.iter().cloned().chain(second).chain(extras).collect()
    }

    /// The index of an extra input among them.
    pub(super) fn extra_index(plan: &Wired, extra: usize) -> usize {
        plan.tensors.len() + plan.states.len() + extra
    }

    /// The buffer of state `index` that a run reads.
    pub(super) fn current(&self, index: usize) -> usize {
        let pair = &self.0[index];
        pair.buffers[pair.current]
    }

    /// The buffer of the plan's tensor `tensor` during run number `run`, for the stage that writes it and for
    /// later ones.
    pub(super) fn buffer_in_run(&self, tensor: usize, run: u64) -> usize {
        self.buffer(tensor, |pair| if is_due(pair.every, run) { 1 - pair.current } else { pair.current })
    }

    /// Its buffer between the runs.
    pub(super) fn buffer_after_run(&self, tensor: usize) -> usize {
        self.buffer(tensor, |pair| pair.current)
    }

    fn buffer(&self, tensor: usize, which: impl Fn(&Pair) -> usize) -> usize {
        let pair = self.0.iter().find(|pair| pair.tensor == tensor);
        pair.map_or(tensor, |pair| pair.buffers[which(pair)])
    }

    /// Makes what run number `run` has written the current state.
    pub(super) fn commit(&mut self, run: u64) {
        for pair in self.0.iter_mut().filter(|pair| is_due(pair.every, run)) {
            pair.current = 1 - pair.current;
        }
    }

    /// Sets the state to zeros, as before the first frame.
    pub(super) fn clear(&self, own: &mut OwnTensors) {
        for index in 0..self.0.len() {
            own.zero(self.current(index));
        }
    }
}
