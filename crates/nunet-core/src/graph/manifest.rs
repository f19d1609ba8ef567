//! The staged graph as a user writes it, in TOML.

use std::collections::BTreeMap;

use serde::Deserialize;

/// The most stages of one graph: as many as a frame's header has room to time, with those around the graph.
pub const MAX_STAGES: usize = 12;
/// The most characters of a stage's name.
pub const MAX_STAGE_NAME: usize = 32;
/// The most bytes of a manifest or a sidecar: a hundred times what one needs.
pub(crate) const MAX_TOML_BYTES: usize = 64 * 1024;

/// A staged graph as its file says it, not yet proved to fit.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Format of the file: 1.
    pub version: u32,
    /// The stages in the order in which they run.
    #[serde(rename = "stage")]
    pub stages: Vec<ManifestStage>,
    /// What leaves the graph.
    pub outputs: ManifestOutputs,
}

/// One stage as the manifest says it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestStage {
    /// Its name: lower-case letters, digits, `_` and `-`.
    pub name: String,
    /// The model file, relative to the manifest, in its folder or below.
    pub model: String,
    /// The file's input tensor -> `image` or `stage.tensor`.
    pub inputs: BTreeMap<String, String>,
    /// Run each n-th frame, reuse the result in between.
    #[serde(default = "each_frame")]
    pub every: u32,
}

/// What leaves the graph, as `stage.tensor`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestOutputs {
    /// The depth map.
    pub depth: String,
    /// The labels, where a stage segments.
    pub labels: Option<String>,
}

fn each_frame() -> u32 {
    1
}

impl Manifest {
    /// Reads a manifest's text; whether its stages fit is for the wiring to prove.
    ///
    /// # Errors
    /// Text that is not TOML, unknown or missing keys, another version, no stage or too many, a name with other
    /// characters, and a model outside the manifest's folder.
    pub fn parse(text: &str) -> Result<Self, ManifestError> {
        todo!("{text}")
    }
}

/// What is wrong with a manifest.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ManifestError {
    /// More bytes than any manifest needs.
    #[error("`{bytes}` bytes; a manifest has at most `{MAX_TOML_BYTES}`")]
    TooLong {
        /// Bytes of the file.
        bytes: usize,
    },
}
