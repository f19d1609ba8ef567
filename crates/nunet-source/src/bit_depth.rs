//! Recognizes 16-bit images that use only the lower bits.
//!
//! Drivers store 10 and 12 bits of a sensor in `mono16`, `bayer_*16` and PNG files without shifting them. As
//! in ROS's `cv_bridge`, 65535 is white here, so such an image is almost black. It is not stretched by its
//! own range, because that would change the brightness of the same wall from frame to frame.

use std::borrow::Cow;
use std::fmt;

use nunet_types::Hint;
use tracing::warn;

#[cfg(feature = "mcap")]
use crate::convert::{RawImageView, RawLayout};

/// Values below this are black at any bit depth.
const BLACK: u16 = 32;
/// An image that is not black and whose values are all below this uses only the lower bits.
const DIM: u16 = u16::MAX / 8;
/// How many channels have colors; a fourth one is alpha.
#[cfg(feature = "mcap")]
const COLORS: usize = 3;

/// 16-bit images that use only the lower bits: a warning with a hint.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the 16-bit images of {place} are almost black: at most {maximum} of 65535")]
pub struct DimImages {
    /// The topic or file.
    place: String,
    maximum: u16,
}

impl Hint for DimImages {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some("scale the values to 16 bits before storing them: 10 bits by 64, 12 bits by 16".into())
    }
}

/// Looks at the images of a source until one is not black.
#[derive(Debug, Default)]
pub struct BitDepthCheck {
    is_done: bool,
}

impl BitDepthCheck {
    /// Logs the warning of [`find`](Self::find).
    pub fn check(&mut self, maximum: impl FnOnce() -> Option<u16>, place: fmt::Arguments<'_>) {
        if let Some(found) = self.find(maximum, place) {
            warn!(hint = found.hint().as_deref(), "{found}");
        }
    }

    /// Whether the first image that is not black uses only the lower bits. `maximum` is the largest of its
    /// 16-bit values, `None` for other images; `place` is the topic or file.
    pub fn find(
        &mut self,
        maximum: impl FnOnce() -> Option<u16>,
        place: fmt::Arguments<'_>,
    ) -> Option<DimImages> {
        self.dim_maximum(maximum).map(|maximum| DimImages { place: place.to_string(), maximum })
    }

    fn dim_maximum(&mut self, maximum: impl FnOnce() -> Option<u16>) -> Option<u16> {
        let maximum = if self.is_done { None } else { maximum() }?;
        self.is_done = maximum >= BLACK;
        (self.is_done && maximum < DIM).then_some(maximum)
    }
}

/// The largest 16-bit value of an image, without alpha; `None` for other images.
#[cfg(feature = "mcap")]
pub(crate) fn maximum(image: &RawImageView<'_>) -> Option<u16> {
    let channels = match image.layout {
        RawLayout::Channels { channels, bytes: 2, .. } => channels,
        RawLayout::Mosaic { bytes: 2, .. } => 1,
        _ => return None,
    };
    let row_bytes = image.layout.min_stride(image.size.width) as usize;
    let rows = image.bytes.chunks(image.row_stride.max(1) as usize).take(image.size.height as usize);
    let pixels = rows.flat_map(|row| row[..row_bytes.min(row.len())].chunks_exact(2 * channels));
    let values = pixels.flat_map(|pixel| pixel.as_chunks().0.iter().take(COLORS));
    values.map(|&bytes| u16::from_le_bytes(bytes)).max()
}

#[cfg(all(test, feature = "mcap"))]
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
        let image = RawImageView { layout, size: (2, 1).into(), row_stride: 6, bytes: &bytes };
        check.dim_maximum(|| maximum(&image))
    }

    #[test]
    fn alpha_is_not_brightness() {
        let layout = RawLayout::Channels { format: PixelFormat::Rgb8, channels: 4, bytes: 2 };
        let bytes: Vec<u8> =
            [7_u16, 1023, 5, u16::MAX].iter().flat_map(|value| value.to_le_bytes()).collect();
        let image = RawImageView { layout, size: (1, 1).into(), row_stride: 8, bytes: &bytes };
        assert_eq!(maximum(&image), Some(1023));
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
