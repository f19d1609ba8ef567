//! What kind of failure an error is, for programs that tell them apart by type: Python's exceptions.

use std::error::Error as StdError;
use std::io;

use nunet_core::camera::{CalibrationError, CameraError};
use nunet_core::frame::FrameError;
use nunet_core::graph::GraphError;
use nunet_core::pipeline::PipelineError;

use crate::exit::{BadArguments, NotFound};

/// A kind of failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Something named is not there.
    NotFound,
    /// A value that is none of those that can be.
    Argument,
    /// A model file that cannot be used, or a network that did not run.
    Model,
    /// Stages of a graph that do not fit together.
    Wiring,
    /// Intrinsics or a lens that no camera has, or that do not fit the picture.
    Camera,
    /// Everything else.
    Other,
}

/// The child process that tests models has refused one.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub(crate) struct Refused {
    pub(crate) fault: Fault,
    pub(crate) message: String,
}

impl Fault {
    const ALL: [Self; 6] =
        [Self::NotFound, Self::Argument, Self::Model, Self::Wiring, Self::Camera, Self::Other];

    /// The kind of an error: what its chain of causes tells of it.
    #[must_use]
    pub fn of(error: &anyhow::Error) -> Self {
        if let Some(Refused { fault, .. }) = error.downcast_ref() {
            return *fault;
        }
        if error.chain().any(is_missing) {
            return Self::NotFound;
        }
        let kinds = error.chain().filter_map(kind);
        // A context says `bad arguments` of what is wrong with a camera as well: the cause knows better.
        kinds.last().or_else(|| error.is::<BadArguments>().then_some(Self::Argument)).unwrap_or(Self::Other)
    }

    /// How the child process calls it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::NotFound => "not found",
            Self::Argument => "argument",
            Self::Model => "model",
            Self::Wiring => "wiring",
            Self::Camera => "camera",
            Self::Other => "other",
        }
    }

    /// The fault of that name; of a child that says none, the model's.
    pub(crate) fn named(name: &str) -> Self {
        Self::ALL.into_iter().find(|fault| fault.name() == name).unwrap_or(Self::Model)
    }
}

fn is_missing(cause: &(dyn StdError + 'static)) -> bool {
    let missing = |error: &io::Error| error.kind() == io::ErrorKind::NotFound;
    cause.is::<NotFound>() || cause.downcast_ref().is_some_and(missing)
}

/// What one link of the chain says, where it says something.
fn kind(cause: &(dyn StdError + 'static)) -> Option<Fault> {
    if let Some(error) = cause.downcast_ref::<PipelineError>() {
        return Some(match error {
            PipelineError::Graph(error) => of_graph(error),
            PipelineError::Camera(_) => Fault::Camera,
            PipelineError::SelfTest(_) => Fault::Model,
            _ => Fault::Other,
        });
    }
    if let Some(error) = cause.downcast_ref::<GraphError>() {
        return Some(of_graph(error));
    }
    if cause.is::<CameraError>() || cause.is::<CalibrationError>() {
        return Some(Fault::Camera);
    }
    cause.is::<FrameError>().then_some(Fault::Argument)
}

fn of_graph(error: &GraphError) -> Fault {
    match error {
        GraphError::Wiring { .. } | GraphError::UnknownStage { .. } => Fault::Wiring,
        // Of the library and this machine, not of the model.
        GraphError::Provider { .. } => Fault::Other,
        _ => Fault::Model,
    }
}

#[cfg(test)]
mod tests {
    use anyhow::Context as _;

    use super::*;

    fn empty() -> GraphError {
        GraphError::Empty { path: "m.onnx".into() }
    }

    #[test]
    fn a_fault_is_told_by_the_cause_whatever_context_it_has() {
        let camera = CameraError::Size { width: 0, height: 0 };
        let wrapped = Err::<(), _>(camera).context(BadArguments("cannot use the calibration".into()));
        assert_eq!(Fault::of(&wrapped.unwrap_err()), Fault::Camera);
        assert_eq!(Fault::of(&PipelineError::from(empty()).into()), Fault::Model);
        assert_eq!(Fault::of(&anyhow::Error::from(empty()).context("while loading")), Fault::Model);
        assert_eq!(Fault::of(&BadArguments("no such camera".into()).into()), Fault::Argument);
        assert_eq!(Fault::of(&anyhow::anyhow!("the disk is full")), Fault::Other);
    }

    #[test]
    fn what_is_not_there_is_not_found_at_every_depth() {
        let missing = io::Error::from(io::ErrorKind::NotFound);
        assert_eq!(Fault::of(&anyhow::Error::from(missing).context("cannot read `a`")), Fault::NotFound);
        assert_eq!(Fault::of(&NotFound("no model `a`".into()).into()), Fault::NotFound);
        let denied = io::Error::from(io::ErrorKind::PermissionDenied);
        assert_eq!(Fault::of(&denied.into()), Fault::Other);
    }

    #[test]
    fn a_fault_survives_the_way_out_of_the_child_process() {
        for fault in Fault::ALL {
            assert_eq!(Fault::named(fault.name()), fault);
        }
        let refused = Refused { fault: Fault::Wiring, message: "the graph does not fit together".into() };
        assert_eq!(Fault::of(&refused.into()), Fault::Wiring);
    }
}
