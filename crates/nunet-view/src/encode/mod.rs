//! Frames as bytes for clients. All of it runs on the server's thread.

mod codes;
mod colors;
mod jpeg;
mod pixels;
mod png;

pub use codes::{DepthMap, DepthMapError};
pub(crate) use codes::{LevelCurve, encode_bytes, encode_depth};
pub(crate) use codes::{inflate, levels_of};
pub(crate) use colors::{auto_range, colorize, palette};
pub(crate) use jpeg::{image_jpeg, rgb_jpeg};
pub(crate) use png::depth_png;

use nunet_types::ImageSize;

/// The smallest stride at which every n-th pixel of `width` pixels are at most `max_width`.
pub(crate) fn stride_for(width: u32, max_width: u32) -> u32 {
    width.div_ceil(max_width.max(1)).max(1)
}

/// The size of every n-th column and row, beginning with the first.
pub(crate) fn subsampled(size: ImageSize, stride: u32) -> ImageSize {
    ImageSize::new(size.width.div_ceil(stride), size.height.div_ceil(stride))
}

/// Every n-th value of every n-th row.
pub(crate) fn subsample<T: Copy>(values: &[T], size: ImageSize, stride: u32) -> Vec<T> {
    let (width, stride) = (size.width as usize, stride as usize);
    let rows = values.chunks_exact(width).step_by(stride);
    rows.flat_map(|row| row.iter().copied().step_by(stride)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_second_pixel_begins_with_the_first_and_odd_sides_round_up() {
        let values: Vec<u8> = (0..15).collect();
        let size = ImageSize::new(5, 3);
        assert_eq!(subsample(&values, size, 2), [0, 2, 4, 10, 12, 14]);
        assert_eq!(subsampled(size, 2), ImageSize::new(3, 2));
        assert_eq!(subsample(&values, size, 1), values);
    }

    #[test]
    fn a_stride_keeps_the_width_within_its_limit() {
        for (width, max_width, stride) in
            [(640, 320, 2), (641, 320, 3), (320, 320, 1), (8, 320, 1), (8, 0, 8)]
        {
            assert_eq!(stride_for(width, max_width), stride, "{width} in {max_width}");
        }
    }
}
