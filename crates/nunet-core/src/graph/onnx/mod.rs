//! ONNX Runtime, and nothing else: the only folder that names `ort`.

mod provider;
mod runtime;

pub use provider::{Provider, UnknownProvider};
pub use runtime::{Runtime, RuntimeError};
