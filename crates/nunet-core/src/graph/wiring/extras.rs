//! Inputs that a sidecar feeds: each is in the file, and its value fits the tensor.

use super::{MAX_TENSOR_BYTES, Unwired, WiredExtra, list, named};
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
    /// The tensor's bytes for a camera at the network's size; `None` for a value that does not fit, and for a
    /// tensor that is too large.
    pub(in crate::graph) fn bytes(&self, camera: &Intrinsics) -> Option<Vec<u8>> {
        let bytes = self.spec.bytes().filter(|&bytes| bytes <= MAX_TENSOR_BYTES)?;
        let elements = bytes / self.spec.element.bytes()?;
        element_bytes(&self.value.values(camera, elements)?, self.spec.element)
    }
}

/// A shape with its open dimensions set to 1, or the only open one to the count of constants that remains for
/// it.
fn closed_shape(shape: &[i64], value: &ExtraInput) -> Vec<i64> {
    let open = shape.iter().filter(|&&dim| dim < 0).count();
    // Saturates: the size of a tensor that would overflow is refused later.
    let fixed = shape.iter().filter(|&&dim| dim > 0).fold(1, |all: i64, &dim| all.saturating_mul(dim));
    let length = match value {
        ExtraInput::Constant(values) if open == 1 => (values.len() as i64 / fixed).max(1),
        _ => 1,
    };
    shape.iter().map(|&dim| if dim < 0 { length } else { dim }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::ElementType;

    #[test]
    fn an_open_dimension_takes_the_rest_of_the_constants() {
        let values = ExtraInput::Constant(vec![1.0; 6]);
        assert_eq!(closed_shape(&[-1, 3], &values), [2, 3]);
        assert_eq!(closed_shape(&[-1, -1], &values), [1, 1]);
        assert_eq!(closed_shape(&[-1, 7], &values), [1, 7]);
    }

    #[test]
    fn an_input_that_is_too_large_is_refused() {
        let one = ExtraInput::Constant(vec![1.0]);
        for shape in [&[-1, i64::MAX, i64::MAX][..], &[i64::MAX], &[1 << 40], &[(1 << 28) + 1]] {
            let input = TensorSpec { name: "x".into(), element: ElementType::Float32, shape: shape.to_vec() };
            let refused = wired_extra(&input, &one);
            assert!(matches!(refused, Err(WiringError::ExtraInput { .. })), "{shape:?}");
        }
    }
}
