//! The factor of depth in a calibration file: the key `nunet_scale`. Other tools ignore it.

use std::fmt::Write as _;

use serde::Deserialize;

use super::yaml::parse_yaml;
use super::{Calibration, CalibrationError};
use crate::camera::{Camera, Intrinsics, check_scale_factor};

/// The key in a calibration file.
pub(super) const KEY: &str = "nunet_scale";

/// The factor of depth that was measured with a camera and a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibratedScale {
    /// What the network's meters are multiplied by.
    pub factor: f32,
    /// SHA-256 of the model that it was measured with; `None` if it is for any model.
    pub model_hash: Option<[u8; 32]>,
}

/// A measured factor for a calibration file.
#[derive(Debug, Clone, PartialEq)]
pub struct ScaleNote {
    /// What the network's meters are multiplied by.
    pub factor: f64,
    /// The relative spread of the observations (1.4826 times the median deviation).
    pub spread: f64,
    /// How many observations agreed.
    pub agreeing: usize,
    /// The model's name.
    pub model: String,
    /// SHA-256 of the model, hexadecimal.
    pub model_sha256: String,
}

#[derive(Deserialize)]
struct ScaleFile {
    nunet_scale: Option<ScaleEntry>,
}

#[derive(Deserialize)]
struct ScaleEntry {
    factor: Option<f64>,
    model_sha256: Option<String>,
}

/// The factor in a calibration file.
pub(super) fn parse(text: &str) -> Result<Option<CalibratedScale>, CalibrationError> {
    // Another parser reads the other keys. A file without this key is not parsed twice.
    if !text.lines().any(is_start) {
        return Ok(None);
    }
    let Some(entry) = parse_yaml::<ScaleFile>(text)?.nunet_scale else { return Ok(None) };
    let missing = || CalibrationError::Missing { key: format!("{KEY}: factor") };
    let factor = check_scale_factor(entry.factor.ok_or_else(missing)?)?;
    let model_hash = entry.model_sha256.map(|text| hash(&text)).transpose()?;
    Ok(Some(CalibratedScale { factor, model_hash }))
}

fn hash(text: &str) -> Result<[u8; 32], CalibrationError> {
    let byte =
        |place: usize| text.get(2 * place..2 * place + 2).and_then(|two| u8::from_str_radix(two, 16).ok());
    let bytes: Option<Vec<u8>> = (0..32).map(byte).collect();
    let bytes = bytes.filter(|_| text.len() == 64).and_then(|bytes| bytes.try_into().ok());
    bytes.ok_or_else(|| CalibrationError::ModelHash { text: text.to_owned() })
}

/// Whether a line starts the block.
fn is_start(line: &str) -> bool {
    line.strip_prefix(KEY).is_some_and(|rest| rest.trim_start().starts_with(':'))
}

impl ScaleNote {
    /// The text of a calibration file with this factor. The rest of the text does not change.
    #[must_use]
    pub fn written_into(&self, text: &str) -> String {
        let (head, tail) = split(text);
        let mut out = String::with_capacity(text.len() + 300);
        let mut is_inside = false;
        for line in head.split_inclusive('\n') {
            // A block ends with the next line that is not indented.
            is_inside = is_start(line) || is_inside && line.starts_with([' ', '\t']);
            if !is_inside {
                out.push_str(line);
            }
        }
        if !out.is_empty() && !out.ends_with('\n') {
            out.push('\n');
        }
        out + &self.block() + tail
    }

    fn block(&self) -> String {
        let Self { factor, spread, agreeing, model, model_sha256 } = self;
        let mut text = format!("{KEY}:\n  factor: {factor:.5}\n");
        if spread.is_finite() {
            // Writing into a string does not fail.
            let _ = writeln!(text, "  spread: {spread:.4}");
        }
        let model = model.replace('\\', "\\\\").replace('"', "\\\"");
        text + &format!("  agreeing: {agreeing}\n  model: \"{model}\"\n  model_sha256: \"{model_sha256}\"\n")
    }
}

/// The first document, and the end mark with what follows it.
fn split(text: &str) -> (&str, &str) {
    let start = if text.starts_with("---\n") { 4 } else { 0 };
    let end = text[start..].find("\n---").map_or(text.len(), |end| start + end + 1);
    text.split_at(end)
}

