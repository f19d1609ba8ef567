//! The errors of a graph: its files, their wiring, or a run.

use std::borrow::Cow;
use std::path::PathBuf;

use nunet_types::Hint;

use crate::error_kind::ErrorKind;
use crate::graph::{ElementType, ManifestError, OnnxMessage, Provider, WiringError};
use crate::model::ModelError;

/// Why a graph cannot be loaded or run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GraphError {
    /// A file that cannot be read.
    #[error("cannot read `{}`", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A path that is not a regular file.
    #[error("`{}` is not a file", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// An empty file.
    #[error("`{}` is empty", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A Git LFS pointer instead of the file.
    #[error("`{}` is a pointer of Git LFS, not the file itself", path.display())]
    LfsPointer {
        /// The file.
        path: PathBuf,
    },
    /// A file larger than ONNX Runtime loads.
    #[error("`{}` has {bytes} bytes, at most {most} are supported", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The limit.
        most: u64,
    },
    /// A file with a hash that is not allowed.
    #[error("`{}` has changed since it was checked", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// A file that ONNX Runtime does not load.
    #[error("cannot load the model `{}`: {reason}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// ONNX Runtime's message.
        reason: OnnxMessage,
    },
    /// A provider that is not available.
    #[error("provider `{provider}` is not available: {reason}")]
    Provider {
        /// The requested provider.
        provider: Provider,
        /// ONNX Runtime's message.
        reason: OnnxMessage,
    },
    /// An invalid manifest.
    #[error("cannot use the staged graph `{}`", path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ManifestError,
    },
    /// Stages that do not fit together, or not to the contract.
    #[error("the stages of `{}` do not fit together", path.display())]
    Wiring {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<WiringError>,
    },
    /// An invalid description.
    #[error("cannot use the description of the model `{}`", path.display())]
    Description {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ModelError,
    },
    /// A foreign network that does not run at the size in its sidecar.
    #[error("the model `{}` does not run on an image of {width}x{height}, the size in its sidecar: {reason}", path.display())]
    ImageSize {
        /// The file.
        path: PathBuf,
        /// Image width, pixels.
        width: u32,
        /// Image height, pixels.
        height: u32,
        /// ONNX Runtime's message.
        reason: OnnxMessage,
    },
    /// A foreign network that rounds the size in its sidecar.
    #[error(
        "the model `{}` returns depth of {depth_width}x{depth_height} for an image of {width}x{height}, the size in its \
         sidecar: it cuts off part of the image",
        path.display()
    )]
    DepthSize {
        /// The file.
        path: PathBuf,
        /// Image width, pixels.
        width: u32,
        /// Image height, pixels.
        height: u32,
        /// Width of the depth, pixels.
        depth_width: u32,
        /// Height of the depth, pixels.
        depth_height: u32,
    },
    /// Memory for a tensor that ONNX Runtime does not accept.
    #[error("cannot create a tensor for `{tensor}`: {reason}")]
    Tensor {
        /// `stage.tensor` or `image`.
        tensor: String,
        /// ONNX Runtime's message.
        reason: OnnxMessage,
    },
    /// A caller's buffer of another length than the tensor.
    #[error("the buffer for `{tensor}` has {got} elements, expected {expected}")]
    Buffer {
        /// `image`, `depth`, `labels`, `confidence` or, in a pipeline, `cloud`.
        tensor: &'static str,
        /// Elements given.
        got: usize,
        /// Elements needed.
        expected: usize,
    },
    /// A caller's buffer of another element type than the tensor.
    #[error("the buffer for `{tensor}` is {got}, expected {expected}")]
    ElementType {
        /// `image`, `depth`, `labels` or `confidence`.
        tensor: &'static str,
        /// Given.
        got: ElementType,
        /// Needed.
        expected: ElementType,
    },
    /// `every` for a stage that the graph does not have.
    #[error("no stage is named `{stage}`; the stages are {stages}")]
    UnknownStage {
        /// The requested stage.
        stage: String,
        /// The existing stages.
        stages: String,
    },
    /// `every` twice for one stage.
    #[error("`every` is given twice for stage `{stage}`: {first} and {second}")]
    EveryTwice {
        /// The stage.
        stage: String,
        /// The first number.
        first: u32,
        /// The second number.
        second: u32,
    },
    /// Labels were requested of a graph without labels.
    #[error("the graph has no labels")]
    NoLabels,
    /// The confidence was requested of a graph without one.
    #[error("the graph has no confidence")]
    NoConfidence,
    /// A run that failed.
    #[error("stage `{stage}` failed: {reason}")]
    Run {
        /// The stage.
        stage: String,
        /// ONNX Runtime's message.
        reason: OnnxMessage,
    },
}

impl GraphError {
    /// The kind of the error.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Wiring { .. } | Self::UnknownStage { .. } | Self::EveryTwice { .. } => ErrorKind::Wiring,
            Self::Provider { .. } => ErrorKind::Runtime,
            Self::Buffer { .. } | Self::ElementType { .. } | Self::NoLabels | Self::NoConfidence => {
                ErrorKind::Buffer
            }
            Self::Run { .. } | Self::Tensor { .. } => ErrorKind::Inference,
            _ => ErrorKind::Model,
        }
    }

    /// ONNX Runtime's message as it wrote it, for a log of details. `Display` shows the part that matters.
    #[must_use]
    pub fn details(&self) -> Option<&str> {
        match self {
            Self::Model { reason, .. }
            | Self::Provider { reason, .. }
            | Self::ImageSize { reason, .. }
            | Self::Tensor { reason, .. }
            | Self::Run { reason, .. } => Some(reason.full()),
            _ => None,
        }
    }
}

impl Hint for GraphError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::LfsPointer { .. } => "fetch it: `git lfs pull`".into(),
            Self::Changed { .. } => "start again when nothing writes the file any more".into(),
            Self::Model { reason, .. } => return hint_of_load(reason.full()).map(Cow::Borrowed),
            Self::Provider { .. } => "use `auto`, the best provider that this ONNX Runtime has".into(),
            Self::ImageSize { .. } => {
                "set `size = [h, w]` in the sidecar to sides that the network accepts, often multiples of 14 or 32".into()
            }
            Self::DepthSize { depth_width, depth_height, .. } => format!(
                "set `size = [{depth_height}, {depth_width}]` in the sidecar, or other multiples of the network's step"
            )
            .into(),
            Self::EveryTwice { .. } => "name each stage once".into(),
            Self::UnknownStage { .. } => {
                "name one of the stages; only a staged graph, such as wnet_c.toml, has several".into()
            }
            _ => return None,
        })
    }
}

/// The hints for the most frequent messages of ONNX Runtime.
fn hint_of_load(reason: &str) -> Option<&'static str> {
    if reason.contains("rotobuf") || reason.contains("ModelProto") {
        Some("the file is damaged or is not an ONNX model; download or export it again")
    } else if reason.contains("xternal data") {
        Some("keep the weights inside the file (torch.onnx.export with external_data=False)")
    } else {
        None
    }
}
