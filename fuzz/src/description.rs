//! Descriptions of cameras and networks: calibrations, manifests, sidecars, metadata.

use std::collections::BTreeMap;
use std::fmt::Display;

use nunet_core::camera::Calibration;
use nunet_core::graph::Manifest;
use nunet_core::model::{METADATA_KEYS, ModelDescription, Sidecar, StateTensor};

/// ROS's `camera_info` in YAML, and the camera at other sizes.
pub fn calibration(data: &[u8]) {
    let Ok(text) = str::from_utf8(data) else { return };
    match Calibration::parse(text) {
        Err(error) => check_message(&error),
        Ok(calibration) => {
            let camera = calibration.camera();
            assert!(camera.intrinsics.fx_px.is_finite() && camera.intrinsics.fx_px > 0.0);
            for size in [(1, 1), (camera.intrinsics.width, camera.intrinsics.height), (640, 480)] {
                let _ = calibration.at_size(size.0, size.1).map_err(|error| check_message(&error));
            }
            if let Some([x, y]) = camera.project([0.1, -0.2, 1.0]) {
                assert!(!x.is_nan() && !y.is_nan());
            }
        }
    }
}

/// A staged graph.
pub fn manifest(data: &[u8]) {
    let Ok(text) = str::from_utf8(data) else { return };
    match Manifest::parse(text) {
        Err(error) => check_message(&error),
        Ok(manifest) => {
            assert!(!manifest.stages.is_empty());
            assert!(
                manifest.stages.iter().all(|stage| !stage.model.contains("..") || !escapes(&stage.model))
            );
        }
    }
}

fn escapes(path: &str) -> bool {
    path.starts_with('/') || path.split('/').any(|part| part == "..")
}

/// A foreign network's sidecar.
pub fn sidecar(data: &[u8]) {
    let Ok(text) = str::from_utf8(data) else { return };
    match Sidecar::parse(text) {
        Err(error) => check_message(&error),
        Ok(sidecar) => {
            assert!(sidecar.image_shape().iter().all(|&side| side > 0));
            assert_eq!(sidecar.describe([0; 32]).hash, [0; 32]);
        }
    }
}

/// A model file's metadata, written as lines `key=value`; the prefix `nunet.` may be omitted.
pub fn metadata(data: &[u8]) {
    let Ok(text) = str::from_utf8(data) else { return };
    let entries = text.lines().filter_map(|line| line.split_once('='));
    let named = |key: &str| {
        let whole = format!("nunet.{key}");
        if METADATA_KEYS.contains(&whole.as_str()) { whole } else { key.to_owned() }
    };
    let metadata: BTreeMap<_, _> = entries.map(|(key, value)| (named(key), value.to_owned())).collect();
    let _ = StateTensor::list(&metadata).map_err(|error| check_message(&error));
    match ModelDescription::from_metadata(&metadata, [0; 32]) {
        Err(error) => check_message(&error),
        Ok(description) => {
            if let Some(selftest) = description.selftest {
                let report = selftest.compare(&selftest.answer).expect("an answer agrees with itself");
                assert_eq!((report.worst_depth, report.label_cells), (0.0, 0));
            }
        }
    }
}

/// An error has a text, and does not repeat the file.
fn check_message(error: &impl Display) {
    let length = error.to_string().len();
    assert!((1..10_000).contains(&length), "an error of {length} bytes");
}
