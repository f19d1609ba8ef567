//! The serial graph: N components in series, from an image to depth, labels, and the tensors between them.
//!
//! Read in this order: [`manifest`] (what a user wrote) -> [`load`] (the files) -> [`wiring`] (the check that
//! the stages fit) -> [`state`] (recurrent state) -> [`serial`] (the run). Only the folder [`onnx`] uses ONNX
//! Runtime.

mod depth_resize;
mod element_bytes;
mod error;
mod io;
mod load;
mod manifest;
mod message;
mod onnx;
mod provider;
mod run_tensors;
mod serial;
mod signature;
mod state;
mod times;
mod trial;
mod wiring;

pub(crate) use depth_resize::DepthResize;
pub use error::GraphError;
pub use io::{GraphInput, GraphOptions, GraphOutputs, GraphReport, StageInfo, TensorView};
pub use load::{model_files, model_hashes};
pub use manifest::{MAX_STAGES, Manifest, ManifestError};
pub use message::OnnxMessage;
pub use nunet_types::Quality;
pub use onnx::{Runtime, RuntimeError};
pub use provider::{Provider, UnknownProvider};
pub use serial::SerialGraph;
pub use signature::{ElementType, Signature, TensorSpec};
pub use times::{MAX_TIMED_STAGES, StageTimes};
pub use wiring::WiringError;
