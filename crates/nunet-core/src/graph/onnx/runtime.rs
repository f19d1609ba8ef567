//! The ONNX Runtime library: loaded by path, once for the life of the process.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use ort::environment::Environment;
use ort::logging::LogLevel;

use super::error::RuntimeError;
use super::library;
use super::provider::ProviderError;
use crate::graph::Provider;

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
    /// Loads the library at `library`, or returns another handle to it if it is loaded already.
    ///
    /// A process can have one ONNX Runtime for its life: the library cannot be unloaded while threads of its
    /// own run. After a failed load, another path can be tried.
    ///
    /// # Errors
    /// A path that is missing or not a plain file, a file that is no shared library, a shared library that is
    /// not ONNX Runtime, one that is too old, and another one than the process has loaded before.
    pub fn load(library: &Path) -> Result<Self, RuntimeError> {
        let library = plain_file(library)?;
        let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(runtime) = loaded.as_ref().filter(|runtime| runtime.library == library) {
            return Ok(runtime.clone());
        }
        // Checked before the library that is loaded already, because an error about this file is more useful.
        let version = library::version(&library)?;
        match &*loaded {
            Some(runtime) => Err(RuntimeError::AnotherLoaded { library, loaded: runtime.library.clone() }),
            None => Ok(loaded.insert(Self::start(library, version)?).clone()),
        }
    }

    fn start(library: PathBuf, version: String) -> Result<Self, RuntimeError> {
        let failed = |reason: String| RuntimeError::Start { library: library.clone(), reason: reason.into() };
        // ONNX Runtime logs to stderr by default; errors are also returned.
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

    /// The providers that start on this machine without long preparations, those that [`Provider::Auto`]
    /// tries, best first.
    #[must_use]
    pub fn providers(&self) -> Vec<Provider> {
        Provider::AUTOMATIC
            .into_iter()
            .filter(|provider| provider.works(&self.environment, NonZeroUsize::MIN))
            .collect()
    }

    /// The provider that [`Provider::Auto`] selects with this library on this machine.
    #[must_use]
    pub fn best_provider(&self) -> Provider {
        self.resolve(Provider::Auto, NonZeroUsize::MIN).unwrap_or(Provider::Cpu)
    }

    /// `provider`, or the best one for [`Provider::Auto`].
    ///
    /// # Errors
    /// A named provider that does not register.
    pub(in crate::graph) fn resolve(
        &self,
        provider: Provider,
        threads: NonZeroUsize,
    ) -> Result<Provider, ProviderError> {
        provider.resolve(&self.environment, threads)
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

/// `path` with links resolved, so that ort does not search for it beside the executable, and a pipe is not
/// opened.
fn plain_file(path: &Path) -> Result<PathBuf, RuntimeError> {
    let missing = |source| RuntimeError::Missing { library: path.to_owned(), source };
    let library = path.canonicalize().map_err(missing)?;
    let is_file = library.metadata().map_err(missing)?.is_file();
    if is_file { Ok(library) } else { Err(RuntimeError::NotAFile { library }) }
}
