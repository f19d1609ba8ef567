//! The state of a stage: the tensors in `nunet.state` are in its file, with the same type and shape on both
//! sides, and have no other source.

use super::{Wired, WiredState, list, named};
use crate::graph::WiringError;
use crate::graph::manifest::ManifestStage;
use crate::graph::signature::{ElementType, Signature, TensorSpec, kind};
use crate::model::StateTensor;

/// Checks that a stage's file has its state tensors, and that the manifest does not bind them.
pub(super) fn check_state(
    stage: &ManifestStage,
    signature: &Signature,
    state: &[StateTensor],
) -> Result<(), WiringError> {
    for tensor in state {
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

/// Depth is written into memory of the caller, so the next frame cannot read it as state.
pub(super) fn check_depth_is_not_state(plan: &Wired) -> Result<(), WiringError> {
    let is_depth = |state: &WiredState| state.output == plan.depth;
    if plan.states.iter().any(is_depth) {
        let reference = plan.tensors[plan.depth].name.clone().into();
        return Err(WiringError::StateIsDepth { reference });
    }
    Ok(())
}
