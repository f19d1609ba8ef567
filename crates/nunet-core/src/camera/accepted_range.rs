//! The accepted range of intrinsics.

use std::ops::RangeInclusive;

/// The focal lengths of lenses, in image sides. Others are a mistake of units. The widest lenses without a
/// fisheye's distortion see 130 degrees (0.23), a fisheye whose circle does not fill the image has about
/// 0.15; 0.1 is a pinhole of 157 degrees. A telescope, or a small part of a telephoto image, sees 0.2 degrees
/// (300).
const FOCAL_PER_SIDE: RangeInclusive<f64> = 0.1..=300.0;

/// The principal point may lie outside a cropped image, by at most this many of its sides.
const MAX_CENTER_OUTSIDE: f64 = 1.0;

/// The smallest and the largest accepted value of an intrinsic, pixels, for an image side along it.
pub(super) fn accepted_range(name: &str, side: u32) -> (f64, f64) {
    let side = f64::from(side);
    match name {
        "fx" | "fy" => (FOCAL_PER_SIDE.start() * side, FOCAL_PER_SIDE.end() * side),
        _ => (-MAX_CENTER_OUTSIDE * side - 0.5, (1.0 + MAX_CENTER_OUTSIDE) * side - 0.5),
    }
}
