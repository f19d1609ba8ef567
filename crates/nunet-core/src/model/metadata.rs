//! The description in an ONNX file's `metadata_props`. The keys are documented in `docs/book/model-file.md`.

use std::collections::BTreeMap;

use serde::de::DeserializeOwned;

use super::{Component, ModelDescription, ModelError, SelfTest, TrainingCamera};
use crate::depth::{DepthEncoding, DepthRange, OutputScale};
use crate::frame::MAX_SIDE_PX;

/// The version of the contract that this library reads.
const VERSION: &str = "1";

/// All keys of the contract, for `nunetd contract --json`.
pub const METADATA_KEYS: [&str; 16] = [
    "nunet.version",
    "nunet.architecture",
    "nunet.components",
    "nunet.depth.encoding",
    "nunet.depth.min_m",
    "nunet.depth.max_m",
    "nunet.classes",
    "nunet.camera",
    "nunet.inner_size",
    "nunet.trained",
    "nunet.training",
    "nunet.accuracy",
    "nunet.license",
    "nunet.targets",
    "nunet.selftest",
    "nunet.state",
];

impl ModelDescription {
    /// Whether a sidecar describes the network, so that its training and size are not known.
    #[must_use]
    pub fn is_foreign(&self) -> bool {
        self.architecture == super::FOREIGN
    }

    /// Whether the metadata follows the contract, in any version.
    #[must_use]
    pub fn is_in(metadata: &BTreeMap<String, String>) -> bool {
        metadata.contains_key("nunet.version")
    }

    /// Parses the metadata of a model file whose hash is `hash`, except `nunet.state`, which each file of a
    /// staged graph has on its own ([`super::StateTensor::list`]). Keys that the contract does not name are
    /// ignored.
    ///
    /// # Errors
    /// Another version, a missing key, an invalid value.
    pub fn from_metadata(metadata: &BTreeMap<String, String>, hash: [u8; 32]) -> Result<Self, ModelError> {
        let entries = Entries(metadata);
        let version = entries.required("nunet.version")?;
        if version != VERSION {
            return Err(ModelError::Version { version: version.to_owned(), expected: VERSION });
        }
        let encoding = entries.encoding()?;
        let classes: Vec<String> = entries.json("nunet.classes")?.unwrap_or_default();
        Ok(Self {
            architecture: entries.required("nunet.architecture")?.to_owned(),
            components: entries.json::<Vec<Component>>("nunet.components")?.unwrap_or_default(),
            encoding,
            output_scale: OutputScale::IDENTITY,
            range: entries.range(encoding)?,
            camera: entries.camera()?,
            inner_size: entries.inner_size()?,
            trained: entries.trained()?,
            training: entries.json("nunet.training")?.unwrap_or_default(),
            accuracy: entries.json("nunet.accuracy")?.unwrap_or_default(),
            license: entries.optional("nunet.license").map(str::to_owned),
            targets: entries.targets(),
            selftest: entries.selftest(classes.len())?,
            classes,
            hash,
        })
    }
}

struct Entries<'a>(&'a BTreeMap<String, String>);

