//! The errors of scaling depth.

use std::borrow::Cow;

use nunet_types::Hint;

use crate::error_kind::ErrorKind;

/// Why depth cannot be scaled.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScaleError {
    /// A scale for depth that has no unit.
    #[error("the model's depth has no unit, so that no factor makes meters of it")]
    NoUnit,
    /// A scale from the floor for a model without a floor class.
    #[error("the model has no class for floor, so that the floor cannot give the scale")]
    NoFloorClass,
}

impl ScaleError {
    /// [`ErrorKind::Argument`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Argument
    }
}

impl Hint for ScaleError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::NoUnit => "choose a model with metric depth".into(),
            Self::NoFloorClass => {
                "choose a model that segments, or measure the factor once and give it".into()
            }
        })
    }
}
