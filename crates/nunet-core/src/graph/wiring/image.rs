//! The image: all stages that take it agree on its type and shape, and these follow the contract.

use nunet_types::ImageSize;

use super::{Contract, IMAGE, Unwired, agree};
use crate::frame::MAX_SIDE_PX;
use crate::graph::WiringError;
use crate::graph::manifest::ManifestStage;
use crate::graph::signature::{ElementType, TensorSpec, kind};

impl Unwired<'_> {
    /// The image that all stages which take it agree on.
    pub(super) fn image(&self) -> Result<TensorSpec, WiringError> {
        let mut seen: Option<(&str, TensorSpec)> = None;
        for (stage, signature) in self.manifest.stages.iter().zip(&self.signatures) {
            for input in signature.inputs.iter().filter(|input| takes_image(stage, input)) {
                let wanted = self.image_of(&stage.name, input)?;
                match &seen {
                    Some((first, image)) if image.kind() != wanted.kind() => {
                        return Err(WiringError::ImagesDiffer {
                            first: (*first).into(),
                            first_kind: image.kind().into(),
                            stage: stage.name.clone().into(),
                            kind: wanted.kind().into(),
                        });
                    }
                    Some(_) => {}
                    None => seen = Some((&stage.name, wanted)),
                }
            }
        }
        seen.map(|(_, image)| image).ok_or(WiringError::NoImage)
    }

    /// One stage's image, checked against the contract.
    fn image_of(&self, stage: &str, input: &TensorSpec) -> Result<TensorSpec, WiringError> {
        let (fits, shape) = match self.contract {
            Contract::Nunet => {
                let fits = matches!(input.shape[..], [1, height, width, 3] if height > 0 && width > 0);
                (fits && input.element == ElementType::Uint8, input.shape.clone())
            }
            Contract::Foreign { element, image, .. } => {
                (input.element == element && agree(&input.shape, &image), image.to_vec())
            }
        };
        if fits {
            Ok(TensorSpec { name: IMAGE.to_owned(), element: input.element, shape })
        } else {
            Err(WiringError::Image {
                stage: stage.to_owned().into(),
                tensor: input.name.clone().into(),
                kind: input.kind().into(),
                expected: self.contract.image_kind().into(),
            })
        }
    }

    /// Its width and height, pixels.
    pub(super) fn size(&self, image: &TensorSpec) -> Result<ImageSize, WiringError> {
        match (self.contract, &image.shape[..]) {
            (Contract::Foreign { size, .. }, _) => Ok(size),
            (Contract::Nunet, &[_, height, width, _]) => {
                let side = |pixels: i64| u32::try_from(pixels).ok().filter(|&side| side <= MAX_SIDE_PX);
                match (side(width), side(height)) {
                    (Some(width), Some(height)) => Ok(ImageSize { width, height }),
                    _ => Err(WiringError::TooLarge { kind: image.kind().into() }),
                }
            }
            (Contract::Nunet, _) => Err(WiringError::NoImage),
        }
    }
}

impl Contract {
    /// Type and shape of the image, for messages.
    fn image_kind(self) -> String {
        match self {
            Self::Nunet => "uint8 [1, H, W, 3]".to_owned(),
            Self::Foreign { element, image, .. } => kind(element, &image),
        }
    }
}

fn takes_image(stage: &ManifestStage, input: &TensorSpec) -> bool {
    stage.inputs.get(&input.name).is_some_and(|source| source == IMAGE)
}
