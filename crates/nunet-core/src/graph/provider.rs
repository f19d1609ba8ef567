//! The names of ONNX Runtime's execution providers.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use nunet_types::Hint;

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
