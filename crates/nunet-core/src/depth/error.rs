//! The errors in the description of a network's depth.

use std::borrow::Cow;

use nunet_types::Hint;

use super::DepthEncoding;
use crate::error_kind::ErrorKind;

/// Why the description of a network's depth is invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DepthError {
    /// An unknown name.
    #[error("`{text}` is not a depth encoding")]
    UnknownEncoding {
        /// The text.
        text: String,
    },
    /// An empty range.
    #[error("depth range `{min_m}` to `{max_m}` m is not finite, starts below 0, or is empty")]
    Range {
        /// The smallest depth, meters.
        min_m: f32,
        /// The largest depth, meters.
        max_m: f32,
    },
    /// A scale of 0, or numbers that are not finite.
    #[error("output scale `{scale}` and shift `{shift}` must be finite, and the scale not 0")]
    OutputScale {
        /// The factor.
        scale: f32,
        /// The summand.
        shift: f32,
    },
}

impl DepthError {
    /// [`ErrorKind::Model`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Model
    }
}

impl Hint for DepthError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::UnknownEncoding { .. } => Some(format!("use one of {}", DepthEncoding::names()).into()),
            Self::Range { .. } | Self::OutputScale { .. } => None,
        }
    }
}
