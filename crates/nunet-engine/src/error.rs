//! The errors of opening and running a model.

use std::borrow::Cow;
use std::error::Error as StdError;
use std::io;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use nunet_core::camera::{CalibrationError, CameraError};
use nunet_core::filter::FilterError;
use nunet_core::frame::FrameError;
use nunet_core::graph::{GraphError, RuntimeError};
use nunet_core::pipeline::PipelineError;
use nunet_types::{Hint, counted, printable};

use crate::error_kind::EngineErrorKind;
use crate::text::{MODELS_VARIABLE, ONNX_RUNTIME_VERSION};

/// Why a model could not be opened or run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EngineError {
    /// Neither an existing path nor the name of a bundled model.
    #[error("no model `{}`: no such file{}", name.display(), if *is_bare { ", and no bundled model of that name" } else { "" })]
    ModelNotFound {
        /// What was asked for.
        name: PathBuf,
        /// Whether it is a bare name, which is looked up among the bundled models.
        is_bare: bool,
        /// The bundled models, by name.
        bundled: Vec<String>,
        /// The folders that were searched.
        folders: Vec<PathBuf>,
    },
    /// The library that was named does not exist.
    #[error("no ONNX Runtime library at `{}`", path.display())]
    NoLibraryAt {
        /// The path.
        path: PathBuf,
    },
    /// No library in any of the usual places.
    #[error("cannot find ONNX Runtime's shared library; searched{places}")]
    LibraryNotFound {
        /// One place a line, with its name.
        places: String,
    },
    /// More threads than this machine could run.
    #[error("{} on {}; expected at most {most}", counted(threads.get(), "thread"), counted(cores.get(), "core"))]
    TooManyThreads {
        /// What was asked for.
        threads: NonZeroUsize,
        /// The number of cores that the process may use.
        cores: NonZeroUsize,
        /// The largest number.
        most: usize,
    },
    /// Filters that cannot be combined.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// The library is not usable.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The model does not load.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// The pipeline around a model could not be made, or did not run.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The self-test failed: the outputs on this machine differ from those at export, or the model does not
    /// run.
    #[error("cannot use `{}`: the self-test failed", path.display())]
    SelfTest {
        /// The model.
        path: PathBuf,
        /// The difference.
        source: PipelineError,
    },
    /// The model crashed the child process that loaded it first, now or at an earlier start.
    #[error("cannot use `{}`: the model check, a first load in a child process, {how}", path.display())]
    Crashed {
        /// The model.
        path: PathBuf,
        /// How the child ended.
        how: String,
        /// Where the verdict is kept.
        verdict: Option<PathBuf>,
    },
    /// The child process that checks models reported an error of the model.
    #[error("{message}")]
    Refused {
        /// The error's kind.
        kind: EngineErrorKind,
        /// What failed.
        message: String,
        /// The causes that it reported.
        source: Option<Box<dyn StdError + Send + Sync>>,
        /// The hint.
        hint: Option<String>,
        /// What only a log of details should show.
        details: Option<String>,
    },
    /// The child process took too long.
    #[error("the model check of `{}` took longer than {seconds} s", path.display())]
    CheckTimedOut {
        /// The model.
        path: PathBuf,
        /// The limit.
        seconds: u64,
    },
    /// The child process was ended from outside.
    #[error("the child process of the model check was ended from outside ({status})")]
    CheckInterrupted {
        /// Exit code or signal.
        status: i32,
    },
    /// There is no program to run the model check.
    #[error("cannot check the model: no `nunetd` beside this program or in PATH")]
    NoChecker,
    /// A shutdown was requested before the model was loaded.
    #[error("stopped before the first frame")]
    Stopped,
    /// An operation of the system failed.
    #[error("{action}")]
    System {
        /// The failed operation: `cannot ...`.
        action: String,
        /// Why it failed.
        source: io::Error,
    },
}

impl EngineError {
    /// ONNX Runtime's message as it wrote it, for a log of details. `Display` shows the part that matters.
    #[must_use]
    pub fn details(&self) -> Option<&str> {
        match self {
            Self::Refused { details, .. } => details.as_deref(),
            Self::Graph(error) | Self::Pipeline(PipelineError::Graph(error)) => error.details(),
            Self::SelfTest { source: PipelineError::Graph(error), .. } => error.details(),
            _ => None,
        }
    }

