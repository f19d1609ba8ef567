//! The child process of the model check.

use std::num::NonZeroUsize;
use std::path::Path;
use std::thread::available_parallelism;

use nunet_core::graph::{Provider, model_files};
use nunet_core::pipeline::PipelineOptions;
use rustix::process::{Resource, Rlimit, Signal, getrlimit, set_parent_process_death_signal, setrlimit};

use crate::engine::Engine;
use crate::error::EngineError;
use crate::model_check::time_limit;
use crate::options::EngineOptions;

/// Address space of the child process besides what the model needs, bytes.
const MEMORY_BASE: u64 = 4 << 30;
/// Address space for each byte of the model: optimized and packed copies of the weights.
const MEMORY_PER_MODEL_BYTE: u64 = 8;

/// Runs the model check in this process: sets limits, loads the model if its files have these hashes, and
/// runs its self-test.
///
/// # Errors
/// Why the model is refused.
pub fn check_model_in_this_process(
    model: &Path,
    hashes: Vec<[u8; 32]>,
    options: EngineOptions,
) -> Result<(), EngineError> {
    limit_this_process(model, options.provider)?;
    let engine = Engine::start(options)?;
    let loaded = engine.load_trusted(model.to_owned(), &[], hashes)?;
    loaded.into_pipeline(PipelineOptions::default())?;
    Ok(())
}

/// Drivers of graphics cards map address space by the terabyte, so there is no memory limit with them.
fn limit_this_process(model: &Path, provider: Provider) -> Result<(), EngineError> {
    set_parent_process_death_signal(Some(Signal::KILL))
        .map_err(|error| EngineError::system("cannot tie this process to its parent")(error.into()))?;
    let bytes: u64 =
        model_files(model)?.iter().map(|file| file.metadata().map_or(0, |data| data.len())).sum();
    let limits = [
        (Resource::As, memory_limit(provider, bytes)),
        (Resource::Cpu, cpu_limit_s(provider, available_parallelism().unwrap_or(NonZeroUsize::MIN))),
        (Resource::Core, 0),
    ];
    for (resource, limit) in limits {
        let now = getrlimit(resource);
        let limit = now.maximum.map_or(limit, |maximum| maximum.min(limit));
        setrlimit(resource, Rlimit { current: Some(limit), maximum: now.maximum })
            .map_err(|error| EngineError::system(format!("cannot limit {resource:?}"))(error.into()))?;
    }
    Ok(())
}

fn memory_limit(provider: Provider, model_bytes: u64) -> u64 {
    match provider {
        Provider::Cuda | Provider::TensorRt => u64::MAX,
        Provider::Auto | Provider::Cpu | Provider::OpenVino => {
            MEMORY_BASE + model_bytes.saturating_mul(MEMORY_PER_MODEL_BYTE)
        }
    }
}

/// Seconds of all threads together. The parent ends the child at the time limit, before this one is reached.
fn cpu_limit_s(provider: Provider, cores: NonZeroUsize) -> u64 {
    time_limit(provider).as_secs().saturating_mul(1 + cores.get() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_on_all_cores_have_the_whole_time_limit() {
        for cores in [1, 2, 64] {
            let limit_s = cpu_limit_s(Provider::Cpu, NonZeroUsize::new(cores).unwrap());
            assert!(limit_s > cores as u64 * time_limit(Provider::Cpu).as_secs(), "{cores}");
        }
    }

    #[test]
    fn gpus_have_no_memory_limit_and_tensorrt_has_time_to_build_engines() {
        for provider in [Provider::Cuda, Provider::TensorRt] {
            assert_eq!(memory_limit(provider, 1), u64::MAX);
        }
        assert_eq!(memory_limit(Provider::Cpu, 1 << 20), MEMORY_BASE + (8 << 20));
        assert!(time_limit(Provider::TensorRt) > time_limit(Provider::Cuda));
    }
}