impl Calibration {
    /// A calibration file of a camera, as ROS's tools write it.
    #[must_use]
    pub fn file_of(camera: &Camera) -> String {
        let Camera { intrinsics, distortion } = camera;
        let Intrinsics { fx_px, fy_px, cx_px, cy_px, width, height } = intrinsics;
        let (model, coefficients) = distortion.to_ros();
        let numbers: Vec<String> = coefficients.iter().map(f64::to_string).collect();
        let (count, numbers) = (numbers.len(), numbers.join(", "));
        format!(
            "image_width: {width}\nimage_height: {height}\ncamera_name: camera\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
             data: [{fx_px}, 0, {cx_px}, 0, {fy_px}, {cy_px}, 0, 0, 1]\ndistortion_model: {model}\n\
             distortion_coefficients:\n  rows: 1\n  cols: {count}\n  data: [{numbers}]\n"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, KannalaBrandt};

    const FILE: &str = "image_width: 640
image_height: 480
camera_name: front   # a comment
camera_matrix:
  rows: 3
  cols: 3
  data: [520, 0, 320, 0, 521, 240, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0]}
";

    fn note(factor: f64) -> ScaleNote {
        let model = "wnet_c \"new\".onnx".to_owned();
        ScaleNote { factor, spread: 0.0213, agreeing: 28, model, model_sha256: "0a".repeat(32) }
    }

    #[test]
    fn a_written_factor_is_read_and_the_rest_of_the_file_stays() {
        let text = note(0.83).written_into(FILE);
        assert!(text.starts_with(FILE), "{text}");
        let calibration = Calibration::parse(&text).unwrap();
        assert_eq!(calibration.scale(), Some(CalibratedScale { factor: 0.83, model_hash: Some([10; 32]) }));
        assert_eq!(calibration.camera(), Calibration::parse(FILE).unwrap().camera());
        let again = note(1.2).written_into(&text);
        assert_eq!(again, note(1.2).written_into(FILE), "the old factor is replaced");
    }

    #[test]
    fn a_message_and_a_camchain_take_a_factor_too() {
        let message = "width: 640\nheight: 480\ndistortion_model: plumb_bob\nd: [0, 0, 0, 0, 0]\n\
                       k: [520, 0, 320, 0, 521, 240, 0, 0, 1]\n---\n";
        let chain = "cam0:\n  camera_model: pinhole\n  intrinsics: [520, 521, 320, 240]\n  distortion_model: none\n  \
                     resolution: [640, 480]";
        for text in [message, chain] {
            let written = note(0.7).written_into(text);
            let scale = Calibration::parse(&written).unwrap().scale();
            assert_eq!(scale.map(|scale| scale.factor), Some(0.7), "{written}");
        }
        assert!(note(0.7).written_into(message).ends_with("---\n"));
    }

    #[test]
    fn a_factor_by_hand_is_for_any_model_and_a_wrong_one_is_an_error() {
        let scale = |entry: &str| Calibration::parse(&format!("{FILE}nunet_scale: {entry}\n"));
        let by_hand = scale("{factor: 0.9}").unwrap().scale();
        assert_eq!(by_hand, Some(CalibratedScale { factor: 0.9, model_hash: None }));
        for wrong in
            ["{}", "{factor: -1}", "{factor: .nan}", "{factor: x}", "{factor: 1, model_sha256: 12}", "[1]"]
        {
            assert!(scale(wrong).is_err(), "{wrong}");
        }
        assert_eq!(Calibration::parse(FILE).unwrap().scale(), None);
    }

    #[test]
    fn a_camera_becomes_a_file_that_reads_back() {
        let intrinsics = Intrinsics::new(520.25, 521.0, 320.1, 239.9, 640, 480).unwrap();
        let lens = Distortion::KannalaBrandt(KannalaBrandt::new(&[0.01, -0.002, 0.0, 0.0]).unwrap());
        for distortion in [Distortion::None, lens] {
            let camera = Camera { intrinsics, distortion };
            let read = Calibration::parse(&Calibration::file_of(&camera)).unwrap();
            assert_eq!(read.camera(), camera);
        }
    }
}
