//! Kalibr's camchain: a map of cameras, of which there must be one.

use std::collections::BTreeMap;

use nunet_types::SensorRegion;
use serde::Deserialize;

use super::{Calibration, CalibrationError, RosCalibration};

/// The most cameras that an error names.
const SHOWN: usize = 4;

/// One camera.
#[derive(Deserialize)]
pub(super) struct KalibrCamera {
    camera_model: Option<String>,
    intrinsics: Option<Vec<f64>>,
    distortion_model: Option<String>,
    distortion_coeffs: Option<Vec<f64>>,
    resolution: Option<[u32; 2]>,
}

/// Kalibr names its cameras `cam0`, `cam1` and so on.
pub(super) fn is_camchain(text: &str) -> bool {
    text.lines().any(|line| {
        let number = line.strip_prefix("cam").and_then(|rest| rest.split_once(':')).map(|(number, _)| number);
        number.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()))
    })
}

/// The calibration of the only camera.
pub(super) fn calibration(
    mut cameras: BTreeMap<String, KalibrCamera>,
) -> Result<Calibration, CalibrationError> {
    // Not a camera.
    cameras.remove(super::scale::KEY);
    let mut all = cameras.iter();
    let (Some((name, camera)), None) = (all.next(), all.next()) else {
        let names = cameras.keys().take(SHOWN).map(|name| format!("`{name:.40}`"));
        return Err(CalibrationError::SeveralCameras { names: names.collect::<Vec<_>>().join(", ") });
    };
    let missing = |key: &str| CalibrationError::Missing { key: format!("{name}: {key}") };
    let model = camera.camera_model.as_deref().ok_or_else(|| missing("camera_model"))?;
    if model != "pinhole" {
        return Err(CalibrationError::UnknownModel { model: format!("{model:.60} (Kalibr)") });
    }
    let numbers = camera.intrinsics.as_deref().ok_or_else(|| missing("intrinsics"))?;
    let &[fx, fy, cx, cy] = numbers else {
        return Err(CalibrationError::Shape { key: "intrinsics", rows: 1, cols: 4, got: numbers.len() });
    };
    let [width, height] = camera.resolution.ok_or_else(|| missing("resolution"))?;
    let lens = camera.distortion_model.as_deref().ok_or_else(|| missing("distortion_model"))?;
    let lens = if lens == "none" { "" } else { lens };
    let d = match &camera.distortion_coeffs {
        Some(coefficients) => coefficients.as_slice(),
        None if lens.is_empty() => &[],
        None => return Err(missing("distortion_coeffs")),
    };
    let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    let region = SensorRegion::default();
    Calibration::from_ros(&RosCalibration { width, height, k: &k, distortion_model: lens, d, region })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Distortion;

    #[test]
    fn only_a_lens_without_distortion_may_have_no_coefficients() {
        let parsed = |lens: &str| {
            Calibration::parse(&format!(
                "cam0:\n  camera_model: pinhole\n  intrinsics: [520, 521, 320, 240]\n  distortion_model: {lens}\n  \
                 distortion_coefficients: [0.1, 0, 0, 0]\n  resolution: [640, 480]\n"
            ))
        };
        assert_eq!(parsed("none").unwrap().camera().distortion, Distortion::None);
        for lens in ["radtan", "equidistant"] {
            let expected = CalibrationError::Missing { key: "cam0: distortion_coeffs".to_owned() };
            assert_eq!(parsed(lens), Err(expected), "the key is misspelled");
        }
    }
}
