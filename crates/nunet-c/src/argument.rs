#![expect(unsafe_code, reason = "texts and bytes come as bare pointers")]
//! Checks of arguments.

use std::ffi::{CStr, c_char, c_void};
use std::mem::MaybeUninit;
use std::time::Duration;

use nunet_ipc::{CameraName, Topic};
use nunet_types::printable;

use crate::status::Failure;

/// The timeout that never ends, `NUNET_FOREVER` in C.
pub(crate) const FOREVER_MS: u32 = u32::MAX;

/// The place of a result, filled with `empty` first, so that no failure leaves an old value in it.
pub(crate) fn place<'a, T>(
    pointer: Option<&'a mut MaybeUninit<T>>,
    name: &str,
    empty: T,
) -> Result<&'a mut T, Failure> {
    pointer.map(|place| place.write(empty)).ok_or_else(|| null(name))
}

/// Fills the place of an optional result.
pub(crate) fn fill<T>(pointer: Option<&mut MaybeUninit<T>>, value: T) {
    if let Some(place) = pointer {
        place.write(value);
    }
}

/// A string of the caller's.
///
/// # Safety
/// `pointer` is NULL or points to bytes that end with a zero byte and do not change until the result is
/// dropped.
pub(crate) unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Failure> {
    if pointer.is_null() {
        return Err(null(name));
    }
    // SAFETY: not NULL; the rest is the caller's promise.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|error| {
        let place = error.valid_up_to() + 1;
        Failure::argument(format!(
            "`{name}` is not UTF-8 at byte {place}: `{}`",
            printable::one_line(&text.to_string_lossy())
        ))
        .hint("pass texts in UTF-8")
    })
}

/// Elements of the caller's: bytes, coefficients.
///
/// # Safety
/// `pointer` is NULL or points to `count` elements that do not change until the result is dropped.
pub(crate) unsafe fn slice<'a, T>(pointer: *const T, count: usize, name: &str) -> Result<&'a [T], Failure> {
    if count == 0 {
        return Ok(&[]);
    }
    if pointer.is_null() {
        return Err(null(name));
    }
    if !pointer.is_aligned() || count.checked_mul(size_of::<T>()).is_none_or(|n| n > isize::MAX as usize) {
        return Err(Failure::argument(format!(
            "`{name}` is not an array of {count} elements: not aligned, or too long"
        ))
        .hint("pass the array itself and how many elements it has, not how many bytes"));
    }
    // SAFETY: not NULL, aligned, not longer than the address space; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// A camera's name.
///
/// # Safety
/// As [`text`].
pub(crate) unsafe fn camera(pointer: *const c_char) -> Result<CameraName, Failure> {
    // SAFETY: the caller's promise is this function's.
    let name = unsafe { text(pointer, "camera") }?;
    Ok(CameraName::new(name)?)
}

/// A number that stands for a word of the contract.
pub(crate) fn word<T: TryFrom<u32>>(value: u32, name: &str) -> Result<T, Failure>
where
    T::Error: std::fmt::Display,
{
    T::try_from(value).map_err(|unknown| {
        Failure::argument(format!("`{name}`: {unknown}")).hint("use the constants of nunet.h")
    })
}

/// The topics in a sum of `NUNET_BIT_...`.
pub(crate) fn topics(bits: u32) -> Result<Vec<Topic>, Failure> {
    let known = (1 << Topic::ALL.len()) - 1;
    if bits == 0 || bits & !known != 0 {
        return Err(Failure::argument(format!(
            "`topic_bits` is `{bits:#x}`, expected a sum of bits from 0x1 to {known:#x}"
        ))
        .hint("combine topics like NUNET_BIT_DEPTH | NUNET_BIT_LABELS"));
    }
    Ok(Topic::ALL.iter().copied().filter(|topic| bits & (1 << *topic as u32) != 0).collect())
}

/// A timeout.
pub(crate) fn timeout(milliseconds: u32) -> Duration {
    if milliseconds == FOREVER_MS { Duration::MAX } else { Duration::from_millis(milliseconds.into()) }
}

/// A pointer for C to the first byte of a slice.
pub(crate) fn pointer_to(bytes: &[u8]) -> *const c_void {
    bytes.as_ptr().cast()
}

fn null(name: &str) -> Failure {
    Failure::argument(format!("`{name}` is NULL"))
        .hint("pass the address of a variable, or a text or an array")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_that_is_not_utf_8_is_refused_with_its_place() {
        // SAFETY: a literal.
        let failure = unsafe { text(c"caf\xe9".as_ptr(), "camera") }.unwrap_err();
        assert!(failure.message.starts_with("`camera` is not UTF-8 at byte 4: "), "{}", failure.message);
    }

    #[test]
    fn bits_that_stand_for_no_topic_are_refused() {
        assert_eq!(topics(0b10_0110).unwrap(), [Topic::Depth, Topic::Labels, Topic::Stats]);
        for bits in [0, 1 << 8, u32::MAX] {
            assert!(topics(bits).is_err(), "{bits:#x}");
        }
    }

    #[test]
    fn invalid_arrays_are_refused() {
        let aligned = [0_u64; 2];
        let odd = aligned.as_ptr().wrapping_byte_add(1);
        // SAFETY: nothing is read from an array that is refused.
        let failure = unsafe { slice(odd, 1, "x") }.unwrap_err();
        assert!(failure.hint.is_some(), "{}", failure.message);
        // SAFETY: as above.
        assert!(unsafe { slice(aligned.as_ptr(), usize::MAX / 2, "x") }.is_err());
        // SAFETY: as above.
        assert!(unsafe { slice(std::ptr::null::<u64>(), 1, "x") }.is_err());
        // SAFETY: no element is promised.
        assert!(unsafe { slice(std::ptr::null::<u64>(), 0, "x") }.is_ok_and(<[u64]>::is_empty));
    }
}
