//! The description of a model: ONNX metadata, or the sidecar of a foreign network.

mod error;
mod extra_input;
mod metadata;
pub mod selftest;
mod sidecar;
mod state;

use crate::camera::{CameraError, Intrinsics};
use crate::depth::{DepthEncoding, DepthRange, OutputScale};

pub use error::ModelError;
pub use extra_input::ExtraInput;
pub use metadata::METADATA_KEYS;
pub use selftest::{SelfTest, SelfTestGrid, SelfTestMismatch, SelfTestReport, Tolerance};
pub use sidecar::{Sidecar, SidecarError};
pub use state::StateTensor;

/// The architecture of a network that a sidecar describes.
const FOREIGN: &str = "foreign";

/// The range of a network without one.
fn unlimited() -> DepthRange {
    DepthRange::new(0.0, f32::MAX).expect("0 is not negative and below the largest number")
}

/// The description of a model, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelDescription {
    /// `unet`, `wnet`, `wnet_c`, ...; `foreign` for a network described by a sidecar.
    pub architecture: String,
    /// The components in series.
    pub components: Vec<Component>,
    /// What the values of the depth output mean.
    pub encoding: DepthEncoding,
    /// The linear map that is applied to the depth output before it is decoded.
    pub output_scale: OutputScale,
    /// The depths that the network can measure, meters; ignored if the encoding has no unit.
    pub range: DepthRange,
    /// The name of each label, in order; empty without labels.
    pub classes: Vec<String>,
    /// The camera of the training images, at which the network's meters hold.
    pub camera: Option<TrainingCamera>,
    /// Height and width inside the network, if it works at another size than its input's.
    pub inner_size: Option<[u32; 2]>,
    /// Whether the weights were trained.
    pub trained: bool,
    /// How it was trained; any JSON.
    pub training: serde_json::Value,
    /// Its measured accuracy; any JSON.
    pub accuracy: serde_json::Value,
    /// The license of the weights.
    pub license: Option<String>,
    /// The execution providers that the file is made for.
    pub targets: Vec<String>,
    /// The expected answer to the self-test image.
    pub selftest: Option<SelfTest>,
    /// SHA-256 of the model file; for a staged graph that of the manifest's bytes followed by each stage
    /// file's SHA-256.
    pub hash: [u8; 32],
}

/// One U-Net of the graph.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Component {
    /// Its name.
    pub name: String,
    /// `segmentation`, `normals`, `objectness` or `depth`; informative.
    pub task: String,
    /// The encoder.
    pub backbone: String,
    /// Whether it takes the image in addition to the output of the component before.
    pub connected: bool,
    /// Number of weights.
    pub parameters: u64,
    /// Billions of operations per image; a multiply-add counts as two.
    pub gflop: f64,
}

/// The camera of the training images.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct TrainingCamera {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Horizontal focal length, pixels at that size.
    pub fx: f64,
    /// Vertical focal length, pixels at that size.
    pub fy: f64,
}

impl TrainingCamera {
    /// Checks the numbers by the rule for every camera.
    pub(crate) fn check(&self) -> Result<(), CameraError> {
        let Self { width, height, fx, fy } = *self;
        let middle = |side: u32| (f64::from(side) - 1.0) / 2.0;
        Intrinsics::new(fx, fy, middle(width), middle(height), width, height).map(drop)
    }
}
