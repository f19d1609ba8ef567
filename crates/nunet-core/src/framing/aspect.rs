//! What is done with images of another aspect ratio.

use nunet_types::ImageSize;

/// Aspect ratios that differ by at most this share are treated as equal: the image is stretched. 5:4
/// (1280x1024) is beyond it.
pub const MAX_STRETCH: f64 = 0.05;

/// What is done with images whose aspect ratio differs from the network's by more than [`MAX_STRETCH`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum AspectMode {
    /// The network sees the largest centered part of its aspect ratio. Results cover only this part.
    #[default]
    Crop,
    /// The whole image is squeezed to the network's size. Results cover the whole image, but are less
    /// accurate.
    Stretch,
    /// The whole image is scaled by one factor and padded with the mean color of training. Results cover the
    /// whole image.
    Letterbox,
}

impl AspectMode {
    /// The name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Crop => "crop",
            Self::Stretch => "stretch",
            Self::Letterbox => "letterbox",
        }
    }
}

/// Whether the aspect ratios differ by more than [`MAX_STRETCH`].
pub(super) fn differs(a: ImageSize, b: ImageSize) -> bool {
    let aspect = |size: ImageSize| f64::from(size.width) / f64::from(size.height);
    let ratio = aspect(a) / aspect(b);
    ratio.max(1.0 / ratio) > 1.0 + MAX_STRETCH
}
