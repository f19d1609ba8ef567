//! ONNX Runtime: the only folder that names `ort`.
//!
//! [`library`] inspects a shared library, [`runtime`] loads it, [`provider`] registers execution providers,
//! [`model`] loads a file, [`tensor`] lends memory, [`session`] runs. Only `library`, `tensor` and `session`
//! have unsafe code.

mod error;
mod library;
mod model;
mod provider;
mod runtime;
mod session;
mod tensor;

pub use error::RuntimeError;
pub(super) use model::OnnxModel;
pub use runtime::Runtime;
pub(super) use session::Session;
pub(super) use tensor::{CallerTensor, Lent, LentTensors, OwnTensors};
