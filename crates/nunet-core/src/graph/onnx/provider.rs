//! ONNX Runtime's execution providers.

use std::borrow::Cow;
use std::fmt;
use std::num::NonZeroUsize;
use std::str::FromStr;

use nunet_types::Hint;
use ort::ep::{self, ExecutionProvider, ExecutionProviderDispatch};
use ort::session::builder::SessionBuilder;

use super::Runtime;
use crate::error_kind::ErrorKind;

/// One of ONNX Runtime's execution providers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Provider {
    /// The best one that the loaded library has and that registers on this machine.
    #[default]
    Auto,
    /// ONNX Runtime's own, for every processor.
    Cpu,
    /// Intel's OpenVINO, for x86-64 and Arm processors.
    OpenVino,
    /// NVIDIA graphics cards.
    Cuda,
    /// NVIDIA graphics cards, with an engine built for the model.
    TensorRt,
}

impl Provider {
    /// All of them, in the order of the documentation.
    pub const ALL: [Self; 5] = [Self::Auto, Self::Cpu, Self::OpenVino, Self::Cuda, Self::TensorRt];

    /// The name in options, files and messages.
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
    /// What `auto` tries, best first. Not TensorRT, which builds an engine for minutes before the first frame.
    pub(super) const AUTOMATIC: [Self; 3] = [Self::Cuda, Self::OpenVino, Self::Cpu];

    /// `self`, or the best provider for [`Provider::Auto`].
    ///
    /// Decided by a trial registration, because a library may have a provider whose own libraries or devices are missing.
    ///
    /// # Errors
    /// A named provider that does not register; [`Provider::Auto`] always finds `cpu`.
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

/// An unknown provider name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is not an execution provider")]
pub struct UnknownProvider {
    /// The text.
    pub text: String,
}

impl UnknownProvider {
    /// [`ErrorKind::Argument`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Argument
    }
}

impl Hint for UnknownProvider {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some("use one of auto, cpu, openvino, cuda, tensorrt".into())
    }
}
