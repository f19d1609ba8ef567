//! The options of the engine.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::thread::available_parallelism;

use nunet_core::graph::Provider;

use crate::error::EngineError;

/// The options for running networks.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct EngineOptions {
    /// Which execution provider computes.
    pub provider: Provider,
    /// Threads of one prediction; `None` for one per core.
    pub threads: Option<NonZeroUsize>,
    /// ONNX Runtime's shared library; `None` to search the usual places.
    pub onnxruntime: Option<PathBuf>,
}

impl EngineOptions {
    /// ONNX Runtime's threads spin while they wait for each other. With far more threads than cores,
    /// a prediction may never end.
    const MAX_THREADS_PER_CORE: usize = 4;

    /// Checks what can be checked without the library.
    ///
    /// # Errors
    /// More threads than this machine could run.
    pub fn check(&self) -> Result<(), EngineError> {
        let (Some(threads), Ok(cores)) = (self.threads, available_parallelism()) else { return Ok(()) };
        let most = cores.get().saturating_mul(Self::MAX_THREADS_PER_CORE);
        if threads.get() > most {
            return Err(EngineError::TooManyThreads { threads, cores, most });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error_kind::EngineErrorKind;

    #[test]
    fn more_than_four_threads_per_core_are_a_bad_argument() {
        let most = 4 * available_parallelism().unwrap().get();
        let check =
            |threads| EngineOptions { threads: NonZeroUsize::new(threads), ..Default::default() }.check();
        for threads in [0, 1, most] {
            assert!(check(threads).is_ok(), "{threads}");
        }
        let error = check(most + 1).unwrap_err();
        assert_eq!(error.kind(), EngineErrorKind::Argument);
        assert!(matches!(error, EngineError::TooManyThreads { most: limit, .. } if limit == most));
    }
}
