//! The errors of a pipeline.

use std::borrow::Cow;

use nunet_types::Hint;

use crate::camera::CameraError;
use crate::cloud::CloudError;
use crate::error_kind::ErrorKind;
use crate::filter::FilterError;
use crate::graph::GraphError;
use crate::model::SelfTestMismatch;
use crate::scale::ScaleError;

/// Why a pipeline cannot be built, or a frame cannot be processed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The graph failed.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// The camera cannot be scaled to the network's size.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A filter does not fit the network's size, or a buffer has the wrong size.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// A buffer of the cloud has the wrong size.
    #[error(transparent)]
    Cloud(#[from] CloudError),
    /// A scale that does not fit the network.
    #[error(transparent)]
    Scale(#[from] ScaleError),
    /// The self-test failed: outputs differ from those recorded at export.
    #[error("self-test failed: outputs differ from those recorded at export")]
    SelfTest(#[from] SelfTestMismatch),
}

impl PipelineError {
    /// The kind of the error.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Graph(error) => error.kind(),
            Self::Camera(error) => error.kind(),
            Self::Filter(error) => error.kind(),
            Self::Cloud(error) => error.kind(),
            Self::Scale(error) => error.kind(),
            Self::SelfTest(error) => error.kind(),
        }
    }
}

impl Hint for PipelineError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::Graph(error) => error.hint(),
            Self::Camera(error) => error.hint(),
            Self::Filter(error) => error.hint(),
            Self::Cloud(_) => None,
            Self::Scale(error) => error.hint(),
            // The mismatch is the source, and has its own hint.
            Self::SelfTest(_) => None,
        }
    }
}
