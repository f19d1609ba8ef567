//! Why ONNX Runtime could not be loaded.

use std::borrow::Cow;
use std::path::PathBuf;

use nunet_types::Hint;

use crate::error_kind::ErrorKind;
use crate::graph::OnnxMessage;

/// Why ONNX Runtime could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RuntimeError {
    /// No file, or one that cannot be read.
    #[error("no ONNX Runtime at `{}`", library.display())]
    Missing {
        /// The path.
        library: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not a regular file.
    #[error("`{}` is not a file", library.display())]
    NotAFile {
        /// The path.
        library: PathBuf,
    },
    /// A file that the dynamic linker does not load.
    #[error("cannot load `{}` as a shared library: {reason}", library.display())]
    NotALibrary {
        /// The file.
        library: PathBuf,
        /// The linker's message.
        reason: String,
    },
    /// Another shared library.
    #[error("`{}` is not ONNX Runtime: it has no `OrtGetApiBase`", library.display())]
    NotOnnxRuntime {
        /// The file.
        library: PathBuf,
    },
    /// Older than the interface that this library is built for.
    #[error("`{}` is ONNX Runtime {version}, expected 1.{minimum} or newer", library.display())]
    TooOld {
        /// The file.
        library: PathBuf,
        /// Its version.
        version: String,
        /// The oldest supported minor version.
        minimum: u32,
    },
    /// The process has loaded another one.
    #[error("this process has already loaded ONNX Runtime from `{}` and cannot load `{}`", loaded.display(), library.display())]
    AnotherLoaded {
        /// The path asked for.
        library: PathBuf,
        /// The path in use.
        loaded: PathBuf,
    },
    /// It was loaded, but does not initialize.
    #[error("cannot initialize ONNX Runtime from `{}`: {reason}", library.display())]
    Start {
        /// The file.
        library: PathBuf,
        /// Its message.
        reason: OnnxMessage,
    },
}

impl RuntimeError {
    /// [`ErrorKind::Runtime`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Runtime
    }
}

impl Hint for RuntimeError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        None
    }
}
