//! The one place where the pipeline's points meet the contract's: the same 16 bytes under two names, because
//! neither crate depends on the other.
#![expect(unsafe_code, reason = "a slice changes the name of its element, not its bytes")]

use std::mem::{align_of, offset_of, size_of};

use nunet_core::cloud::CloudPoint;
use nunet_ipc::Point;

macro_rules! same_place {
    ($($field:ident),+) => { $(assert!(offset_of!(CloudPoint, $field) == offset_of!(Point, $field));)+ };
}

const _: () = {
    assert!(size_of::<CloudPoint>() == size_of::<Point>() && align_of::<CloudPoint>() == align_of::<Point>());
    same_place!(x, y, z, b, g, r, label);
};

/// The contract's points as the pipeline fills them.
pub(crate) fn cloud_points_mut(points: &mut [Point]) -> &mut [CloudPoint] {
    // SAFETY: both are `repr(C)` structs of f32 and u8 with the same size, alignment and offsets (asserted above);
    // every bit pattern of either is valid, and the exclusive borrow moves into the result.
    unsafe { std::slice::from_raw_parts_mut(points.as_mut_ptr().cast(), points.len()) }
}

/// The contract's points as files are written from them.
pub(crate) fn cloud_points(points: &[Point]) -> &[CloudPoint] {
    // SAFETY: as above, shared.
    unsafe { std::slice::from_raw_parts(points.as_ptr().cast(), points.len()) }
}
