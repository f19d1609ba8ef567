//! Recognizes 16-bit images that use only the lower bits.
//!
//! Drivers store 10 and 12 bits of a sensor in `mono16` and `bayer_*16` without shifting them. As in ROS's
//! `cv_bridge`, 65535 is white here, so such an image is almost black. It is not stretched by its own range,
//! because that would change the brightness of the same wall from frame to frame.

use crate::convert::{RawImageView, RawLayout};

/// Values below this are black at any bit depth.
const BLACK: u16 = 32;
/// An image that is not black and whose values are all below this uses only the lower bits.
const DIM: u16 = u16::MAX / 8;

/// Looks at the images of a source until one is not black.
#[derive(Debug, Default)]
pub(crate) struct BitDepthCheck {
    is_done: bool,
}

impl BitDepthCheck {
    /// The largest value of the first image that is not black, if it is far below 65535.
    pub(crate) fn dim_maximum(&mut self, image: &RawImageView<'_>) -> Option<u16> {
        let is_wide =
            matches!(image.layout, RawLayout::Channels { bytes: 2, .. } | RawLayout::Mosaic { bytes: 2, .. });
        if self.is_done || !is_wide {
            return None;
        }
        let row_bytes = image.layout.min_stride(image.size.width) as usize;
        let rows = image.bytes.chunks(image.row_stride.max(1) as usize).take(image.size.height as usize);
        let values = rows.flat_map(|row| row[..row_bytes.min(row.len())].as_chunks().0);
        let maximum = values.map(|&bytes| u16::from_le_bytes(bytes)).max().unwrap_or(0);
        self.is_done = maximum >= BLACK;
        (self.is_done && maximum < DIM).then_some(maximum)
    }
}

#[cfg(test)]
mod tests {
    use nunet_core::frame::PixelFormat;

    use super::*;
    use crate::convert::Bayer;

    const MONO16: RawLayout = RawLayout::Channels { format: PixelFormat::Mono8, channels: 1, bytes: 2 };
    const BAYER16: RawLayout = RawLayout::Mosaic { pattern: Bayer::RGGB, bytes: 2 };

    /// Of images of two pixels in a row of three.
    fn found(check: &mut BitDepthCheck, layout: RawLayout, values: [u16; 2]) -> Option<u16> {
        let bytes: Vec<u8> =
            [values[0], values[1], u16::MAX].iter().flat_map(|value| value.to_le_bytes()).collect();
        check.dim_maximum(&RawImageView { layout, size: (2, 1).into(), row_stride: 6, bytes: &bytes })
    }

    #[test]
    fn ten_and_twelve_bits_are_recognized_once_and_sixteen_are_not() {
        for layout in [MONO16, BAYER16] {
            for maximum in [255, 1023, 4095] {
                let mut check = BitDepthCheck::default();
                assert_eq!(found(&mut check, layout, [0, 5]), None, "a black image says nothing");
                assert_eq!(found(&mut check, layout, [7, maximum]), Some(maximum));
                assert_eq!(found(&mut check, layout, [7, maximum]), None, "once");
            }
            let mut check = BitDepthCheck::default();
            assert_eq!(found(&mut check, layout, [7, 40_000]), None);
            assert_eq!(found(&mut check, layout, [7, 1023]), None, "a dark scene later");
        }
        let rgb8 = RawLayout::Direct(PixelFormat::Rgb8);
        assert_eq!(found(&mut BitDepthCheck::default(), rgb8, [7, 1023]), None);
    }
}
