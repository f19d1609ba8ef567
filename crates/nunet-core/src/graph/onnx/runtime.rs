//! The ONNX Runtime library: loaded by path, once for the life of the process.

use std::borrow::Cow;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use nunet_types::Hint;
use ort::environment::Environment;
use ort::logging::LogLevel;

use super::{Provider, library};
use crate::error_kind::ErrorKind;

/// The process's ONNX Runtime: ort allows one environment for the life of a process.
static LOADED: Mutex<Option<Runtime>> = Mutex::new(None);

/// A loaded ONNX Runtime. Clones are handles to the same one.
#[derive(Clone)]
pub struct Runtime {
    library: PathBuf,
    version: String,
    environment: Environment,
}

impl Runtime {
    /// Loads the library at `library`, or gives another handle to it where it is loaded already.
    ///
    /// A process can have one ONNX Runtime for its life: the library cannot be unloaded while threads of its own run.
    /// A load that fails leaves nothing behind, so that another path can be tried.
    ///
    /// # Errors
    /// A path that is missing or not a plain file, a file that is no shared library, a shared library that is not
    /// ONNX Runtime, one that is too old, and another one than the process has loaded before.
    pub fn load(library: &Path) -> Result<Self, RuntimeError> {
        let library = plain_file(library)?;
        let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(runtime) = loaded.as_ref().filter(|runtime| runtime.library == library) {
            return Ok(runtime.clone());
        }
        // Before what is loaded already is mentioned: what is wrong with this one is the better answer.
        let version = library::version(&library)?;
        match &*loaded {
            Some(runtime) => Err(RuntimeError::AnotherLoaded { library, loaded: runtime.library.clone() }),
            None => Ok(loaded.insert(Self::start(library, version)?).clone()),
        }
    }

    fn start(library: PathBuf, version: String) -> Result<Self, RuntimeError> {
        let failed = |reason: String| RuntimeError::Start { library: library.clone(), reason };
        // ONNX Runtime writes to stderr by default; what matters of it comes back as an error as well.
        let environment = ort::init_from(&library)
            .map_err(|error| failed(error.to_string()))?
            .with_name("nunet")
            .with_telemetry(false)
            .with_logger(Arc::new(|_, _, _, _, _| {}))
            .build()
            .map_err(|error| failed(error.to_string()))?;
        environment.set_log_level(LogLevel::Error);
        Ok(Self { library, version, environment })
    }

    pub(super) fn environment(&self) -> &Environment {
        &self.environment
    }

    /// The providers that start on this machine without long preparations, those that [`Provider::Auto`] tries, best first.
    #[must_use]
    pub fn providers(&self) -> Vec<Provider> {
        Provider::AUTOMATIC.into_iter().filter(|provider| provider.works(self, NonZeroUsize::MIN)).collect()
    }

    /// What [`Provider::Auto`] means with this library on this machine.
    #[must_use]
    pub fn best_provider(&self) -> Provider {
        Provider::Auto.resolve(self, NonZeroUsize::MIN).unwrap_or(Provider::Cpu)
    }

    /// The library's path, with links resolved.
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

/// `path` with links resolved, so that ort does not search for it beside the executable, and a pipe is not opened.
fn plain_file(path: &Path) -> Result<PathBuf, RuntimeError> {
    let missing = |source| RuntimeError::Missing { library: path.to_owned(), source };
    let library = path.canonicalize().map_err(missing)?;
    let is_file = library.metadata().map_err(missing)?.is_file();
    if is_file { Ok(library) } else { Err(RuntimeError::NotAFile { library }) }
}

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
    #[error("`{}` is not a shared library for this machine: {reason}", library.display())]
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
        reason: String,
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
