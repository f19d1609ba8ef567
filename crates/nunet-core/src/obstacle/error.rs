//! What prevents obstacles from being computed.

use std::borrow::Cow;

use nunet_types::Hint;

use crate::camera::MountError;
use crate::error_kind::ErrorKind;

/// What prevents obstacles from being computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ObstacleError {
    /// The mount, of a caller that makes it together with the options.
    #[error(transparent)]
    Mount(#[from] MountError),
    /// An option out of range.
    #[error("{option} is {value}, expected {expected}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        expected: Cow<'static, str>,
    },
    /// A buffer of another size than the camera's image.
    #[error("the {buffer} map has {got} pixels, expected {expected} for a camera of {width}x{height}")]
    Size {
        /// The buffer.
        buffer: &'static str,
        /// Pixels given.
        got: usize,
        /// Pixels needed.
        expected: usize,
        /// Width of the camera's image, pixels.
        width: u32,
        /// Height of the camera's image, pixels.
        height: u32,
    },
}

impl ObstacleError {
    /// [`ErrorKind::Buffer`] for a wrong size, [`ErrorKind::Argument`] for all others.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Mount(error) => error.kind(),
            Self::Option { .. } => ErrorKind::Argument,
            Self::Size { .. } => ErrorKind::Buffer,
        }
    }
}

impl Hint for ObstacleError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            // Transparent: it is not in the chain of causes itself.
            Self::Mount(error) => error.hint(),
            Self::Option { .. } | Self::Size { .. } => None,
        }
    }
}
