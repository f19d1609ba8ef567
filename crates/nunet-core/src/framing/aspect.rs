//! When an image has another aspect ratio than the network.

use nunet_types::ImageSize;

/// Aspect ratios that differ by at most this share are treated as equal: the image is stretched. 5:4
/// (1280x1024) is beyond it.
pub const MAX_STRETCH: f64 = 0.05;

/// Whether the aspect ratios differ by more than [`MAX_STRETCH`].
pub(super) fn differs(a: ImageSize, b: ImageSize) -> bool {
    let aspect = |size: ImageSize| f64::from(size.width) / f64::from(size.height);
    let ratio = aspect(a) / aspect(b);
    ratio.max(1.0 / ratio) > 1.0 + MAX_STRETCH
}
