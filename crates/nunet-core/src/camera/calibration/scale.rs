//! The factor of depth in a calibration file: the key `nunet_scale`. Other tools ignore it.

use std::fmt::Write as _;

use nunet_types::AspectMode;
use serde::Deserialize;

use super::document::document_range;
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
    /// What was done with images of another aspect ratio when it was measured, if it is known.
    pub aspect: Option<AspectMode>,
}

impl CalibratedScale {
    /// Whether it is for the model with this SHA-256.
    #[must_use]
    pub fn is_for(&self, model_hash: &[u8; 32]) -> bool {
        self.model_hash.is_none_or(|hash| hash == *model_hash)
    }
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
    /// What was done with images of another aspect ratio than the network's.
    pub aspect: AspectMode,
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
    /// Older versions do not write it.
    aspect: Option<String>,
}

/// The factor in a calibration file.
pub(super) fn parse(text: &str) -> Result<Option<CalibratedScale>, CalibrationError> {
    // Another parser reads the other keys. A file without this key is not parsed twice.
    if !text.contains(KEY) {
        return Ok(None);
    }
    let Some(entry) = parse_yaml::<ScaleFile>(text)?.nunet_scale else { return Ok(None) };
    let missing = || CalibrationError::Missing { key: format!("{KEY}: factor") };
    let factor = entry.factor.ok_or_else(missing)?;
    // Its own hint is for a factor that the user passed.
    let factor = check_scale_factor(factor).map_err(CalibrationError::ScaleFactor)?;
    let model_hash = entry.model_sha256.map(|text| hash(&text)).transpose()?;
    let aspect = entry.aspect.map(aspect).transpose()?;
    Ok(Some(CalibratedScale { factor, model_hash, aspect }))
}

fn aspect(text: String) -> Result<AspectMode, CalibrationError> {
    AspectMode::named(&text).ok_or(CalibrationError::Aspect { text })
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
    let key = line.strip_prefix(['"', '\'']).unwrap_or(line);
    let rest = key.strip_prefix(KEY).map(|rest| rest.strip_prefix(['"', '\'']).unwrap_or(rest));
    rest.is_some_and(|rest| rest.trim_start().starts_with(':'))
}

impl ScaleNote {
    /// The text of a calibration file with this factor at the end of its document. The rest of the text does
    /// not change.
    ///
    /// # Errors
    /// A text that is no calibration, or that would no longer describe the same camera.
    pub fn written_into(&self, text: &str) -> Result<String, CalibrationError> {
        let before = Calibration::parse(text)?;
        let written = self.inserted_into(text);
        let broken = |reason: String| CalibrationError::NoPlaceForScale { reason };
        let after = Calibration::parse(&written).map_err(|error| broken(error.to_string()))?;
        let expected = Calibration { scale: after.scale, ..before };
        let is_this = |scale: CalibratedScale| {
            (f64::from(scale.factor) - self.factor).abs() < 1e-5 * (1.0 + self.factor)
                && scale.model_hash == hash(&self.model_sha256).ok()
                && scale.aspect == Some(self.aspect)
        };
        if after != expected {
            return Err(broken("the camera would change".to_owned()));
        }
        if !after.scale.is_some_and(is_this) {
            return Err(broken("the factor would not be read".to_owned()));
        }
        Ok(written)
    }

    /// Not checked.
    fn inserted_into(&self, text: &str) -> String {
        let place = document_range(text);
        let (head, document, tail) = (&text[..place.start], &text[place.clone()], &text[place.end..]);
        let line_end = if text.contains("\r\n") { "\r\n" } else { "\n" };
        let mut out = String::with_capacity(text.len() + 300);
        out.push_str(head);
        out.push_str(&without_block(document));
        if !out.is_empty() && !out.ends_with('\n') {
            out.push_str(line_end);
        }
        out + &self.block().replace('\n', line_end) + tail
    }

