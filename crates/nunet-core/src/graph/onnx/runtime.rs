//! The ONNX Runtime library: loaded by path, once for the life of the process.

use std::path::{Path, PathBuf};

/// A loaded ONNX Runtime. Clones are handles to the same one.
#[derive(Clone)]
pub struct Runtime {
    library: PathBuf,
    version: String,
}

impl Runtime {
    /// Loads the library at `library`, or gives another handle to it where it is loaded already.
    ///
    /// A process can have one ONNX Runtime for its life: the library cannot be unloaded while threads of its own run.
    ///
    /// # Errors
    /// A path that is missing or not a plain file, a file that is no shared library, a shared library that is not
    /// ONNX Runtime, one that is too old, and another one than the process has loaded before.
    pub fn load(library: &Path) -> Result<Self, RuntimeError> {
        todo!("{}", library.display())
    }

    /// Where the library lies, with links resolved.
    #[must_use]
    pub fn library(&self) -> &Path {
        &self.library
    }

    /// The library's version, such as `1.31.1`.
    #[must_use]
    pub fn version(&self) -> &str {
        &self.version
    }
}

/// Why ONNX Runtime could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RuntimeError {
    /// Nothing there, or nothing that may be read.
    #[error("no ONNX Runtime at `{}`", library.display())]
    Missing {
        /// The path.
        library: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A folder, a pipe, a device.
    #[error("`{}` is not a file", library.display())]
    NotAFile {
        /// The path.
        library: PathBuf,
    },
    /// A file that the dynamic linker does not take.
    #[error("`{}` is not a shared library for this machine: {reason}", library.display())]
    NotALibrary {
        /// The file.
        library: PathBuf,
        /// The linker's words.
        reason: String,
    },
    /// A shared library of something else.
    #[error("`{}` is not ONNX Runtime: it has no `OrtGetApiBase`", library.display())]
    NotOnnxRuntime {
        /// The file.
        library: PathBuf,
    },
    /// Older than the interface that this program is built for.
    #[error("`{}` is ONNX Runtime `{version}`, but `1.{minimum}` or newer is needed", library.display())]
    TooOld {
        /// The file.
        library: PathBuf,
        /// Its version.
        version: String,
        /// The oldest minor version that will do.
        minimum: u32,
    },
    /// The process has one already.
    #[error("this process has already loaded ONNX Runtime from `{}`, and cannot load `{}` as well", loaded.display(), library.display())]
    AnotherLoaded {
        /// The path asked for.
        library: PathBuf,
        /// The path in use.
        loaded: PathBuf,
    },
    /// It was loaded, but does not start.
    #[error("ONNX Runtime of `{}` does not start: {reason}", library.display())]
    Start {
        /// The file.
        library: PathBuf,
        /// Its words.
        reason: String,
    },
}
