//! Structs whose layout is part of the contract, and the table of their fields.

/// One field of a contract struct, as `contract --json` prints it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// The field's name.
    pub name: &'static str,
    /// Bytes from the start of the struct.
    pub offset: usize,
    /// The type of one element: `u8`, `u32`, `u64`, `i64`, `f32` or `f64`.
    pub kind: &'static str,
    /// How many elements there are; 1 for a plain number.
    pub count: usize,
    /// What it means: the documentation of the field, a line for each of its lines.
    pub doc: &'static str,
}

/// A type that a field of a contract struct may have: fixed-width numbers and arrays of them, nothing else.
pub(crate) trait FieldType {
    const KIND: &'static str;
    const COUNT: usize = 1;
}

impl FieldType for u8 {
    const KIND: &'static str = "u8";
}
impl FieldType for u32 {
    const KIND: &'static str = "u32";
}
impl FieldType for u64 {
    const KIND: &'static str = "u64";
}
impl FieldType for i64 {
    const KIND: &'static str = "i64";
}
impl FieldType for f32 {
    const KIND: &'static str = "f32";
}
impl FieldType for f64 {
    const KIND: &'static str = "f64";
}
impl<T: FieldType, const N: usize> FieldType for [T; N] {
    const KIND: &'static str = T::KIND;
    const COUNT: usize = N * T::COUNT;
}

/// Declares a `repr(C)` struct together with its table of fields, so that the two cannot differ. Does not compile
/// when the struct is not exactly `$bytes` long or when the compiler would have to insert padding.
macro_rules! contract_struct {
    ($(#[$doc:meta])* $name:ident, $bytes:literal bytes { $($(#[doc = $field_doc:literal])* $visibility:vis $field:ident: $kind:ty,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[repr(C)]
        pub struct $name { $($(#[doc = $field_doc])* $visibility $field: $kind,)+ }

        impl $name {
            /// Every field in the order of their offsets, the reserved tail included.
            pub const FIELDS: &'static [$crate::layout::Field] = &[$($crate::layout::Field {
                name: stringify!($field),
                offset: std::mem::offset_of!($name, $field),
                kind: <$kind as $crate::layout::FieldType>::KIND,
                count: <$kind as $crate::layout::FieldType>::COUNT,
                doc: concat!($($field_doc, "\n"),*),
            },)+];
        }

        const _: () = {
            assert!(size_of::<$name>() == $bytes, "the struct must be exactly as long as the contract says");
            assert!(0 $(+ size_of::<$kind>())+ == $bytes, "no implicit padding: the fields must fill the struct");
        };
    };
}
pub(crate) use contract_struct;

/// The text in a zero-filled array: up to the first zero byte, with anything that is not UTF-8 replaced.
pub(crate) fn text(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end])
}

/// Fills a fixed array with a text: cut at a character's boundary if it is too long, zeros behind it.
pub(crate) fn set_text(bytes: &mut [u8], text: &str) {
    let end = text.floor_char_boundary(bytes.len());
    bytes.fill(0);
    bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_that_is_too_long_is_cut_between_characters() {
        let mut bytes = [0xff; 4];
        set_text(&mut bytes, "abcß");
        assert_eq!(bytes, *b"abc\0");
        assert_eq!(text(&bytes), "abc");
    }

    #[test]
    fn a_text_that_fills_the_array_needs_no_final_zero() {
        let mut bytes = [0; 4];
        set_text(&mut bytes, "abcd");
        assert_eq!(text(&bytes), "abcd");
    }
}