    /// What kind of failure it is.
    #[must_use]
    pub fn kind(&self) -> EngineErrorKind {
        match self {
            Self::ModelNotFound { .. } => EngineErrorKind::NotFound,
            Self::TooManyThreads { .. } | Self::Filter(_) => EngineErrorKind::Argument,
            Self::NoLibraryAt { .. } | Self::LibraryNotFound { .. } | Self::Runtime(_) => {
                EngineErrorKind::Library
            }
            Self::Graph(error) => EngineErrorKind::of_graph(error),
            Self::Pipeline(error) => EngineErrorKind::of_pipeline(error),
            Self::SelfTest { .. } | Self::Crashed { .. } => EngineErrorKind::Model,
            Self::Refused { kind, .. } => *kind,
            Self::Stopped => EngineErrorKind::Stopped,
            Self::CheckTimedOut { .. }
            | Self::CheckInterrupted { .. }
            | Self::NoChecker
            | Self::System { .. } => EngineErrorKind::Other,
        }
    }

    pub(crate) fn system(action: impl Into<String>) -> impl FnOnce(io::Error) -> Self {
        let action = action.into();
        move |source| Self::System { action, source }
    }
}

/// ONNX Runtime's message as it wrote it, from the first error of a chain that has one; see
/// [`EngineError::details`].
#[must_use]
pub fn details_of(error: &(dyn StdError + 'static)) -> Option<String> {
    let mut chain = std::iter::successors(Some(error), |&error| error.source());
    chain.find_map(|cause| {
        let engine = cause.downcast_ref::<EngineError>().and_then(EngineError::details);
        let pipeline = || match cause.downcast_ref::<PipelineError>()? {
            PipelineError::Graph(error) => error.details(),
            _ => None,
        };
        let graph = || cause.downcast_ref::<GraphError>()?.details();
        engine.or_else(pipeline).or_else(graph).map(str::to_owned)
    })
}

impl Hint for EngineError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::ModelNotFound { is_bare, bundled, folders, .. } => {
                model_hint(*is_bare, bundled, folders).into()
            }
            Self::NoLibraryAt { .. } => {
                format!("name the file itself, such as `libonnxruntime.so.{ONNX_RUNTIME_VERSION}`").into()
            }
            Self::LibraryNotFound { .. } => format!(
                "run `cargo xtask setup` in a checkout, run `pip install onnxruntime=={ONNX_RUNTIME_VERSION}`, or set ORT_DYLIB_PATH \
                 to the library's path"
            )
            .into(),
            Self::TooManyThreads { .. } => "use one thread per core: it is the fastest and the default".into(),
            Self::Crashed { verdict, .. } => match verdict {
                Some(verdict) => format!(
                    "the file is damaged or hostile: get it again from a source you trust, or remove `{}` to check it \
                     again",
                    verdict.display()
                )
                .into(),
                None => "the file is damaged or hostile: get it again from a source you trust".into(),
            },
            Self::Refused { hint, .. } => return hint.clone().map(Cow::Owned),
            Self::CheckTimedOut { .. } => "try again when the machine is less busy".into(),
            Self::CheckInterrupted { .. } => {
                "start again; if it happens again, look for out-of-memory messages of the system".into()
            }
            Self::NoChecker => {
                "install nunetd, or describe this program's installation (`Installation::describe`)".into()
            }
            // Transparent: these are not in the chain of causes themselves.
            Self::Filter(error) => return error.hint(),
            Self::Graph(error) => return error.hint(),
            Self::Runtime(error) => return error.hint(),
            Self::Pipeline(error) => return error.hint(),
            // The cause has a hint of its own.
            Self::SelfTest { .. }
            | Self::Stopped
            | Self::System { .. } => return None,
        })
    }

    fn is_usage(&self) -> bool {
        matches!(self.kind(), EngineErrorKind::NotFound | EngineErrorKind::Argument)
    }
}

