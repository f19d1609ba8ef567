//! Structs whose byte layout is fixed, with a table of their fields: what other languages and
//! `contract --json` use.

// For the macro, in crates that do not depend on it themselves.
#[doc(hidden)]
pub use bytemuck;

/// One field of a struct with a fixed layout, as `contract --json` prints it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// The field's name.
    pub name: &'static str,
    /// Bytes from the start of the struct.
    pub offset: usize,
    /// The type of one element: `u8`, `u32`, `u64`, `i64`, `f32`, `f64`, or the name of another struct.
    pub kind: &'static str,
    /// How many elements there are; 1 for a single number.
    pub count: usize,
    /// The field's documentation, line by line.
    pub doc: &'static str,
}

/// A type that a field may have: fixed-width numbers, other structs of this kind, and arrays of them.
pub trait FieldType {
    /// The name of the element's type.
    const KIND: &'static str;
    /// How many elements there are.
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

/// Declares a `repr(C)` struct of plain data together with its table of fields, so that the two cannot
/// differ.
///
/// It does not compile when the struct is not exactly as long as stated, or when the compiler would insert
/// padding.
///
/// # Example: a record of 12 bytes
/// ```
/// nunet_types::contract_struct! {
///     /// A reading.
///     Reading, 12 bytes {
///         /// Counts up.
///         pub number: u32,
///         /// Both values.
///         pub values: [f32; 2],
///     }
/// }
/// let field = &Reading::FIELDS[1];
/// assert_eq!((field.name, field.offset, field.count), ("values", 4, 2));
/// ```
#[macro_export]
macro_rules! contract_struct {
    ($(#[$doc:meta])* $name:ident, $bytes:literal bytes {
        $($(#[doc = $field_doc:literal])* $visibility:vis $field:ident: $kind:ty,)+
    }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, $crate::layout::bytemuck::Pod, $crate::layout::bytemuck::Zeroable)]
        #[bytemuck(crate = "::nunet_types::layout::bytemuck")]
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
            assert!(size_of::<$name>() == $bytes, "the struct must be exactly as long as stated");
            assert!(0 $(+ size_of::<$kind>())+ == $bytes, "no implicit padding: the fields must fill the struct");
        };
    };
}
pub use contract_struct;
