//! The results of the whole graph: depth, labels and confidence as the contract specifies.

use nunet_types::ImageSize;

use super::{Contract, Unwired, Wired};
use crate::graph::WiringError;
use crate::graph::signature::{ElementType, TensorSpec, kind};

impl Unwired<'_> {
    /// Finds depth, labels and confidence among the outputs of the stages.
    pub(super) fn wire_results(&self, plan: &mut Wired) -> Result<(), WiringError> {
        let outputs = &self.manifest.outputs;
        plan.depth = self.find("output `depth`", &outputs.depth, plan)?;
        plan.depth_size = self.depth_size(&plan.tensors[plan.depth], plan.size)?;
        plan.labels = self.bytes_of_pixels("labels", outputs.labels.as_deref(), plan)?;
        plan.confidence = self.bytes_of_pixels("confidence", outputs.confidence.as_deref(), plan)?;
        if let Some(index) = plan.confidence.filter(|_| plan.confidence == plan.labels) {
            return Err(WiringError::SameResult { reference: plan.tensors[index].name.clone().into() });
        }
        Ok(())
    }

    /// A result of one byte per pixel, `[1, H, W]`.
    fn bytes_of_pixels(
        &self,
        role: &'static str,
        reference: Option<&str>,
        plan: &Wired,
    ) -> Result<Option<usize>, WiringError> {
        let Some(reference) = reference else { return Ok(None) };
        let index = self.find(&format!("output `{role}`"), reference, plan)?;
        let (width, height) = (i64::from(plan.size.width), i64::from(plan.size.height));
        let expected = [1, height, width];
        let given = &plan.tensors[index];
        if given.element != ElementType::Uint8 || given.shape != expected {
            return Err(mismatch(role, given, &kind(ElementType::Uint8, &expected), plan.size));
        }
        Ok(Some(index))
    }

    /// Width and height of the depth map. Networks of the contract give depth of the image's size; foreign
    /// ones may give another size of the same aspect ratio, with dimensions of 1 anywhere around it.
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
                    let found =
                        u32::try_from(width).ok().zip(u32::try_from(height).ok()).map(ImageSize::from);
                    found.filter(|&found| shows_all_of(size, found))
                }
                _ => None,
            },
        };
        match found {
            Some(found) if given.element == ElementType::Float32 => Ok(found),
            _ => {
                let expected = match self.contract {
                    Contract::Nunet => kind(ElementType::Float32, &expected),
                    Contract::Foreign { .. } => {
                        "float32 with one height and one width, of the image's aspect ratio".to_owned()
                    }
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

/// Whether depth of the size `depth` can be that of the whole image: its aspect ratio is the image's up to a
/// pixel, or each side is reduced or enlarged by a whole factor. Another one is transposed or cropped.
fn shows_all_of(image: ImageSize, depth: ImageSize) -> bool {
    let cross = |a: u32, b: u32| u64::from(a) * u64::from(b);
    let off = cross(depth.width, image.height).abs_diff(cross(image.width, depth.height));
    let is_whole = |large: ImageSize, small: ImageSize| {
        let whole = |large: u32, small: u32| large > 0 && large.is_multiple_of(small);
        whole(large.width, small.width) && whole(large.height, small.height)
    };
    off < u64::from(image.width.max(image.height)) || is_whole(image, depth) || is_whole(depth, image)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_of_another_aspect_ratio_is_not_that_of_the_whole_image() {
        let fits = |image: (u32, u32), depth: (u32, u32)| shows_all_of(image.into(), depth.into());
        for (image, depth) in [
            ((64, 48), (64, 48)),
            ((64, 48), (32, 24)),
            ((64, 48), (128, 96)),
            ((64, 48), (64, 24)),
            ((64, 48), (21, 16)),
            ((640, 480), (46, 35)),
        ] {
            assert!(fits(image, depth), "{image:?} {depth:?}");
        }
        for (image, depth) in [
            ((64, 48), (48, 64)),
            ((64, 32), (32, 64)),
            ((64, 48), (24, 32)),
            ((640, 480), (640, 360)),
            ((640, 480), (0, 480)),
        ] {
            assert!(!fits(image, depth), "{image:?} {depth:?}");
        }
    }
}