/// The hint for a model that was not found.
fn model_hint(is_bare: bool, bundled: &[String], folders: &[PathBuf]) -> String {
    if !is_bare {
        return "pass an existing path, or the bare name of a bundled model, such as `wnet_c.onnx`"
            .to_owned();
    }
    if !bundled.is_empty() {
        return format!("use one of the bundled models: {}", printable::one_line(&bundled.join(", ")));
    }
    let searched: Vec<_> = folders.iter().map(|folder| format!("`{}`", folder.display())).collect();
    format!(
        "pass a path, or set {MODELS_VARIABLE} to the folder of the bundled models; searched {}",
        searched.join(", ")
    )
}

impl EngineErrorKind {
    /// The kind of one error, if it is one of the engine's or the pipeline's. Its causes are not checked.
    #[must_use]
    pub fn of(error: &(dyn StdError + 'static)) -> Option<Self> {
        if let Some(error) = error.downcast_ref::<EngineError>() {
            return Some(error.kind());
        }
        if let Some(error) = error.downcast_ref::<PipelineError>() {
            return Some(Self::of_pipeline(error));
        }
        if let Some(error) = error.downcast_ref::<GraphError>() {
            return Some(Self::of_graph(error));
        }
        if error.is::<RuntimeError>() {
            return Some(Self::Library);
        }
        if error.is::<CameraError>() || error.is::<CalibrationError>() {
            return Some(Self::Camera);
        }
        if error.is::<FrameError>() {
            return Some(Self::Argument);
        }
        let missing = |error: &io::Error| error.kind() == io::ErrorKind::NotFound;
        error.downcast_ref().is_some_and(missing).then_some(Self::NotFound)
    }

    /// The kind of an error with its causes: that of the innermost one that has a kind, whatever context it
    /// has.
    #[must_use]
    pub fn of_chain(error: &(dyn StdError + 'static)) -> Option<Self> {
        let chain = std::iter::successors(Some(error), |&error| error.source());
        chain.filter_map(Self::of).last()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_has_the_kind_of_what_failed() {
        let empty = || GraphError::Empty { path: "m.onnx".into() };
        let unknown = GraphError::UnknownStage { stage: "a".into(), stages: "`b`".into() };
        let decimation = FilterError::TooSmall { width: 4, height: 4, factor: 8 };
        let missing = io::Error::from(io::ErrorKind::NotFound);
        let cases: [(Box<dyn StdError>, EngineErrorKind); 7] = [
            (Box::new(empty()), EngineErrorKind::Model),
            (Box::new(PipelineError::from(empty())), EngineErrorKind::Model),
            (Box::new(EngineError::from(empty())), EngineErrorKind::Model),
            (Box::new(unknown), EngineErrorKind::Argument),
            (Box::new(PipelineError::from(decimation)), EngineErrorKind::Argument),
            (Box::new(CameraError::Size { width: 0, height: 0 }), EngineErrorKind::Camera),
            (Box::new(missing), EngineErrorKind::NotFound),
        ];
        for (error, kind) in cases {
            assert_eq!(EngineErrorKind::of(&*error), Some(kind), "{error}");
        }
        let denied = io::Error::from(io::ErrorKind::PermissionDenied);
        assert_eq!(EngineErrorKind::of(&denied), None);
    }

    #[test]
    fn the_innermost_cause_with_a_kind_decides() {
        let camera = CameraError::Size { width: 0, height: 0 };
        let tested = EngineError::SelfTest { path: "m.onnx".into(), source: camera.into() };
        let read = |kind: io::ErrorKind| EngineError::system("cannot read `m.onnx`")(kind.into());
        for (error, own, of_chain) in [
            (tested, EngineErrorKind::Model, EngineErrorKind::Camera),
            (read(io::ErrorKind::NotFound), EngineErrorKind::Other, EngineErrorKind::NotFound),
            (read(io::ErrorKind::PermissionDenied), EngineErrorKind::Other, EngineErrorKind::Other),
        ] {
            assert_eq!(EngineErrorKind::of(&error), Some(own), "{error}");
            assert_eq!(EngineErrorKind::of_chain(&error), Some(of_chain), "{error}");
        }
        assert_eq!(EngineErrorKind::of_chain(&io::Error::other("the disk is full")), None);
    }
}
