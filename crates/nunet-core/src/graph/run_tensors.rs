//! Assigns memory to each tensor of a run: the caller's or the graph's own.

use crate::graph::GraphError;
use crate::graph::io::GraphInput;
use crate::graph::onnx::{CallerTensor, Lent, LentTensors, Session};
use crate::graph::state::GraphState;
use crate::graph::wiring::{InputSource, Wired, WiredStage};

/// The memory of each tensor of one run.
pub(super) struct RunTensors<'run> {
    pub(super) plan: &'run Wired,
    pub(super) image: Lent<'run>,
    /// `None` if depth is kept in the graph's own memory.
    pub(super) depth: Option<Lent<'run>>,
    pub(super) labels: Option<Lent<'run>>,
    pub(super) confidence: Option<Lent<'run>>,
    pub(super) own: LentTensors<'run>,
    pub(super) state: &'run GraphState,
    pub(super) run: u64,
}

impl RunTensors<'_> {
    /// Runs one stage.
    pub(super) fn run(&self, stage: &WiredStage, session: &mut Session) -> Result<(), GraphError> {
        let inputs = stage.inputs.iter().map(|&source| match source {
            InputSource::Image => self.image,
            InputSource::Tensor(index) => self.tensor(index),
            InputSource::State(index) => self.own.get(self.state.current(index)),
            InputSource::Extra(index) => self.own.get(GraphState::extra_index(self.plan, index)),
        });
        session
            .run(inputs, stage.outputs.clone().map(|index| self.tensor(index)))
            .map_err(|reason| GraphError::Run { stage: stage.name.clone(), reason: reason.into() })
    }

    fn tensor(&self, index: usize) -> Lent<'_> {
        let results = [
            (Some(self.plan.depth), self.depth),
            (self.plan.labels, self.labels),
            (self.plan.confidence, self.confidence),
        ];
        let lent = results.into_iter().find(|(result, _)| *result == Some(index)).and_then(|(_, lent)| lent);
        lent.unwrap_or_else(|| self.own.get(self.state.buffer_in_run(index, self.run)))
    }
}

/// Copies labels that were kept from an earlier run.
pub(super) fn copy_out(kept: &[u8], memory: &mut [u8]) -> Result<u64, GraphError> {
    if kept.len() != memory.len() {
        return Err(GraphError::Buffer { tensor: "labels", got: memory.len(), expected: kept.len() });
    }
    memory.copy_from_slice(kept);
    Ok(kept.len() as u64)
}

/// Lends the image to a run.
pub(super) fn lend_image<'run>(
    tensor: &'run mut CallerTensor,
    image: GraphInput<'run>,
) -> Result<Lent<'run>, GraphError> {
    match image {
        GraphInput::Rgb(bytes) => tensor.lend(bytes),
        GraphInput::Float(values) => tensor.lend(values),
    }
}

/// Lends memory for labels or confidence to a run, if the caller requested them; `missing` if the graph has
/// none.
pub(super) fn lend_map<'run>(
    tensor: Option<&'run mut CallerTensor>,
    memory: Option<&'run mut [u8]>,
    missing: GraphError,
) -> Result<Option<Lent<'run>>, GraphError> {
    match (memory, tensor) {
        (Some(memory), Some(tensor)) => tensor.lend_mut(memory).map(Some),
        (Some(_), None) => Err(missing),
        (None, _) => Ok(None),
    }
}
