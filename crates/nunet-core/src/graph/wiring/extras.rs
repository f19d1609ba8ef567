//! Inputs that a sidecar feeds: each is in the file, and its value fits the tensor.

use super::{Unwired, WiredExtra, list, named};
use crate::camera::Intrinsics;
use crate::graph::WiringError;
use crate::graph::element_bytes::element_bytes;
use crate::graph::signature::TensorSpec;
use crate::model::ExtraInput;

impl Unwired<'_> {
    /// The inputs that the sidecar feeds to the only stage of a foreign network.
    pub(super) fn extras(&self) -> Result<Vec<WiredExtra>, WiringError> {
        let Some((stage, signature)) = self.manifest.stages.first().zip(self.signatures.first()) else {
            return Ok(Vec::new());
        };
        let wired = |(name, value): (&String, &ExtraInput)| {
            let Some(input) = named(&signature.inputs, name) else {
                return Err(WiringError::UnknownInput {
                    stage: stage.name.clone().into(),
                    tensor: name.clone().into(),
                    inputs: list(&signature.inputs).into(),
                });
            };
            wired_extra(input, value)
        };
        self.extra_inputs.iter().map(wired).collect()
    }
}

/// Checks that a value fits an input.
pub(in crate::graph) fn wired_extra(
    input: &TensorSpec,
    value: &ExtraInput,
) -> Result<WiredExtra, WiringError> {
    let spec = TensorSpec { shape: closed_shape(&input.shape, value), ..input.clone() };
    let extra = WiredExtra { spec, value: value.clone() };
    // Not whole numbers, so that values of a camera are refused for an input of integers.
    let camera = Intrinsics::new(1.5, 1.5, 0.25, 0.25, 1, 1).expect("valid intrinsics");
    match extra.bytes(&camera) {
        Some(_) => Ok(extra),
        None => Err(WiringError::ExtraInput {
            tensor: input.name.clone().into(),
            kind: input.kind().into(),
            elements: value.expected_elements().into(),
        }),
    }
}

impl WiredExtra {
    /// The tensor's bytes for a camera at the network's size; `None` for a value that does not fit.
    pub(in crate::graph) fn bytes(&self, camera: &Intrinsics) -> Option<Vec<u8>> {
        let elements = self.spec.bytes()? / self.spec.element.bytes()?;
        element_bytes(&self.value.values(camera, elements)?, self.spec.element)
    }
}

/// A shape with its open dimensions set to 1, or the only open one to the count of constants that remains for it.
fn closed_shape(shape: &[i64], value: &ExtraInput) -> Vec<i64> {
    let open = shape.iter().filter(|&&dim| dim < 0).count();
    let fixed: i64 = shape.iter().filter(|&&dim| dim > 0).product();
    let length = match value {
        ExtraInput::Constant(values) if open == 1 && fixed > 0 => (values.len() as i64 / fixed).max(1),
        _ => 1,
    };
    shape.iter().map(|&dim| if dim < 0 { length } else { dim }).collect()
}
