//! A picture as a camera gives it: bytes that somebody else owns, and how to read them.

use std::fmt;
use std::str::FromStr;

/// The longest side of a picture that is accepted, in pixels: beyond any camera, and small enough that no size
/// computed from it overflows.
pub const MAX_SIDE_PX: u32 = 32_768;

/// How the pixels of a picture lie in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// 3 bytes a pixel: red, green, blue.
    Rgb8,
    /// 3 bytes a pixel: blue, green, red.
    Bgr8,
    /// 1 byte a pixel: grey.
    Mono8,
    /// 4 bytes for 2 pixels: Y0 U Y1 V, BT.601 limited range. A last odd pixel takes 4 bytes too.
    Yuyv,
    /// A plane of Y, then a plane of U V pairs for each 2x2 pixels, BT.601 limited range. Both planes share one
    /// stride; odd sides round up in the second.
    Nv12,
}

impl PixelFormat {
    /// All formats, in the order of the documentation.
    pub const ALL: [Self; 5] = [Self::Rgb8, Self::Bgr8, Self::Mono8, Self::Yuyv, Self::Nv12];

    /// The name in files, on the command line and in messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgb8 => "rgb8",
            Self::Bgr8 => "bgr8",
            Self::Mono8 => "mono8",
            Self::Yuyv => "yuyv",
            Self::Nv12 => "nv12",
        }
    }

    /// Bytes of one row without padding, for a picture `width` pixels wide.
    #[must_use]
    pub fn min_stride(self, width: u32) -> u32 {
        match self {
            Self::Rgb8 | Self::Bgr8 => width.saturating_mul(3),
            Self::Mono8 => width,
            Self::Yuyv => width.div_ceil(2).saturating_mul(4),
            Self::Nv12 => width.div_ceil(2).saturating_mul(2),
        }
    }

    /// The fewest bytes that hold a picture whose rows begin `row_stride` bytes apart.
    ///
    /// The last row needs no padding behind it, so that a view may end where its allocation ends.
    #[must_use]
    pub fn byte_len(self, width: u32, height: u32, row_stride: u32) -> usize {
        let rows = match self {
            Self::Nv12 => height as usize + height.div_ceil(2) as usize,
            _ => height as usize,
        };
        match rows {
            0 => 0,
            _ => {
                (row_stride as usize).saturating_mul(rows - 1).saturating_add(self.min_stride(width) as usize)
            }
        }
    }
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for PixelFormat {
    type Err = FrameError;

    fn from_str(text: &str) -> Result<Self, FrameError> {
        Self::ALL
            .into_iter()
            .find(|format| format.name() == text)
            .ok_or_else(|| FrameError::UnknownFormat { text: text.to_owned() })
    }
}

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
    /// The name of a format is none of ours.
    #[error("`{text}` is no pixel format\nhint: one of rgb8, bgr8, mono8, yuyv, nv12")]
    UnknownFormat {
        /// What was written.
        text: String,
    },
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
    fn odd_sides_round_up_where_pixels_share_colour() {
        assert_eq!(PixelFormat::Yuyv.min_stride(5), 12);
        assert_eq!(PixelFormat::Nv12.min_stride(5), 6);
        assert_eq!(PixelFormat::Nv12.byte_len(5, 3, 6), 6 * (3 + 2));
        assert_eq!(PixelFormat::Rgb8.byte_len(5, 3, 15), 45);
    }

    #[test]
    fn the_last_row_needs_no_padding() {
        assert_eq!(PixelFormat::Rgb8.byte_len(2, 3, 100), 206);
        assert!(ImageView::new(&[0; 206], 2, 3, 100, PixelFormat::Rgb8).is_ok());
        assert!(ImageView::new(&[0; 205], 2, 3, 100, PixelFormat::Rgb8).is_err());
    }

    #[test]
    fn names_are_read_as_they_are_written() {
        for format in PixelFormat::ALL {
            assert_eq!(format.to_string().parse(), Ok(format));
        }
        let error = "rgb".parse::<PixelFormat>().unwrap_err();
        assert_eq!(error.to_string(), "`rgb` is no pixel format\nhint: one of rgb8, bgr8, mono8, yuyv, nv12");
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
