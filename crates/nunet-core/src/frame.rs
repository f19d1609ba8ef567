//! A picture as a camera gives it: bytes that somebody else owns, and how to read them.

pub use nunet_types::{MAX_SIDE_PX, PixelFormat};

/// A picture in memory that somebody else keeps alive: rows from the top, pixels from the left.
///
/// Made by [`ImageView::new`] alone, which checks that the bytes hold the picture; nobody checks again later.
#[derive(Debug, Clone, Copy)]
pub struct ImageView<'a> {
    bytes: &'a [u8],
    width: u32,
    height: u32,
    row_stride: u32,
    format: PixelFormat,
}

impl<'a> ImageView<'a> {
    /// A view of `bytes` as a picture of `width` x `height` pixels whose rows begin `row_stride` bytes apart.
    ///
    /// Bytes behind the last row are ignored.
    ///
    /// # Errors
    /// A side that is 0 or longer than [`MAX_SIDE_PX`], a stride shorter than a row, and too few bytes.
    pub fn new(
        bytes: &'a [u8],
        width: u32,
        height: u32,
        row_stride: u32,
        format: PixelFormat,
    ) -> Result<Self, FrameError> {
        if !(1..=MAX_SIDE_PX).contains(&width) || !(1..=MAX_SIDE_PX).contains(&height) {
            return Err(FrameError::Size { width, height });
        }
        let least = format.min_stride(width);
        if row_stride < least {
            return Err(FrameError::Stride { format, width, row_stride, least });
        }
        let expected = format.byte_len(width, height, row_stride);
        let Some(bytes) = bytes.get(..expected) else {
            return Err(FrameError::TooShort {
                format,
                width,
                height,
                row_stride,
                expected,
                got: bytes.len(),
            });
        };
        Ok(Self { bytes, width, height, row_stride, format })
    }

    /// A view of `bytes` without padding between rows.
    ///
    /// # Errors
    /// As [`ImageView::new`].
    pub fn packed(bytes: &'a [u8], width: u32, height: u32, format: PixelFormat) -> Result<Self, FrameError> {
        Self::new(bytes, width, height, format.min_stride(width), format)
    }

    /// The picture's bytes, [`PixelFormat::byte_len`] of them.
    #[must_use]
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Pixels from left to right.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels from top to bottom.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Width and height, pixels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Bytes from the start of one row to the start of the next.
    #[must_use]
    pub fn row_stride(&self) -> u32 {
        self.row_stride
    }

    /// How the pixels lie.
    #[must_use]
    pub fn format(&self) -> PixelFormat {
        self.format
    }

    /// Whether no padding lies between the rows.
    #[must_use]
    pub fn is_packed(&self) -> bool {
        self.row_stride == self.format.min_stride(self.width)
    }
}

/// What is wrong with a picture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// A side is 0 or too long.
    #[error("a picture of `{width}x{height}` pixels; sides are 1 to `{MAX_SIDE_PX}`")]
    Size {
        /// Pixels from left to right.
        width: u32,
        /// Pixels from top to bottom.
        height: u32,
    },
    /// Rows are longer than the distance between their starts.
    #[error("rows begin `{row_stride}` bytes apart, but `{width}` pixels of {format} take `{least}`")]
    Stride {
        /// How the pixels lie.
        format: PixelFormat,
        /// Pixels from left to right.
        width: u32,
        /// Bytes from row to row, as given.
        row_stride: u32,
        /// Bytes of one row.
        least: u32,
    },
    /// The bytes end before the picture does.
    #[error(
        "`{got}` bytes for a {format} picture of `{width}x{height}` with rows `{row_stride}` bytes apart, which takes \
         `{expected}`"
    )]
    TooShort {
        /// How the pixels lie.
        format: PixelFormat,
        /// Pixels from left to right.
        width: u32,
        /// Pixels from top to bottom.
        height: u32,
        /// Bytes from row to row.
        row_stride: u32,
        /// Bytes needed.
        expected: usize,
        /// Bytes given.
        got: usize,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_row_needs_no_padding() {
        assert!(ImageView::new(&[0; 206], 2, 3, 100, PixelFormat::Rgb8).is_ok());
        assert!(ImageView::new(&[0; 205], 2, 3, 100, PixelFormat::Rgb8).is_err());
    }

    #[test]
    fn bytes_that_do_not_hold_the_picture_are_refused() {
        let error = ImageView::packed(&[0; 11], 2, 2, PixelFormat::Rgb8).unwrap_err();
        assert_eq!(
            error.to_string(),
            "`11` bytes for a rgb8 picture of `2x2` with rows `6` bytes apart, which takes `12`"
        );
        let error = ImageView::new(&[0; 12], 2, 2, 5, PixelFormat::Rgb8).unwrap_err();
        assert_eq!(error.to_string(), "rows begin `5` bytes apart, but `2` pixels of rgb8 take `6`");
        assert!(ImageView::packed(&[], 0, 2, PixelFormat::Mono8).is_err());
        assert!(ImageView::packed(&[], 1, u32::MAX, PixelFormat::Yuyv).is_err());
    }
}
