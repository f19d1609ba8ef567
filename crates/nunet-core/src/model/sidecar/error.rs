//! What is wrong with a sidecar.

use std::borrow::Cow;

use nunet_types::Hint;

use crate::camera::CameraError;
use crate::depth::DepthError;
use crate::error_kind::ErrorKind;
use crate::frame::MAX_SIDE_PX;

/// What is wrong with a sidecar.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SidecarError {
    /// Not TOML, or other keys than a sidecar has.
    #[error("{reason}")]
    Syntax {
        /// The parser's message, with line and column.
        reason: String,
    },
    /// A side of 0 pixels or beyond any camera's.
    #[error("`size = [{height}, {width}]` is out of range; sides are 1 to {MAX_SIDE_PX}")]
    Size {
        /// Pixels.
        height: u32,
        /// Pixels.
        width: u32,
    },
    /// A normalization that is not finite, divides by 0, or makes all images the same.
    #[error("`scale`, `mean` and `std` must be finite, and `scale` and `std` not 0")]
    Normalization,
    /// Bytes in another layout than the camera's.
    #[error("`dtype = \"uint8\"` requires `nhwc`, `rgb`, and no `mean`, `std` or `scale`")]
    Uint8,
    /// Numbers that no camera has.
    #[error("`[camera]`: {0}")]
    Camera(Box<CameraError>),
    /// A name or a list that cannot be fed.
    #[error("input `{input}` is `{value}`, expected a number, a list of numbers, or a camera value")]
    Input {
        /// The input tensor.
        input: String,
        /// The value, shortened.
        value: String,
    },
    /// The image is fed as something else as well.
    #[error("`[inputs]` has `{input}`, which is the image (`[input] tensor`)")]
    ImageTwice {
        /// The input tensor.
        input: String,
    },
    /// A wrong description of the depth.
    #[error(transparent)]
    Depth(#[from] DepthError),
}

impl SidecarError {
    /// [`ErrorKind::Model`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Model
    }
}

impl Hint for SidecarError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::Syntax { .. } => Some(
                "a sidecar has `[input]` tensor, layout, dtype, color, size, mean, std, scale; `[inputs]`; `[output]` \
                 depth, encoding, scale, shift, min_m, max_m; `[camera]` width, height, fx, fy"
                    .into(),
            ),
            Self::Camera(_) => {
                Some("write `[camera]` fx in pixels of the training images; width, height and fy are optional".into())
            }
            Self::Input { .. } => Some(
                "camera values are \"intrinsics\", \"inverse_intrinsics\" and \"fx\", at the size of the network's image"
                    .into(),
            ),
            Self::Depth(error) => error.hint(),
            _ => None,
        }
    }
}
