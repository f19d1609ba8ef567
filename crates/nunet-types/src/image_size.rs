//! Width and height of an image.

use std::error::Error;
use std::fmt;
use std::str::FromStr;

use crate::error_kind::TypesErrorKind;

/// The longest side of an image that is accepted, in pixels: larger than any camera's, and small enough that
/// no size computed from it overflows.
pub const MAX_SIDE_PX: u32 = 32_768;

/// Width and height of an image, in pixels. Displayed and parsed as `640x480`.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ImageSize {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl ImageSize {
    /// The size of `width` columns and `height` rows, unchecked; see [`check`](Self::check).
    #[must_use]
    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// The same size if both sides are 1 to [`MAX_SIDE_PX`].
    ///
    /// # Errors
    /// A side that is 0 or too long.
    pub fn check(self) -> Result<Self, ImageSizeError> {
        let sides = 1..=MAX_SIDE_PX;
        if sides.contains(&self.width) && sides.contains(&self.height) {
            return Ok(self);
        }
        Err(ImageSizeError::Side { size: self })
    }

    /// Pixels of the image.
    #[must_use]
    pub const fn pixel_count(self) -> usize {
        (self.width as usize).saturating_mul(self.height as usize)
    }
}

impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

impl From<(u32, u32)> for ImageSize {
    /// From `(width, height)`.
    fn from((width, height): (u32, u32)) -> Self {
        Self { width, height }
    }
}

impl FromStr for ImageSize {
    type Err = ImageSizeError;

    fn from_str(text: &str) -> Result<Self, ImageSizeError> {
        let sides = text.split_once('x').and_then(|(width, height)| {
            Some(Self { width: width.parse().ok()?, height: height.parse().ok()? })
        });
        sides.ok_or_else(|| ImageSizeError::Syntax { text: text.to_owned() })?.check()
    }
}

/// Why something is not the size of an image.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum ImageSizeError {
    /// A side is 0 or longer than [`MAX_SIDE_PX`].
    Side {
        /// The size given.
        size: ImageSize,
    },
    /// The text is not of the form `WxH`.
    Syntax {
        /// What was written.
        text: String,
    },
}

impl ImageSizeError {
    /// [`TypesErrorKind::Argument`].
    #[must_use]
    pub const fn kind(&self) -> TypesErrorKind {
        TypesErrorKind::Argument
    }
}

impl fmt::Display for ImageSizeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Side { size } => {
                write!(f, "image size is `{size}`, expected sides of 1 to {MAX_SIDE_PX} pixels")
            }
            Self::Syntax { text } => write!(
                f,
                "image size is `{text}`, expected `WxH` of 1 to {MAX_SIDE_PX} pixels, such as `640x480`"
            ),
        }
    }
}

impl Error for ImageSizeError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_reads_back_as_it_is_written() {
        let size = ImageSize::new(640, 480);
        assert_eq!(size.to_string(), "640x480");
        assert_eq!("640x480".parse(), Ok(size));
        assert_eq!(size.pixel_count(), 307_200);
    }

    #[test]
    fn a_side_out_of_range_or_missing_is_refused() {
        for text in ["0x1", "1x0", "32769x1", "1x4294967295"] {
            let error = text.parse::<ImageSize>().unwrap_err();
            assert!(matches!(error, ImageSizeError::Side { .. }), "{text}: {error}");
        }
        for text in ["", "640", "640x", "x480", "640x480x3", "-1x2", "640X480", "1.0x2", "99999999999x1"] {
            let error = text.parse::<ImageSize>().unwrap_err();
            assert!(matches!(error, ImageSizeError::Syntax { .. }), "{text}: {error}");
            assert_eq!(error.kind(), TypesErrorKind::Argument);
        }
    }
}
