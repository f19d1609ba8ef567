//! The staged graph as a user writes it, in TOML.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Component, Path};

use nunet_types::Hint;
use serde::Deserialize;

use crate::error_kind::ErrorKind;
use crate::text::shortened;

/// The most stages of one graph: the room for stage times in the frame header, less those around the graph.
pub const MAX_STAGES: usize = 12;
/// The most characters of a stage's name.
const MAX_STAGE_NAME: usize = 32;
/// The most bytes of a manifest or a sidecar: a hundred times what one needs.
pub(crate) const MAX_TOML_BYTES: u64 = 64 * 1024;
/// The supported version of the format.
const VERSION: u32 = 1;
/// Names of the pipeline's own stages, and of the image in a manifest.
const RESERVED_NAMES: [&str; 11] = [
    "image",
    "queue",
    "preprocess",
    "decode",
    "decimation",
    "spatial",
    "temporal",
    "holes",
    "obstacles",
    "cloud",
    "publish",
];
/// The name of the only stage of a fused file.
const FUSED_STAGE: &str = "network";

/// A staged graph as written, before it is wired.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Format of the file: 1.
    pub version: u32,
    /// The stages in the order in which they run.
    #[serde(rename = "stage", default)]
    pub stages: Vec<ManifestStage>,
    /// The results of the graph.
    pub outputs: ManifestOutputs,
}

/// One stage as written.
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

/// The results of the graph, as `stage.tensor`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestOutputs {
    /// The depth map.
    pub depth: String,
    /// The labels, if a stage segments.
    pub labels: Option<String>,
    /// The confidence of depth, if a stage gives it.
    pub confidence: Option<String>,
}

fn each_frame() -> u32 {
    1
}

impl Manifest {
    /// Parses a manifest. The wiring checks later whether its stages fit.
    ///
    /// # Errors
    /// Text that is not TOML, unknown or missing keys, another version, no stage or too many, an invalid
    /// name, and a model outside the manifest's folder.
    pub fn parse(text: &str) -> Result<Self, ManifestError> {
        let manifest: Self = toml::from_str(text)
            .map_err(|error| ManifestError::Syntax { reason: shortened(&error.to_string()) })?;
        if manifest.version != VERSION {
            return Err(ManifestError::Version { version: manifest.version });
        }
        if !(1..=MAX_STAGES).contains(&manifest.stages.len()) {
            return Err(ManifestError::StageCount { count: manifest.stages.len() });
        }
        for stage in &manifest.stages {
            check_name(&stage.name)?;
            check_model(stage)?;
        }
        Ok(manifest)
    }

    /// The manifest of a single file: one stage that takes the image and returns the results; `optional` are
    /// its labels and its confidence.
    pub(crate) fn fused(model: &str, input: &str, depth: &str, optional: [Option<&str>; 2]) -> Self {
        let stage = ManifestStage {
            name: FUSED_STAGE.to_owned(),
            model: model.to_owned(),
            inputs: BTreeMap::from([(input.to_owned(), "image".to_owned())]),
            every: 1,
        };
        let [labels, confidence] = optional.map(|tensor| tensor.map(|name| format!("{FUSED_STAGE}.{name}")));
        let outputs = ManifestOutputs { depth: format!("{FUSED_STAGE}.{depth}"), labels, confidence };
        Self { version: VERSION, stages: vec![stage], outputs }
    }
}

fn check_name(name: &str) -> Result<(), ManifestError> {
    let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-';
    if name.is_empty() || name.len() > MAX_STAGE_NAME || !name.chars().all(fits) {
        return Err(ManifestError::StageName { name: name.to_owned() });
    }
    if RESERVED_NAMES.contains(&name) {
        return Err(ManifestError::ReservedName { name: name.to_owned() });
    }
    Ok(())
}

/// A manifest is untrusted: it may name only files in its own folder.
fn check_model(stage: &ManifestStage) -> Result<(), ManifestError> {
    let mut parts = Path::new(&stage.model).components();
    let inside =
        !stage.model.is_empty() && parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if inside {
        Ok(())
    } else {
        Err(ManifestError::ModelOutside { stage: stage.name.clone(), model: stage.model.clone() })
    }
}

/// Why a manifest is invalid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ManifestError {
    /// Not TOML, or other keys than a manifest has.
    #[error("{reason}")]
    Syntax {
        /// The parser's message, with line and column.
        reason: String,
    },
    /// Another version of the format.
    #[error("`version` is {version}, expected {VERSION}")]
    Version {
        /// The manifest's.
        version: u32,
    },
    /// No stage, or too many.
    #[error("there are {count} stages, expected 1 to {MAX_STAGES}")]
    StageCount {
        /// How many.
        count: usize,
    },
    /// A name with other characters, or too long.
    #[error("`{name:.60}` is not a valid stage name")]
    StageName {
        /// The name.
        name: String,
    },
    /// A name that the pipeline uses.
    #[error("stage name `{name}` is reserved")]
    ReservedName {
        /// The name.
        name: String,
    },
    /// A model outside the manifest's folder.
    #[error("model `{model:.200}` of stage `{stage}` is outside the manifest's folder")]
    ModelOutside {
        /// The stage.
        stage: String,
        /// The path.
        model: String,
    },
}

