#![expect(unsafe_code, reason = "views of bytes as numbers: the one place where bytes change their type")]
//! Plain data: what a payload's bytes may be looked at as.

use crate::block::Block64;
use crate::layout::contract_struct;
use crate::stats::StatsRecord;

/// Types whose every bit pattern is valid, that have no padding and point at nothing.
///
/// # Safety
/// Implement it only for `repr(C)` or `repr(transparent)` types (or primitive numbers) that have no padding, no
/// pointers and no invalid bit pattern (so no `bool`, no `char`, no enumeration), aligned to 64 bytes at most.
pub unsafe trait Plain: Copy + 'static {}

// SAFETY: plain numbers: no padding, no invalid bit pattern.
unsafe impl Plain for u8 {}
// SAFETY: as above.
unsafe impl Plain for u16 {}
// SAFETY: as above.
unsafe impl Plain for u32 {}
// SAFETY: as above; every bit pattern of a float is a float.
unsafe impl Plain for f32 {}
// SAFETY: bytes only.
unsafe impl Plain for Block64 {}
// SAFETY: `repr(C)`, numbers only, no padding (asserted by `contract_struct!`).
unsafe impl Plain for Point {}
// SAFETY: as above.
unsafe impl Plain for StatsRecord {}

contract_struct! {
    /// One point of a cloud, in the camera's optical frame: x right, y down, z forward.
    ///
    /// The same bytes are a ROS `PointCloud2` with fields `x y z` `FLOAT32`, `rgb` `FLOAT32` at 12, `label` `UINT8`
    /// at 15.
    Point, 16 bytes {
        /// Metres to the right; NaN where depth has no measurement.
        pub x: f32,
        /// Metres down.
        pub y: f32,
        /// Metres forward.
        pub z: f32,
        /// Blue.
        pub b: u8,
        /// Green.
        pub g: u8,
        /// Red.
        pub r: u8,
        /// The class; [`Point::NO_LABEL`] where there is none.
        pub label: u8,
    }
}

impl Point {
    /// The label of a point that no segmentation has seen.
    pub const NO_LABEL: u8 = 255;
}

/// Why bytes cannot be looked at as elements of a type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Misfit;

/// Bytes as a slice of plain elements.
pub(crate) fn cast<T: Plain>(bytes: &[u8]) -> Result<&[T], Misfit> {
    if !bytes.len().is_multiple_of(size_of::<T>()) || !bytes.as_ptr().cast::<T>().is_aligned() {
        return Err(Misfit);
    }
    // SAFETY: the pointer is aligned (checked), the length is a whole number of elements within the borrowed bytes
    // (checked), which stay borrowed as long as the result lives; any bytes are a valid `T` because it is `Plain`.
    Ok(unsafe { std::slice::from_raw_parts(bytes.as_ptr().cast(), bytes.len() / size_of::<T>()) })
}

/// Bytes as a mutable slice of plain elements.
pub(crate) fn cast_mut<T: Plain>(bytes: &mut [u8]) -> Result<&mut [T], Misfit> {
    if !bytes.len().is_multiple_of(size_of::<T>()) || !bytes.as_ptr().cast::<T>().is_aligned() {
        return Err(Misfit);
    }
    // SAFETY: as in `cast`, with the only reference to these bytes; without padding in `T`, writing elements leaves
    // every byte initialised.
    Ok(unsafe { std::slice::from_raw_parts_mut(bytes.as_mut_ptr().cast(), bytes.len() / size_of::<T>()) })
}

/// Plain elements as their bytes.
pub(crate) fn bytes_of_slice<T: Plain>(slice: &[T]) -> &[u8] {
    // SAFETY: `T` has no padding, so all its bytes are initialised; they stay borrowed as long as the result lives.
    unsafe { std::slice::from_raw_parts(slice.as_ptr().cast(), size_of_val(slice)) }
}

/// Plain elements as their bytes, to be written.
pub(crate) fn bytes_of_slice_mut<T: Plain>(slice: &mut [T]) -> &mut [u8] {
    // SAFETY: as above, with the only reference to these elements; any bytes written are valid elements.
    unsafe { std::slice::from_raw_parts_mut(slice.as_mut_ptr().cast(), size_of_val(slice)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_that_are_no_whole_number_of_elements_are_refused() {
        let aligned = [0_u32; 4];
        let bytes = bytes_of_slice(&aligned[..1]);
        assert!(cast::<f32>(bytes).is_ok());
        assert_eq!(cast::<f32>(&bytes[..3]), Err(Misfit));
    }

    #[test]
    fn bytes_that_are_not_aligned_are_refused() {
        let point = Point { x: 0.0, y: 0.0, z: 0.0, b: 0, g: 0, r: 0, label: 0 };
        assert_eq!(cast::<f32>(&bytes_of_slice(&[point])[1..5]), Err(Misfit));
    }
}
