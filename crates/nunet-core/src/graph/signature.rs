//! Inputs and outputs of a model file: names, element types, shapes.

use std::fmt;

/// The element type of a tensor, named as ONNX names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names are the documentation")]
pub enum ElementType {
    Bool,
    Uint8,
    Int8,
    Uint16,
    Int16,
    Int32,
    Int64,
    Float16,
    Bfloat16,
    Float32,
    Float64,
    /// Strings, sub-byte integers, sequences and the like, which are not supported.
    Other,
}

impl ElementType {
    /// Bytes of one element; `None` without a fixed number of bytes.
    #[must_use]
    pub fn bytes(self) -> Option<usize> {
        match self {
            Self::Bool | Self::Uint8 | Self::Int8 => Some(1),
            Self::Uint16 | Self::Int16 | Self::Float16 | Self::Bfloat16 => Some(2),
            Self::Int32 | Self::Float32 => Some(4),
            Self::Int64 | Self::Float64 => Some(8),
            Self::Other => None,
        }
    }

    /// The name in messages and in `inspect --json`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::Uint8 => "uint8",
            Self::Int8 => "int8",
            Self::Uint16 => "uint16",
            Self::Int16 => "int16",
            Self::Int32 => "int32",
            Self::Int64 => "int64",
            Self::Float16 => "float16",
            Self::Bfloat16 => "bfloat16",
            Self::Float32 => "float32",
            Self::Float64 => "float64",
            Self::Other => "an unsupported type",
        }
    }
}

impl fmt::Display for ElementType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// One input or output of a model file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TensorSpec {
    /// The tensor's name in the file.
    pub name: String,
    /// Its element type.
    pub element: ElementType,
    /// Its dimensions; -1 for an open one.
    pub shape: Vec<i64>,
}

impl TensorSpec {
    /// Its size in bytes; `None` if a dimension is open, the type has no size, or the product overflows.
    #[must_use]
    pub fn bytes(&self) -> Option<usize> {
        self.shape
            .iter()
            .try_fold(self.element.bytes()?, |bytes, &dim| bytes.checked_mul(usize::try_from(dim).ok()?))
    }

    /// Type and shape without the name: `float32 [1, 3, 480, 640]`.
    #[must_use]
    pub fn kind(&self) -> String {
        kind(self.element, &self.shape)
    }
}

/// Type and shape for messages.
pub(crate) fn kind(element: ElementType, shape: &[i64]) -> String {
    let dims: Vec<String> =
        shape.iter().map(|&dim| if dim < 0 { "?".to_owned() } else { dim.to_string() }).collect();
    format!("{element} [{}]", dims.join(", "))
}

/// All inputs and outputs of a model file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Signature {
    /// Its inputs, in the file's order.
    pub inputs: Vec<TensorSpec>,
    /// Its outputs, in the file's order.
    pub outputs: Vec<TensorSpec>,
}
