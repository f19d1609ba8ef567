//! Registration of execution providers with ONNX Runtime.

use std::num::NonZeroUsize;

use ort::environment::Environment;
use ort::ep::{self, ExecutionProvider, ExecutionProviderDispatch};
use ort::session::builder::SessionBuilder;

use crate::graph::Provider;

impl Provider {
    /// The providers that `auto` tries, best first. Not TensorRT, which builds an engine for minutes before
    /// the first frame.
    pub(super) const AUTOMATIC: [Self; 3] = [Self::Cuda, Self::OpenVino, Self::Cpu];

    /// `self`, or the best provider for [`Provider::Auto`].
    ///
    /// Decided by a trial registration, because a library may have a provider whose own libraries or devices
    /// are missing.
    ///
    /// # Errors
    /// A named provider that does not register; [`Provider::Auto`] always finds `cpu`.
    pub(super) fn resolve(
        self,
        environment: &Environment,
        threads: NonZeroUsize,
    ) -> Result<Self, ProviderError> {
        if self != Self::Auto {
            return self.try_register(environment, threads).map(|()| self);
        }
        let works = |provider: &Self| provider.works(environment, threads);
        Ok(Self::AUTOMATIC.into_iter().find(works).unwrap_or(Self::Cpu))
    }

    /// Whether the library has it and it registers.
    pub(super) fn works(self, environment: &Environment, threads: NonZeroUsize) -> bool {
        self.is_compiled_in() && self.try_register(environment, threads).is_ok()
    }

    fn try_register(self, environment: &Environment, threads: NonZeroUsize) -> Result<(), ProviderError> {
        let failed = |reason: String| ProviderError { provider: self, reason };
        let builder = SessionBuilder::new(environment).map_err(|error| failed(error.to_string()))?;
        self.register(builder, threads).map(drop).map_err(|error| failed(error.to_string()))
    }

    /// Adds the provider to a session builder. ONNX Runtime's own is always there.
    ///
    /// # Errors
    /// ONNX Runtime's error. Without `error_on_failure` ort would fall back to `cpu` without one.
    pub(super) fn register(
        self,
        builder: SessionBuilder,
        threads: NonZeroUsize,
    ) -> ort::Result<SessionBuilder> {
        match self.dispatch(threads) {
            Some(provider) => Ok(builder.with_execution_providers([provider.error_on_failure()])?),
            None => Ok(builder),
        }
    }

    fn dispatch(self, threads: NonZeroUsize) -> Option<ExecutionProviderDispatch> {
        match self {
            Self::Auto | Self::Cpu => None,
            Self::OpenVino => {
                Some(ep::OpenVINO::default().with_device_type("CPU").with_num_threads(threads.get()).build())
            }
            Self::Cuda => Some(ep::CUDA::default().build()),
            Self::TensorRt => Some(ep::TensorRT::default().build()),
        }
    }

    fn is_compiled_in(self) -> bool {
        match self {
            Self::Auto | Self::Cpu => true,
            Self::OpenVino => ep::OpenVINO::is_available().unwrap_or(false),
            Self::Cuda => ep::CUDA::is_available().unwrap_or(false),
            Self::TensorRt => ep::TensorRT::is_available().unwrap_or(false),
        }
    }
}

/// A provider that does not register, and ONNX Runtime's message.
#[derive(Debug)]
pub(in crate::graph) struct ProviderError {
    pub(in crate::graph) provider: Provider,
    pub(in crate::graph) reason: String,
}
