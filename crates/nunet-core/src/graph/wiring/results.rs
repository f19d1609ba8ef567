//! The results of the whole graph: depth and labels as the contract specifies.

use nunet_types::ImageSize;

use super::{Contract, Unwired, Wired};
use crate::graph::WiringError;
use crate::graph::signature::{ElementType, TensorSpec, kind};

impl Unwired<'_> {
    /// Finds depth and labels among the outputs of the stages.
    pub(super) fn wire_results(&self, plan: &mut Wired) -> Result<(), WiringError> {
        let outputs = &self.manifest.outputs;
        plan.depth = self.find("output `depth`", &outputs.depth, plan)?;
        plan.depth_size = self.depth_size(&plan.tensors[plan.depth], plan.size)?;
        if let Some(labels) = &outputs.labels {
            let index = self.find("output `labels`", labels, plan)?;
            let (width, height) = (i64::from(plan.size.width), i64::from(plan.size.height));
            let expected = [1, height, width];
            let given = &plan.tensors[index];
            if given.element != ElementType::Uint8 || given.shape != expected {
                return Err(mismatch("labels", given, &kind(ElementType::Uint8, &expected), plan.size));
            }
            plan.labels = Some(index);
        }
        Ok(())
    }

    /// Width and height of the depth map. Networks of the contract give depth of the image's size; foreign ones may give
    /// another size, with dimensions of 1 anywhere around it.
    fn depth_size(&self, given: &TensorSpec, size: ImageSize) -> Result<ImageSize, WiringError> {
        let (width, height) = (i64::from(size.width), i64::from(size.height));
        let expected = [1, 1, height, width];
        let without_ones =
            |shape: &[i64]| -> Vec<i64> { shape.iter().copied().filter(|&dim| dim != 1).collect() };
        let found = match self.contract {
            Contract::Nunet => (given.shape == expected).then_some(size),
            Contract::Foreign { .. } => match without_ones(&given.shape)[..] {
                _ if without_ones(&given.shape) == without_ones(&expected) => Some(size),
                [height, width] => {
                    u32::try_from(width).ok().zip(u32::try_from(height).ok()).map(ImageSize::from)
                }
                _ => None,
            },
        };
        match found {
            Some(found) if given.element == ElementType::Float32 => Ok(found),
            _ => {
                let expected = match self.contract {
                    Contract::Nunet => kind(ElementType::Float32, &expected),
                    Contract::Foreign { .. } => "float32 with one height and one width".to_owned(),
                };
                Err(mismatch("depth", given, &expected, size))
            }
        }
    }
}

impl Wired {
    /// The shape of the caller's depth map: that of the image if depth is resized, else the file's own.
    pub(in crate::graph) fn depth_shape(&self, is_resized: bool) -> Vec<i64> {
        match is_resized {
            true => vec![1, 1, i64::from(self.size.height), i64::from(self.size.width)],
            false => self.tensors[self.depth].shape.clone(),
        }
    }
}

fn mismatch(role: &'static str, given: &TensorSpec, expected: &str, size: ImageSize) -> WiringError {
    WiringError::Result {
        role,
        reference: given.name.clone().into(),
        given: given.kind().into(),
        expected: expected.into(),
        width: size.width,
        height: size.height,
    }
}