impl ManifestError {
    /// [`ErrorKind::Model`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Model
    }
}

impl Hint for ManifestError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::StageCount { .. } => "write each stage as a `[[stage]]` table".into(),
            Self::StageName { .. } => {
                format!("use 1 to {MAX_STAGE_NAME} lower-case letters, digits, `_` or `-`").into()
            }
            Self::ModelOutside { .. } => "use a path relative to the manifest, without `..`".into(),
            Self::Syntax { reason } if reason.contains("unknown field `input`") => {
                "pass the .onnx file beside it, if this is its sidecar".into()
            }
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO_STAGES: &str = r#"
        version = 1
        [[stage]]
        name = "segmentation"
        model = "wnet_c.segmentation.onnx"
        inputs = { rgb = "image" }
        every = 2
        [[stage]]
        name = "depth"
        model = "parts/wnet_c.depth.onnx"
        inputs = { rgb = "image", features = "segmentation.logits" }
        [outputs]
        depth = "depth.depth"
        labels = "segmentation.labels"
    "#;

    #[test]
    fn the_documented_manifest_is_read() {
        let manifest = Manifest::parse(TWO_STAGES).unwrap();
        let every: Vec<u32> = manifest.stages.iter().map(|stage| stage.every).collect();
        assert_eq!(every, [2, 1]);
        assert_eq!(manifest.stages[1].inputs["features"], "segmentation.logits");
        assert_eq!(manifest.outputs.labels.as_deref(), Some("segmentation.labels"));
    }

    #[test]
    fn a_manifest_may_begin_with_a_byte_order_mark() {
        assert_eq!(Manifest::parse(&format!("\u{feff}{TWO_STAGES}")), Manifest::parse(TWO_STAGES));
    }

    #[test]
    fn unknown_keys_are_refused_by_name() {
        let error = Manifest::parse(&TWO_STAGES.replace("every = 2", "evry = 2")).unwrap_err();
        let ManifestError::Syntax { reason } = &error else { panic!("{error}") };
        assert!(reason.contains("unknown field `evry`") && error.hint().is_none(), "{reason}");
    }

    #[test]
    fn a_sidecar_in_place_of_a_manifest_has_a_hint() {
        let error = Manifest::parse("[input]\ntensor = \"image\"\n").unwrap_err();
        assert!(matches!(error, ManifestError::Syntax { .. }) && error.hint().is_some(), "{error}");
    }

    #[test]
    fn another_version_is_refused_by_name() {
        let error = Manifest::parse(&TWO_STAGES.replace("version = 1", "version = 2")).unwrap_err();
        assert_eq!(error, ManifestError::Version { version: 2 });
    }

    #[test]
    fn a_graph_has_at_least_one_stage_and_not_too_many() {
        let outputs = "version = 1\n[outputs]\ndepth = \"a.depth\"\n";
        assert_eq!(Manifest::parse(outputs).unwrap_err(), ManifestError::StageCount { count: 0 });
        let stage = "[[stage]]\nname = \"a\"\nmodel = \"a.onnx\"\ninputs = {}\n";
        let crowd = format!("{outputs}{}", stage.repeat(MAX_STAGES + 1));
        assert_eq!(Manifest::parse(&crowd).unwrap_err(), ManifestError::StageCount { count: MAX_STAGES + 1 });
    }

    #[test]
    fn a_model_outside_the_manifests_folder_is_refused() {
        for model in ["../secret.onnx", "/etc/passwd", "parts/../../x.onnx", ""] {
            let error = Manifest::parse(&TWO_STAGES.replace("wnet_c.segmentation.onnx", model)).unwrap_err();
            assert!(matches!(error, ManifestError::ModelOutside { .. }), "{model}: {error}");
        }
    }

    #[test]
    fn stage_names_are_short_plain_and_not_reserved() {
        for name in ["", "two words", "dotted.name", "Upper", &"x".repeat(MAX_STAGE_NAME + 1)] {
            let text = TWO_STAGES.replace("name = \"segmentation\"", &format!("name = \"{name}\""));
            assert!(matches!(Manifest::parse(&text), Err(ManifestError::StageName { .. })), "{name}");
        }
        for name in RESERVED_NAMES {
            let text = TWO_STAGES.replace("name = \"segmentation\"", &format!("name = \"{name}\""));
            assert!(matches!(Manifest::parse(&text), Err(ManifestError::ReservedName { .. })), "{name}");
        }
    }
}
