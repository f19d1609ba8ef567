//! Who does the arithmetic.

use std::fmt;
use std::num::NonZeroUsize;
use std::str::FromStr;

use ort::ep::{self, ExecutionProvider, ExecutionProviderDispatch};
use ort::session::builder::SessionBuilder;

use super::Runtime;

/// Who does the arithmetic: one of ONNX Runtime's execution providers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Provider {
    /// The best one that the loaded library has and that starts on this machine.
    #[default]
    Auto,
    /// ONNX Runtime's own, on every processor.
    Cpu,
    /// Intel's OpenVINO, on processors of x86-64 and Arm.
    OpenVino,
    /// NVIDIA graphics cards.
    Cuda,
    /// NVIDIA graphics cards, with an engine built for the model.
    TensorRt,
}

impl Provider {
    /// All of them, in the order of the documentation.
    pub const ALL: [Self; 5] = [Self::Auto, Self::Cpu, Self::OpenVino, Self::Cuda, Self::TensorRt];

    /// The name on the command line, in files and in messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Cpu => "cpu",
            Self::OpenVino => "openvino",
            Self::Cuda => "cuda",
            Self::TensorRt => "tensorrt",
        }
    }
}

impl Provider {
    /// What `auto` tries, best first. Not TensorRT: it builds an engine for minutes before the first frame.
    pub(super) const AUTOMATIC: [Self; 3] = [Self::Cuda, Self::OpenVino, Self::Cpu];

    /// The provider that will really compute: `self`, or the best one for [`Provider::Auto`].
    ///
    /// A trial registration decides, because a library may have a provider whose own libraries or devices are missing.
    ///
    /// # Errors
    /// A named provider that does not register; [`Provider::Auto`] always finds the processor.
    pub(in crate::graph) fn resolve(
        self,
        runtime: &Runtime,
        threads: NonZeroUsize,
    ) -> Result<Self, ProviderError> {
        if self != Self::Auto {
            return self.try_register(runtime, threads).map(|()| self);
        }
        let works = |provider: &Self| provider.works(runtime, threads);
        Ok(Self::AUTOMATIC.into_iter().find(works).unwrap_or(Self::Cpu))
    }

    /// Whether the library has it and it registers.
    pub(super) fn works(self, runtime: &Runtime, threads: NonZeroUsize) -> bool {
        self.is_compiled_in() && self.try_register(runtime, threads).is_ok()
    }

    fn try_register(self, runtime: &Runtime, threads: NonZeroUsize) -> Result<(), ProviderError> {
        let failed = |reason: String| ProviderError { provider: self, reason };
        let builder =
            SessionBuilder::new(runtime.environment()).map_err(|error| failed(error.to_string()))?;
        self.register(builder, threads).map(drop).map_err(|error| failed(error.to_string()))
    }

    /// Adds the provider to a session in the making. ONNX Runtime's own needs no adding.
    ///
    /// # Errors
    /// What ONNX Runtime says; without `error_on_failure` ort would go on with the processor, silently.
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

/// A provider that does not register, and ONNX Runtime's words about it.
#[derive(Debug)]
pub(in crate::graph) struct ProviderError {
    pub(in crate::graph) provider: Provider,
    pub(in crate::graph) reason: String,
}

impl fmt::Display for Provider {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Provider {
    type Err = UnknownProvider;

    fn from_str(text: &str) -> Result<Self, UnknownProvider> {
        Self::ALL
            .into_iter()
            .find(|provider| provider.name() == text)
            .ok_or_else(|| UnknownProvider { text: text.to_owned() })
    }
}

/// The name of a provider is none of ours.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is no provider\nhint: one of auto, cpu, openvino, cuda, tensorrt")]
pub struct UnknownProvider {
    /// What was written.
    pub text: String,
}
