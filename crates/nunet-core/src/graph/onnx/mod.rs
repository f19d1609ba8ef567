//! ONNX Runtime, and nothing else: the only folder that names `ort`.
//!
//! [`library`] looks into a shared library, [`runtime`] loads it, [`provider`] chooses who computes, [`model`] loads
//! a file, [`tensor`] lends memory, [`session`] runs. Unsafe code is in `library`, `tensor` and `session` alone.

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
