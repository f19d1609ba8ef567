//! An image as a camera delivers it: borrowed bytes, and their format.

use std::borrow::Cow;

use nunet_types::{Hint, ImageSize, PixelRect};
pub use nunet_types::{MAX_SIDE_PX, PixelFormat};

use crate::error_kind::ErrorKind;

/// A borrowed image: rows from the top, pixels from the left.
///
/// [`ImageView::new`] checks that the bytes hold the image, so later stages do not check again.
#[derive(Debug, Clone, Copy)]
pub struct ImageView<'a> {
    bytes: &'a [u8],
    width: u32,
    height: u32,
    row_stride: u32,
    format: PixelFormat,
}

impl<'a> ImageView<'a> {
    /// A view of `bytes` as an image of `width` x `height` pixels whose rows start `row_stride` bytes apart.
    ///
    /// Bytes after the last row are ignored.
    ///
    /// # Errors
    /// A side of 0 or longer than [`MAX_SIDE_PX`], a stride shorter than a row, too few bytes.
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

    /// The image's bytes, [`PixelFormat::byte_len`] of them.
    #[must_use]
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Width, pixels.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height, pixels.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Width and height, pixels.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        ImageSize::new(self.width, self.height)
    }

    /// Bytes from the start of one row to the start of the next.
    #[must_use]
    pub fn row_stride(&self) -> u32 {
        self.row_stride
    }

    /// The pixel format.
    #[must_use]
    pub fn format(&self) -> PixelFormat {
        self.format
    }

    /// A part of the image, without a copy; `None` for a part that is empty or not within the image, and for
    /// formats that share color between pixels.
    #[must_use]
    pub fn part(&self, PixelRect { x, y, width, height }: PixelRect) -> Option<Self> {
        let bytes_per_pixel = match self.format {
            PixelFormat::Rgb8 | PixelFormat::Bgr8 | PixelFormat::Mono8 => self.format.min_stride(1),
            PixelFormat::Yuyv | PixelFormat::Nv12 => return None,
        };
        let within =
            |first: u32, count: u32, side: u32| first.checked_add(count).is_some_and(|end| end <= side);
        if !within(x, width, self.width) || !within(y, height, self.height) {
            return None;
        }
        let start = y as usize * self.row_stride as usize + x as usize * bytes_per_pixel as usize;
        Self::new(self.bytes.get(start..)?, width, height, self.row_stride, self.format).ok()
    }

    /// Whether there is no padding between rows.
    #[must_use]
    pub fn is_packed(&self) -> bool {
        self.row_stride == self.format.min_stride(self.width)
    }
}

/// Why bytes are not an image.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// A side of 0 pixels, or too long.
    #[error("image size {width}x{height} is out of range; sides are 1 to {MAX_SIDE_PX}")]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// A stride shorter than a row.
    #[error("the row stride is {row_stride} bytes, but {width} pixels of {format} have {least}")]
    Stride {
        /// The pixel format.
        format: PixelFormat,
        /// Width, pixels.
        width: u32,
        /// Bytes from row to row.
        row_stride: u32,
        /// Bytes of one row.
        least: u32,
    },
    /// Fewer bytes than the image has.
    #[error(
        "an image of {width}x{height} in {format} with a row stride of {row_stride} has {expected} bytes, got {got}"
    )]
    TooShort {
        /// The pixel format.
        format: PixelFormat,
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Bytes from row to row.
        row_stride: u32,
        /// Bytes needed.
        expected: usize,
        /// Bytes given.
        got: usize,
    },
}

impl FrameError {
    /// [`ErrorKind::Image`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Image
    }
}

impl Hint for FrameError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        None
    }
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
    fn a_part_shares_the_bytes_and_ends_with_its_last_pixel() {
        let bytes: Vec<u8> = (0..3 * 4 + 2 * 5).collect(); // 3 rows of 4 pixels, 5 bytes of padding
        let gray = ImageView::new(&bytes, 4, 3, 9, PixelFormat::Mono8).unwrap();
        let part = gray.part(PixelRect { x: 2, y: 1, width: 2, height: 2 }).unwrap();
        assert_eq!((part.size(), part.row_stride()), ((2, 2).into(), 9));
        assert_eq!(part.bytes(), &bytes[11..22]);
        let outside = [(3, 0, 2, 1), (0, 3, 1, 1), (0, 0, 0, 1), (u32::MAX, 0, 2, 1)];
        for (x, y, width, height) in outside {
            assert!(gray.part(PixelRect { x, y, width, height }).is_none(), "{x} {y} {width} {height}");
        }
        let yuyv = ImageView::packed(&bytes, 4, 2, PixelFormat::Yuyv).unwrap();
        assert!(yuyv.part(PixelRect { x: 0, y: 0, width: 2, height: 1 }).is_none());
    }

    #[test]
    fn too_few_bytes_and_a_short_stride_are_refused() {
        let format = PixelFormat::Rgb8;
        let error = ImageView::packed(&[0; 11], 2, 2, format).unwrap_err();
        let short =
            FrameError::TooShort { format, width: 2, height: 2, row_stride: 6, expected: 12, got: 11 };
        assert_eq!(error, short);
        let error = ImageView::new(&[0; 12], 2, 2, 5, format).unwrap_err();
        assert_eq!(error, FrameError::Stride { format, width: 2, row_stride: 5, least: 6 });
        assert!(ImageView::packed(&[], 0, 2, PixelFormat::Mono8).is_err());
        assert!(ImageView::packed(&[], 1, u32::MAX, PixelFormat::Yuyv).is_err());
    }
}