impl Entries<'_> {
    fn optional(&self, key: &'static str) -> Option<&str> {
        self.0.get(key).map(String::as_str)
    }

    fn required(&self, key: &'static str) -> Result<&str, ModelError> {
        self.optional(key).ok_or(ModelError::Missing { key })
    }

    fn json<T: DeserializeOwned>(&self, key: &'static str) -> Result<Option<T>, ModelError> {
        let parse = |text| serde_json::from_str(text).map_err(|error| ModelError::invalid(key, text, error));
        self.optional(key).map(parse).transpose()
    }

    fn number(&self, key: &'static str) -> Result<f32, ModelError> {
        let text = self.required(key)?;
        text.parse().map_err(|error| ModelError::invalid(key, text, error))
    }

    fn encoding(&self) -> Result<DepthEncoding, ModelError> {
        let text = self.required("nunet.depth.encoding")?;
        text.parse().map_err(|error| ModelError::invalid("nunet.depth.encoding", text, error))
    }

    fn range(&self, encoding: DepthEncoding) -> Result<DepthRange, ModelError> {
        if !encoding.is_metric() {
            return Ok(super::unlimited());
        }
        let (min_m, max_m) = (self.number("nunet.depth.min_m")?, self.number("nunet.depth.max_m")?);
        DepthRange::new(min_m, max_m)
            .map_err(|error| ModelError::invalid("nunet.depth.max_m", &max_m.to_string(), error))
    }

    fn camera(&self) -> Result<Option<TrainingCamera>, ModelError> {
        let key = "nunet.camera";
        let camera: Option<TrainingCamera> = self.json(key)?;
        let text = self.optional(key).unwrap_or_default();
        camera
            .map_or(Ok(()), |camera| camera.check())
            .map_err(|error| ModelError::invalid(key, text, error))?;
        Ok(camera)
    }

    fn trained(&self) -> Result<bool, ModelError> {
        match self.optional("nunet.trained") {
            Some("true") => Ok(true),
            Some("false") | None => Ok(false),
            Some(other) => Err(ModelError::invalid("nunet.trained", other, "expected `true` or `false`")),
        }
    }

    fn targets(&self) -> Vec<String> {
        let list = self.optional("nunet.targets").unwrap_or_default();
        list.split(',').map(str::trim).filter(|name| !name.is_empty()).map(str::to_owned).collect()
    }

    fn inner_size(&self) -> Result<Option<[u32; 2]>, ModelError> {
        let key = "nunet.inner_size";
        let size: Option<[u32; 2]> = self.json(key)?;
        match size {
            Some(sides) if !sides.iter().all(|side| (1..=MAX_SIDE_PX).contains(side)) => {
                let text = self.optional(key).unwrap_or_default();
                Err(ModelError::invalid(key, text, format!("sides are 1 to {MAX_SIDE_PX}")))
            }
            size => Ok(size),
        }
    }

    fn selftest(&self, classes: usize) -> Result<Option<SelfTest>, ModelError> {
        let key = "nunet.selftest";
        let parse = |text| {
            let test = SelfTest::parse(text).and_then(|test| test.check_labels(classes).map(|()| test));
            test.map_err(|reason| ModelError::invalid(key, text, reason))
        };
        self.optional(key).map(parse).transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn minimal() -> BTreeMap<String, String> {
        [
            ("nunet.version", "1"),
            ("nunet.architecture", "wnet_c"),
            ("nunet.depth.encoding", "metric"),
            ("nunet.depth.min_m", "0.3"),
            ("nunet.depth.max_m", "10"),
        ]
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .into()
    }

    fn with(key: &str, value: &str) -> Result<ModelDescription, ModelError> {
        let mut metadata = minimal();
        metadata.insert(key.to_owned(), value.to_owned());
        ModelDescription::from_metadata(&metadata, [7; 32])
    }

    #[test]
    fn a_minimal_description_is_untrained_and_has_a_range() {
        let description = ModelDescription::from_metadata(&minimal(), [7; 32]).unwrap();
        assert!(!description.trained);
        assert_eq!(description.range, DepthRange::new(0.3, 10.0).unwrap());
        assert_eq!(description.hash, [7; 32]);
        assert_eq!((description.camera, description.selftest), (None, None));
    }

    #[test]
    fn every_documented_value_is_read() {
        let component = r#"[{"name": "segmentation", "task": "segmentation", "backbone": "resnet34",
            "connected": false, "parameters": 24436369, "gflop": 73.3}]"#;
        assert_eq!(with("nunet.components", component).unwrap().components[0].parameters, 24_436_369);
        assert_eq!(with("nunet.classes", r#"["wall", "floor"]"#).unwrap().classes, ["wall", "floor"]);
        assert_eq!(with("nunet.inner_size", "[240, 320]").unwrap().inner_size, Some([240, 320]));
        assert_eq!(with("nunet.targets", "cpu, openvino").unwrap().targets, ["cpu", "openvino"]);
        assert_eq!(with("nunet.training", r#"{"epochs": 20}"#).unwrap().training["epochs"], 20);
        assert!(with("nunet.trained", "true").unwrap().trained);
        let camera = r#"{"width": 640, "height": 480, "fx": 518.9, "fy": 519.5}"#;
        assert_eq!(with("nunet.camera", camera).unwrap().camera.unwrap().fx, 518.9);
    }

    #[test]
    fn another_version_is_refused_by_name() {
        let expected = ModelError::Version { version: "2".to_owned(), expected: "1" };
        assert_eq!(with("nunet.version", "2"), Err(expected));
    }

    #[test]
    fn a_missing_key_is_named() {
        for key in ["nunet.version", "nunet.architecture", "nunet.depth.encoding", "nunet.depth.max_m"] {
            let mut metadata = minimal();
            metadata.remove(key);
            let error = ModelDescription::from_metadata(&metadata, [0; 32]).unwrap_err();
            assert_eq!(error, ModelError::Missing { key });
        }
    }

    #[test]
    fn malformed_values_are_named_with_their_key() {
        for (key, value) in [
            ("nunet.components", "[{"),
            ("nunet.classes", "wall, floor"),
            ("nunet.camera", r#"{"width": 640}"#),
            ("nunet.camera", r#"{"width": 640, "height": 480, "fx": -1, "fy": 1}"#),
            ("nunet.camera", r#"{"width": 640, "height": 480, "fx": 0.8, "fy": 1.1}"#),
            ("nunet.inner_size", "[240]"),
            ("nunet.inner_size", "[0, 0]"),
            ("nunet.inner_size", "[240, 100000]"),
            ("nunet.trained", "yes"),
            ("nunet.depth.encoding", "disparity"),
            ("nunet.depth.min_m", "near"),
            ("nunet.depth.max_m", "0.1"),
            ("nunet.selftest", "{}"),
        ] {
            let error = with(key, value).unwrap_err();
            let ModelError::Invalid { key: named, value: shown, .. } = &error else { panic!("{error}") };
            assert_eq!((*named, shown.as_str()), (key, value));
        }
    }

    #[test]
    fn a_long_value_is_shortened_in_the_message() {
        let error = with("nunet.classes", &"x".repeat(100_000)).unwrap_err();
        assert!(error.to_string().len() < 300, "{error}");
    }

    #[test]
    fn a_network_without_unit_needs_no_range() {
        let mut metadata = minimal();
        metadata.remove("nunet.depth.min_m");
        for encoding in ["relative", "relative_inverse", "minmax"] {
            metadata.insert("nunet.depth.encoding".to_owned(), encoding.to_owned());
            assert!(ModelDescription::from_metadata(&metadata, [0; 32]).is_ok(), "{encoding}");
        }
    }
}