    fn block(&self) -> String {
        let Self { factor, spread, agreeing, aspect, model, model_sha256 } = self;
        let mut text = format!("{KEY}:\n  factor: {factor:.5}\n");
        if spread.is_finite() {
            // Writing into a string does not fail.
            let _ = writeln!(text, "  spread: {spread:.4}");
        }
        // A string of JSON is one of YAML.
        let model = serde_json::Value::from(model.as_str());
        let aspect = aspect.name();
        text + &format!(
            "  agreeing: {agreeing}\n  aspect: {aspect}\n  model: {model}\n  model_sha256: \"{model_sha256}\"\n"
        )
    }
}

/// A document without the block, which ends at the last indented line before another key. Empty lines and
/// comments may be between.
fn without_block(document: &str) -> String {
    let lines: Vec<&str> = document.split_inclusive('\n').collect();
    let Some(start) = lines.iter().position(|line| is_start(line)) else { return document.to_owned() };
    let is_blank = |line: &str| line.trim().is_empty() || line.starts_with('#');
    let is_part = |line: &str| is_blank(line) || line.starts_with([' ', '\t']);
    let rest = &lines[start + 1..];
    let part = rest.iter().take_while(|line| is_part(line)).count();
    let length = rest[..part].iter().rposition(|line| !is_blank(line)).map_or(0, |last| last + 1);
    lines[..start].concat() + &rest[length..].concat()
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
    use nunet_types::Hint as _;

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
        let (spread, agreeing, aspect) = (0.0213, 28, AspectMode::Letterbox);
        ScaleNote { factor, spread, agreeing, aspect, model, model_sha256: "0a".repeat(32) }
    }

    fn written(factor: f64, text: &str) -> String {
        note(factor).written_into(text).unwrap_or_else(|error| panic!("{error}:\n{text}"))
    }

    #[test]
    fn a_written_factor_is_read_and_the_rest_of_the_file_stays() {
        let text = written(0.83, FILE);
        assert!(text.starts_with(FILE), "{text}");
        let calibration = Calibration::parse(&text).unwrap();
        let aspect = Some(AspectMode::Letterbox);
        let scale = CalibratedScale { factor: 0.83, model_hash: Some([10; 32]), aspect };
        assert_eq!(calibration.scale(), Some(scale));
        assert_eq!(calibration.camera(), Calibration::parse(FILE).unwrap().camera());
        assert_eq!(written(1.2, &text), written(1.2, FILE), "the old factor is replaced");
    }

    #[test]
    fn a_message_and_a_camchain_take_a_factor_too() {
        let message = "width: 640\nheight: 480\ndistortion_model: plumb_bob\nd: [0, 0, 0, 0, 0]\n\
                       k: [520, 0, 320, 0, 521, 240, 0, 0, 1]\n---\n";
        let chain = "cam0:\n  camera_model: pinhole\n  intrinsics: [520, 521, 320, 240]\n  distortion_model: none\n  \
                     resolution: [640, 480]";
        for text in [message, chain] {
            let written = written(0.7, text);
            let scale = Calibration::parse(&written).unwrap().scale();
            assert_eq!(scale.map(|scale| scale.factor), Some(0.7), "{written}");
        }
        assert!(written(0.7, message).ends_with("---\n"));
    }

    const OPENCV: &str = "calibration_time: \"today\" # kept
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 520., 0., 320., 0., 521., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0.1, 0., 0., 0., 0. ]
# the end
";

    #[test]
    fn the_factor_is_written_into_the_document_whatever_is_around_it() {
        let heads =
            ["", "%YAML:1.0\n---\n", "# made by hand\n\n---\n", "\u{feff}%YAML:1.0\n---\n", "---\n---\n"];
        let tails = ["", "...\n", "---\n", "...\n# after\n", "---\nimage_width: 3\n---\n"];
        for (head, tail) in heads.iter().flat_map(|head| tails.map(|tail| (head, tail))) {
            for document in [FILE, OPENCV] {
                for line_end in ["\n", "\r\n"] {
                    let lines = |text: &str| text.replace('\n', line_end);
                    let (head, document, tail) = (lines(head), lines(document), lines(tail));
                    let text = format!("{head}{document}{tail}");
                    let once = written(0.83, &text);
                    let calibration = Calibration::parse(&once).unwrap();
                    assert_eq!(calibration.scale().map(|scale| scale.factor), Some(0.83), "{once}");
                    assert_eq!(calibration.camera(), Calibration::parse(&text).unwrap().camera(), "{once}");
                    let block = lines(&note(0.83).block());
                    assert_eq!(
                        once,
                        format!("{head}{document}{block}{tail}"),
                        "the rest stays byte for byte"
                    );
                    assert_eq!(written(1.2, &once), written(1.2, &text), "the old factor is replaced");
                }
            }
        }
    }

    #[test]
    fn an_old_factor_is_replaced_however_it_was_written() {
        for old in [
            "nunet_scale: {factor: 0.9}\n",
            "\"nunet_scale\": {factor: 0.9}\n",
            "nunet_scale:\n\n# by hand\n  factor: 0.9\n",
            "nunet_scale:\n  factor: 0.9\n\n  model: \"a\"\n",
            "nunet_scale: {\n  factor: 0.9\n  }\n",
        ] {
            let rest = "\n# more\nprojection: 1\n";
            let text = format!("{FILE}{old}{rest}");
            let read = Calibration::parse(&text).unwrap().scale().map(|scale| scale.factor);
            assert_eq!((read, written(1.2, &text)), (Some(0.9), written(1.2, &format!("{FILE}{rest}"))));
        }
    }

    #[test]
    fn a_file_that_would_break_is_refused() {
        let flow =
            format!("{{{}}}", FILE.trim_end().replace("front   # a comment", "front").replace('\n', ",\n"))
                .replace(
                    "camera_matrix:,\n  rows: 3,\n  cols: 3,\n  data: [520, 0, 320, 0, 521, 240, 0, 0, 1]",
                    "camera_matrix: {rows: 3, cols: 3, data: [520, 0, 320, 0, 521, 240, 0, 0, 1]}",
                );
        let indented = FILE.lines().map(|line| format!("  {line}\n")).collect::<String>();
        for text in [flow, indented] {
            Calibration::parse(&text).unwrap();
            let refused = note(0.83).written_into(&text);
            assert!(matches!(refused, Err(CalibrationError::NoPlaceForScale { .. })), "{refused:?}");
        }
        let too_long = format!("{FILE}#{}\n", " ".repeat(Calibration::MAX_BYTES - FILE.len() - 10));
        assert!(note(0.83).written_into(&too_long).is_err());
        assert!(note(0.83).written_into("camera_name: a\n").is_err(), "no calibration");
    }

    #[test]
    fn a_factor_by_hand_is_for_any_model_and_a_wrong_one_is_an_error() {
        let scale = |entry: &str| Calibration::parse(&format!("{FILE}nunet_scale: {entry}\n"));
        let by_hand = scale("{factor: 0.9}").unwrap().scale();
        assert_eq!(by_hand, Some(CalibratedScale { factor: 0.9, model_hash: None, aspect: None }));
        for wrong in
            ["{}", "{factor: -1}", "{factor: .nan}", "{factor: x}", "{factor: 1, model_sha256: 12}", "[1]"]
        {
            assert!(scale(wrong).is_err(), "{wrong}");
        }
        for wrong in ["{}", "{factor: -1}"] {
            let hint = scale(wrong).unwrap_err().hint().unwrap();
            assert!(hint.contains("remove `nunet_scale`"), "{wrong}: {hint}");
        }
        assert_eq!(Calibration::parse(FILE).unwrap().scale(), None);
    }

    #[test]
    fn a_factor_of_an_older_version_has_no_aspect_mode_and_a_wrong_one_is_named() {
        let hash = "0a".repeat(32);
        let block =
            "nunet_scale:\n  factor: 0.94404\n  spread: 0.0050\n  agreeing: 30\n  model: \"wnet_c.onnx\"\n";
        let older = Calibration::parse(&format!("{FILE}{block}  model_sha256: \"{hash}\"\n")).unwrap();
        let scale = CalibratedScale { factor: 0.94404, model_hash: Some([10; 32]), aspect: None };
        assert_eq!(older.scale(), Some(scale));
        let wrong = Calibration::parse(&format!("{FILE}nunet_scale: {{factor: 0.9, aspect: squeeze}}\n"));
        assert_eq!(wrong, Err(CalibrationError::Aspect { text: "squeeze".to_owned() }));
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
