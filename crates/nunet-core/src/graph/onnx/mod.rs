//! ONNX Runtime: the only folder that names `ort`.
//!
//! [`library`] inspects a shared library, [`runtime`] loads it, [`provider`] chooses an execution provider, [`model`]
//! loads a file, [`tensor`] lends memory, [`session`] runs. Only `library`, `tensor` and `session` have unsafe code.

mod library;
mod model;
mod provider;
mod runtime;
mod session;
mod tensor;

pub(super) use model::Model;
pub use provider::{Provider, UnknownProvider};
pub use runtime::{Runtime, RuntimeError};
pub(super) use session::Session;
pub(super) use tensor::{CallerTensor, Lent, LentTensors, OwnTensors};
