//! A builder of small ONNX files, for tests that need a network whose answer can be computed by hand.
//!
//! ```
//! use nunet_testkit::onnx::{OnnxElement, ModelBuilder};
//!
//! let bytes = ModelBuilder::new()
//!     .input("rgb", OnnxElement::U8, &[1, 2, 2, 3])
//!     .node("Cast", &["rgb"], &["depth"], &[("to", 1i64.into())])
//!     .output("depth", OnnxElement::F32, &[1, 2, 2, 3])
//!     .metadata("nunet.version", "1")
//!     .to_bytes();
//! assert!(!bytes.is_empty());
//! ```

mod proto;

use std::path::Path;

use prost::Message;

use proto::{
    AttributeProto, Dimension, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, StringStringEntryProto,
    TensorProto, TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto,
};

/// ONNX IR version 8 with opset 17: old enough for every runtime that the project loads.
const IR_VERSION: i64 = 8;
const OPSET: i64 = 17;

/// The element types that the tests use, with their numbers in `TensorProto.DataType`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum OnnxElement {
    /// 32-bit float.
    F32 = 1,
    /// Unsigned byte.
    U8 = 2,
    /// Signed 64-bit integer.
    I64 = 7,
    /// 64-bit float.
    F64 = 11,
}

/// A node's attribute: made with `.into()` from an integer, a float, a text or a list of integers.
#[derive(Clone, Debug)]
pub enum Attribute {
    /// `INT`.
    Int(i64),
    /// `FLOAT`.
    Float(f32),
    /// `STRING`.
    Text(String),
    /// `INTS`.
    Ints(Vec<i64>),
}

impl From<i64> for Attribute {
    fn from(value: i64) -> Self {
        Self::Int(value)
    }
}

impl From<f32> for Attribute {
    fn from(value: f32) -> Self {
        Self::Float(value)
    }
}

impl From<&str> for Attribute {
    fn from(value: &str) -> Self {
        Self::Text(value.to_owned())
    }
}

impl<const N: usize> From<[i64; N]> for Attribute {
    fn from(value: [i64; N]) -> Self {
        Self::Ints(value.to_vec())
    }
}

/// A builder of an ONNX file. Nothing is checked, because some tests need invalid files.
#[derive(Clone, Debug)]
pub struct ModelBuilder {
    model: ModelProto,
    graph: GraphProto,
}

impl Default for ModelBuilder {
    fn default() -> Self {
        Self::new()
    }
}

impl ModelBuilder {
    /// An empty graph of opset 17.
    #[must_use]
    pub fn new() -> Self {
        let model = ModelProto {
            ir_version: IR_VERSION,
            producer_name: "nunet-testkit".to_owned(),
            opset_import: vec![OperatorSetIdProto { domain: String::new(), version: OPSET }],
            ..ModelProto::default()
        };
        Self { model, graph: GraphProto { name: "test".to_owned(), ..GraphProto::default() } }
    }

    /// Another opset than 17.
    #[must_use]
    pub fn opset(mut self, version: i64) -> Self {
        self.model.opset_import = vec![OperatorSetIdProto { domain: String::new(), version }];
        self
    }

    /// An input of the graph; a dimension of -1 is left open, as exporters do for the batch.
    #[must_use]
    pub fn input(mut self, name: &str, element: OnnxElement, shape: &[i64]) -> Self {
        self.graph.input.push(value_info(name, element, shape));
        self
    }

    /// An output of the graph.
    #[must_use]
    pub fn output(mut self, name: &str, element: OnnxElement, shape: &[i64]) -> Self {
        self.graph.output.push(value_info(name, element, shape));
        self
    }

    /// A node; nodes must come in an order in which each one's inputs are already there.
    #[must_use]
    pub fn node(
        mut self,
        op_type: &str,
        inputs: &[&str],
        outputs: &[&str],
        attributes: &[(&str, Attribute)],
    ) -> Self {
        self.graph.node.push(NodeProto {
            input: inputs.iter().map(|&name| name.to_owned()).collect(),
            output: outputs.iter().map(|&name| name.to_owned()).collect(),
            name: format!("{op_type}_{}", self.graph.node.len()),
            op_type: op_type.to_owned(),
            attribute: attributes.iter().map(|(name, value)| attribute(name, value)).collect(),
        });
        self
    }

    /// A constant of floats.
    #[must_use]
    pub fn constant_f32(self, name: &str, shape: &[i64], values: &[f32]) -> Self {
        self.constant(name, OnnxElement::F32, shape, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    /// A constant of integers, as shapes and axes are.
    #[must_use]
    pub fn constant_i64(self, name: &str, shape: &[i64], values: &[i64]) -> Self {
        self.constant(name, OnnxElement::I64, shape, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    /// A constant of floats that lie in another file, as exporters do with large weights.
    #[must_use]
    pub fn constant_in_file(mut self, name: &str, shape: &[i64], location: &str) -> Self {
        self.graph.initializer.push(TensorProto {
            dims: shape.to_vec(),
            data_type: OnnxElement::F32 as i32,
            name: name.to_owned(),
            external_data: vec![entry("location", location)],
            data_location: 1,
            ..TensorProto::default()
        });
        self
    }

    fn constant(mut self, name: &str, element: OnnxElement, shape: &[i64], raw_data: Vec<u8>) -> Self {
        self.graph.initializer.push(TensorProto {
            dims: shape.to_vec(),
            data_type: element as i32,
            name: name.to_owned(),
            raw_data,
            ..TensorProto::default()
        });
        self
    }

    /// An entry of `metadata_props`; a later one of the same key replaces the earlier one.
    #[must_use]
    pub fn metadata(mut self, key: &str, value: &str) -> Self {
        self.model.metadata_props.retain(|entry| entry.key != key);
        self.model.metadata_props.push(entry(key, value));
        self
    }

    /// The file's bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let model = ModelProto { graph: Some(self.graph.clone()), ..self.model.clone() };
        model.encode_to_vec()
    }

    /// Writes the file.
    ///
    /// # Panics
    /// Where it cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) {
        let path = path.as_ref();
        std::fs::write(path, self.to_bytes())
            .unwrap_or_else(|error| panic!("cannot write `{}`: {error}", path.display()));
    }
}

fn entry(key: &str, value: &str) -> StringStringEntryProto {
    StringStringEntryProto { key: key.to_owned(), value: value.to_owned() }
}

fn value_info(name: &str, element: OnnxElement, shape: &[i64]) -> ValueInfoProto {
    let dim = shape
        .iter()
        .map(|&size| match size {
            -1 => Dimension { dim_value: None, dim_param: Some("any".to_owned()) },
            size => Dimension { dim_value: Some(size), dim_param: None },
        })
        .collect();
    let tensor_type = TensorTypeProto { elem_type: element as i32, shape: Some(TensorShapeProto { dim }) };
    ValueInfoProto { name: name.to_owned(), r#type: Some(TypeProto { tensor_type: Some(tensor_type) }) }
}

fn attribute(name: &str, value: &Attribute) -> AttributeProto {
    let mut proto = AttributeProto { name: name.to_owned(), ..AttributeProto::default() };
    match value {
        Attribute::Float(float) => (proto.f, proto.r#type) = (Some(*float), 1),
        Attribute::Int(int) => (proto.i, proto.r#type) = (Some(*int), 2),
        Attribute::Text(text) => (proto.s, proto.r#type) = (Some(text.clone().into_bytes()), 3),
        Attribute::Ints(ints) => (proto.ints, proto.r#type) = (ints.clone(), 7),
    }
    proto
}
