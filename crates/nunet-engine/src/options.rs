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

    /// Each provider with each number of threads to choose from: the values of these options, else every one
    /// of `providers`, with 1, 2, 4 ... threads up to one per core.
    #[must_use]
    pub fn combinations(&self, providers: &[Provider]) -> Vec<(Provider, NonZeroUsize)> {
        let cores = available_parallelism().unwrap_or(NonZeroUsize::MIN);
        let powers = std::iter::successors(Some(1_usize), |threads| threads.checked_mul(2));
        let threads = powers.take_while(|threads| *threads < cores.get()).filter_map(NonZeroUsize::new);
        let threads: Vec<_> = match self.threads {
            Some(threads) => vec![threads],
            None => threads.chain([cores]).collect(),
        };
        let named = [self.provider];
        let providers = if self.provider == Provider::Auto { providers } else { &named };
        // A graphics card has threads of its own.
        let with = |&provider: &Provider| match provider {
            Provider::Cuda | Provider::TensorRt => vec![(provider, NonZeroUsize::MIN)],
            _ => threads.iter().map(|&threads| (provider, threads)).collect(),
        };
        providers.iter().flat_map(with).collect()
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

    #[test]
    fn a_given_provider_or_thread_count_is_not_varied() {
        let options = |provider, threads| EngineOptions { provider, threads, onnxruntime: None };
        let [one, three] = [1, 3].map(|count| NonZeroUsize::new(count).unwrap());
        let here = [Provider::Cuda, Provider::Cpu];
        assert_eq!(options(Provider::Cpu, Some(three)).combinations(&here), [(Provider::Cpu, three)]);
        let all = options(Provider::Auto, None).combinations(&here);
        assert_eq!(all[..2], [(Provider::Cuda, one), (Provider::Cpu, one)]);
        assert_eq!(all.last(), Some(&(Provider::Cpu, available_parallelism().unwrap())));
    }
}
