//! The memory of a stage: what its `nunet.state` lists is in the file, alike on both sides, and nobody else's.

use super::{Wired, WiredState, list, named};
use crate::graph::WiringError;
use crate::graph::manifest::ManifestStage;
use crate::graph::signature::{ElementType, Signature, TensorSpec, kind};
use crate::model::StateTensor;

/// Proves that a stage's file has the tensors of its memory, and that the manifest leaves them alone.
pub(super) fn check_memory(
    stage: &ManifestStage,
    signature: &Signature,
    memory: &[StateTensor],
) -> Result<(), WiringError> {
    for tensor in memory {
        check_side(stage, ("input", &signature.inputs), &tensor.input, &tensor.shape)?;
        check_side(stage, ("output", &signature.outputs), &tensor.output, &tensor.shape)?;
        if let Some(source) = stage.inputs.get(&tensor.input) {
            return Err(WiringError::StateBound {
                stage: stage.name.clone().into(),
                tensor: tensor.input.clone().into(),
                source_name: source.clone().into(),
            });
        }
    }
    Ok(())
}

fn check_side(
    stage: &ManifestStage,
    (side, specs): (&'static str, &[TensorSpec]),
    name: &str,
    shape: &[i64],
) -> Result<(), WiringError> {
    let Some(spec) = named(specs, name) else {
        return Err(WiringError::StateMissing {
            stage: stage.name.clone().into(),
            side,
            tensor: name.into(),
            there: list(specs).into(),
        });
    };
    if spec.element == ElementType::Float32 && spec.shape == shape {
        return Ok(());
    }
    Err(WiringError::StateKind {
        stage: stage.name.clone().into(),
        side,
        tensor: name.into(),
        expected: kind(ElementType::Float32, shape).into(),
        given: spec.kind().into(),
    })
}

/// Depth goes into memory of the caller, who takes it away with the frame: it cannot be what the next frame reads.
pub(super) fn check_depth_leaves(plan: &Wired) -> Result<(), WiringError> {
    let kept = |state: &WiredState| state.output == plan.depth;
    if plan.states.iter().any(kept) {
        let reference = plan.tensors[plan.depth].name.clone().into();
        return Err(WiringError::StateIsDepth { reference });
    }
    Ok(())
}
