//! The layout of an image's pixels in memory.

use crate::vocabulary::vocabulary;

vocabulary! {
    /// The layout of an image's pixels in memory: rows from the top, pixels from the left.
    PixelFormat as "pixel_format" {
        /// 3 bytes a pixel: red, green, blue.
        Rgb8 = 0 "rgb8",
        /// 3 bytes a pixel: blue, green, red.
        Bgr8 = 1 "bgr8",
        /// 1 byte a pixel: gray.
        Mono8 = 2 "mono8",
        /// 4 bytes for 2 pixels: Y0 U Y1 V, BT.601 limited range. A last odd pixel takes 4 bytes too.
        Yuyv = 3 "yuyv",
        /// A plane of Y, then a plane of U V pairs for each 2x2 pixels, BT.601 limited range. Both planes
        /// have the same stride; odd sides round up in the second plane.
        Nv12 = 4 "nv12",
    }
}

impl PixelFormat {
    /// Bytes of one row without padding, for an image `width` pixels wide.
    #[must_use]
    pub const fn min_stride(self, width: u32) -> u32 {
        match self {
            Self::Rgb8 | Self::Bgr8 => width.saturating_mul(3),
            Self::Mono8 => width,
            Self::Yuyv => width.div_ceil(2).saturating_mul(4),
            Self::Nv12 => width.div_ceil(2).saturating_mul(2),
        }
    }

    /// Rows in memory of an image `height` pixels high: NV12 has half as many again for its second plane.
    #[must_use]
    pub const fn row_count(self, height: u32) -> u32 {
        match self {
            Self::Nv12 => height.saturating_add(height.div_ceil(2)),
            Self::Rgb8 | Self::Bgr8 | Self::Mono8 | Self::Yuyv => height,
        }
    }

    /// The fewest bytes that hold an image whose rows begin `row_stride` bytes apart.
    ///
    /// The last row needs no padding after it, so a view may end where its allocation ends.
    #[must_use]
    pub const fn byte_len(self, width: u32, height: u32, row_stride: u32) -> usize {
        match self.row_count(height) as usize {
            0 => 0,
            rows => {
                let before_last = (row_stride as usize).saturating_mul(rows - 1);
                before_last.saturating_add(self.min_stride(width) as usize)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_sides_round_up_where_pixels_share_color() {
        assert_eq!(PixelFormat::Yuyv.min_stride(5), 12);
        assert_eq!(PixelFormat::Nv12.min_stride(5), 6);
        assert_eq!(PixelFormat::Nv12.row_count(3), 5);
        assert_eq!(PixelFormat::Nv12.byte_len(5, 3, 6), 6 * (3 + 2));
        assert_eq!(PixelFormat::Rgb8.byte_len(5, 3, 15), 45);
    }

    #[test]
    fn the_last_row_needs_no_padding() {
        assert_eq!(PixelFormat::Rgb8.byte_len(2, 3, 100), 206);
        assert_eq!(PixelFormat::Mono8.byte_len(2, 0, 100), 0);
    }

    #[test]
    fn sizes_beyond_every_camera_do_not_overflow() {
        for &format in PixelFormat::ALL {
            assert!(format.byte_len(u32::MAX, u32::MAX, u32::MAX) > u32::MAX as usize, "{format}");
        }
    }
}
