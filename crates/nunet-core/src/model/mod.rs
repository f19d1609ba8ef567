//! What a model file says of itself: metadata, or a sidecar for foreign networks -> a checked description.

mod error;
mod metadata;
pub mod selftest;
mod sidecar;
mod state;

use crate::depth::{DepthRange, Encoding};

pub use error::ModelError;
pub use metadata::METADATA_KEYS;
pub use selftest::{SelfTest, SelfTestGrid, SelfTestMismatch, SelfTestReport, Tolerance};
pub use sidecar::Sidecar;
pub use state::StateTensor;

/// The architecture of a network that a sidecar describes, of which little is known.
const FOREIGN: &str = "foreign";

/// The range of a network that names none.
fn unlimited() -> DepthRange {
    DepthRange::new(0.0, f32::MAX).expect("0 is not negative and below the largest number")
}

/// What a model file says of itself, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelDescription {
    /// `unet`, `wnet`, `wnet_c`, ...; `foreign` for a network described by a sidecar.
    pub architecture: String,
    /// The components in series.
    pub components: Vec<Component>,
    /// What the depth's numbers mean.
    pub encoding: Encoding,
    /// The depths that the network can measure, in metres; meaningless where the encoding has no unit.
    pub range: DepthRange,
    /// The name of each label, in order; empty where there are no labels.
    pub classes: Vec<String>,
    /// The camera of the training pictures.
    pub camera: Option<TrainingCamera>,
    /// Height and width inside the network, where it works at another size than its input's.
    pub inner_size: Option<[u32; 2]>,
    /// Whether the weights were trained at all.
    pub trained: bool,
    /// How it was trained: free form.
    pub training: serde_json::Value,
    /// How good it is: free form.
    pub accuracy: serde_json::Value,
    /// The licence of the weights.
    pub license: Option<String>,
    /// The providers that the file is made for.
    pub targets: Vec<String>,
    /// The answer to the self-test picture.
    pub selftest: Option<SelfTest>,
    /// SHA-256 of the model file; of a staged graph over the manifest's bytes and then each stage file's SHA-256.
    pub hash: [u8; 32],
}

/// One U-Net of the graph.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Component {
    /// Its name.
    pub name: String,
    /// `segmentation` or `depth`.
    pub task: String,
    /// The encoder.
    pub backbone: String,
    /// Whether it sees the original picture besides the component before.
    pub connected: bool,
    /// Number of weights.
    pub parameters: u64,
    /// Billions of operations for one picture, a multiply-add counted as two.
    pub gflop: f64,
}

/// The camera of the training pictures.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct TrainingCamera {
    /// Pixels from left to right.
    pub width: u32,
    /// Pixels from top to bottom.
    pub height: u32,
    /// Horizontal focal length, pixels at that size.
    pub fx: f64,
    /// Vertical focal length, pixels at that size.
    pub fy: f64,
}
