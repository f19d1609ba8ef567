//! The kinds of errors, for exit codes and Python's exceptions.

use nunet_core::ErrorKind;
use nunet_core::graph::GraphError;
use nunet_core::pipeline::PipelineError;

/// A kind of failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum EngineErrorKind {
    /// A model or a file that does not exist.
    NotFound,
    /// A value out of its range.
    Argument,
    /// A model file that cannot be used, or a network that did not run.
    Model,
    /// Stages of a graph that do not fit together.
    Wiring,
    /// Intrinsics or a lens that are invalid or do not fit the image.
    Camera,
    /// ONNX Runtime's library: missing, unusable, or without the requested execution provider.
    Library,
    /// A shutdown was requested before the model was loaded.
    Stopped,
    /// Everything else: an operation of the system failed.
    Other,
}

impl EngineErrorKind {
    const ALL: [Self; 8] = [
        Self::NotFound,
        Self::Argument,
        Self::Model,
        Self::Wiring,
        Self::Camera,
        Self::Library,
        Self::Stopped,
        Self::Other,
    ];

    pub(crate) fn of_pipeline(error: &PipelineError) -> Self {
        match error {
            PipelineError::Graph(error) => Self::of_graph(error),
            PipelineError::Camera(_) => Self::Camera,
            PipelineError::Scale(_) => Self::Argument,
            PipelineError::Filter(error) if error.kind() == ErrorKind::Argument => Self::Argument,
            PipelineError::SelfTest(_) => Self::Model,
            _ => Self::Other,
        }
    }

    pub(crate) fn of_graph(error: &GraphError) -> Self {
        match error {
            GraphError::Wiring { .. } => Self::Wiring,
            GraphError::UnknownStage { .. } | GraphError::EveryTwice { .. } => Self::Argument,
            GraphError::Provider { .. } => Self::Library,
            _ => Self::Model,
        }
    }

    /// The name by which the child process of the model check reports it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::NotFound => "not_found",
            Self::Argument => "argument",
            Self::Model => "model",
            Self::Wiring => "wiring",
            Self::Camera => "camera",
            Self::Library => "library",
            Self::Stopped => "stopped",
            Self::Other => "other",
        }
    }

    /// The kind of that name; [`EngineErrorKind::Model`] for any other.
    pub(crate) fn named(name: &str) -> Self {
        Self::ALL.into_iter().find(|kind| kind.name() == name).unwrap_or(Self::Model)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_is_passed_from_the_child_process() {
        for kind in EngineErrorKind::ALL {
            assert_eq!(EngineErrorKind::named(kind.name()), kind);
        }
    }
}
