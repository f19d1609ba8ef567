//! Who does the arithmetic.

use std::fmt;
use std::str::FromStr;

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
            .ok_or_else(|| UnknownProvider {
                text: text.to_owned(),
            })
    }
}

/// The name of a provider is none of ours.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is no provider\nhint: one of auto, cpu, openvino, cuda, tensorrt")]
pub struct UnknownProvider {
    /// What was written.
    pub text: String,
}
