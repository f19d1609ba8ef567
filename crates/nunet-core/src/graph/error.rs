//! What can go wrong with a graph.

use std::path::PathBuf;

use crate::graph::{ElementType, ManifestError, Provider, WiringError};
use crate::model::ModelError;

/// What is wrong with a graph: its files, their wiring, or a run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GraphError {
    /// A file cannot be read.
    #[error("cannot read `{}`", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A path that is not a plain file.
    #[error("`{}` is not a file", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// The file is empty.
    #[error("`{}` is empty", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file is larger than any model that ONNX Runtime loads.
    #[error("`{}` has `{bytes}` bytes; a model file has at most `{most}`", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The limit.
        most: u64,
    },
    /// The file is none of those that may be loaded.
    #[error(
        "`{}` is not the file that was tested: it has changed since\nhint: start again when nothing writes it any more",
        path.display()
    )]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// ONNX Runtime does not take the file.
    #[error("cannot load the model `{}`: {reason}{hint}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// ONNX Runtime's words.
        reason: String,
        /// A second line with the way out, where one is known.
        hint: &'static str,
    },
    /// The chosen provider is not to be had.
    #[error(
        "provider `{provider}` is not available: {reason}\nhint: `auto` takes the best one that this ONNX Runtime has"
    )]
    Provider {
        /// What was asked for.
        provider: Provider,
        /// ONNX Runtime's words.
        reason: String,
    },
    /// The staged graph's file is wrong.
    #[error("cannot use the staged graph `{}`", path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ManifestError,
    },
    /// The stages do not fit together, or not to the contract.
    #[error("the graph `{}` does not fit together", path.display())]
    Wiring {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<WiringError>,
    },
    /// What the file says of itself is wrong.
    #[error("the model `{}` does not describe itself as it should", path.display())]
    Description {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ModelError,
    },
    /// ONNX Runtime refused memory for a tensor.
    #[error("cannot make a tensor for `{tensor}`: {reason}")]
    Tensor {
        /// `stage.tensor` or `image`.
        tensor: String,
        /// ONNX Runtime's words.
        reason: String,
    },
    /// A caller's buffer has another length than the tensor.
    #[error("the buffer for `{tensor}` holds `{got}` elements, but the graph has `{expected}`")]
    Buffer {
        /// `image`, `depth` or `labels`.
        tensor: &'static str,
        /// Elements given.
        got: usize,
        /// Elements needed.
        expected: usize,
    },
    /// A caller's buffer has another element type than the tensor.
    #[error("the buffer for `{tensor}` holds {got}, but the graph has {expected}")]
    ElementType {
        /// `image`, `depth` or `labels`.
        tensor: &'static str,
        /// Given.
        got: ElementType,
        /// Needed.
        expected: ElementType,
    },
    /// `every` for a stage that the graph does not have.
    #[error("no stage is named `{stage}`; the stages are {stages}")]
    UnknownStage {
        /// What was asked for.
        stage: String,
        /// What there is.
        stages: String,
    },
    /// Labels were asked of a graph that has none.
    #[error("the graph gives no labels")]
    NoLabels,
    /// A run failed.
    #[error("stage `{stage}` failed: {reason}")]
    Run {
        /// The stage.
        stage: String,
        /// ONNX Runtime's words.
        reason: String,
    },
}
