//! A camera's calibration as ROS writes it: `camera_info` in YAML, the format of `camera_calibration_parsers`.

use serde::Deserialize;

use crate::text::shortened;

use super::{BrownConrady, Camera, CameraError, Distortion, Intrinsics, KannalaBrandt};

const PLUMB_BOB: &str = "plumb_bob";
const RATIONAL_POLYNOMIAL: &str = "rational_polynomial";
const EQUIDISTANT: &str = "equidistant";

/// `camera_info` has about a thousand bytes.
const MAX_BYTES: usize = 64 * 1024;

/// A calibrated camera at the size that it was calibrated at.
///
/// It is the camera of the picture as the sensor gave it. `rectification_matrix` and `projection_matrix` are of
/// pictures that were rectified since; they are not read.
///
/// # Example: half the size of the calibration
/// ```
/// # use nunet_core::camera::{Calibration, CalibrationError};
/// let calibration = Calibration::parse(
///     "image_width: 1280
/// image_height: 960
/// camera_name: front
/// camera_matrix: {rows: 3, cols: 3, data: [1037, 0, 651, 0, 1038, 507, 0, 0, 1]}
/// distortion_model: plumb_bob
/// distortion_coefficients: {rows: 1, cols: 5, data: [-0.31, 0.11, 0.0007, -0.0004, 0]}
/// ",
/// )?;
/// let camera = calibration.at_size(640, 480)?;
/// assert_eq!((camera.intrinsics.fx_px, camera.intrinsics.cx_px), (518.5, 325.25));
/// assert_eq!(camera.distortion, calibration.camera().distortion, "a lens does not change with its pictures");
/// # Ok::<(), CalibrationError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    camera: Camera,
}

impl Calibration {
    /// No calibration that [`Calibration::parse`] takes has more bytes: whoever reads a file may stop behind them.
    pub const MAX_BYTES: usize = MAX_BYTES;

    /// Reads `camera_info` in YAML.
    ///
    /// # Errors
    /// Text that is too long, empty or no YAML, missing keys, matrices of another shape, numbers that are not finite
    /// or no camera's, a lens model that is not known, another count of its coefficients.
    pub fn parse(text: &str) -> Result<Self, CalibrationError> {
        if text.len() > MAX_BYTES {
            return Err(CalibrationError::TooLong);
        }
        if text.trim().is_empty() {
            return Err(CalibrationError::Empty);
        }
        let options = serde_saphyr::options! { with_snippet: false };
        let info: CameraInfo =
            serde_saphyr::from_str_with_options(text, options).map_err(|error| CalibrationError::Syntax {
                reason: shortened(&error.render_with_formatter(&serde_saphyr::UserMessageFormatter)),
            })?;
        Ok(Self { camera: info.camera()? })
    }

    /// The camera at the size that it was calibrated at.
    #[must_use]
    pub fn camera(&self) -> Camera {
        self.camera
    }

    /// The camera when its pictures are resized to `width` x `height` pixels.
    ///
    /// # Errors
    /// A size whose sides have another ratio, by more than the rounding to whole pixels: such a picture was cropped or
    /// stretched, and nobody said where.
    pub fn at_size(&self, width: u32, height: u32) -> Result<Camera, CameraError> {
        self.camera.fitted_to(width, height)
    }
}

/// The keys that are read; others are passed over. All of them optional, so that a missing one is told by name.
#[derive(Deserialize)]
struct CameraInfo {
    image_width: Option<u32>,
    image_height: Option<u32>,
    camera_matrix: Option<Matrix>,
    distortion_model: Option<String>,
    distortion_coefficients: Option<Matrix>,
}

#[derive(Deserialize)]
struct Matrix {
    rows: Option<usize>,
    cols: Option<usize>,
    data: Option<Vec<f64>>,
}

impl CameraInfo {
    fn camera(self) -> Result<Camera, CalibrationError> {
        let width = present("image_width", self.image_width)?;
        let height = present("image_height", self.image_height)?;
        let matrix = present("camera_matrix", self.camera_matrix)?.numbers("camera_matrix")?;
        let model = present("distortion_model", self.distortion_model)?;
        let coefficients = present("distortion_coefficients", self.distortion_coefficients)?;
        let coefficients = coefficients.numbers("distortion_coefficients")?;
        let [fx_px, fy_px, cx_px, cy_px] = pinhole_numbers(&matrix)?;
        let intrinsics = Intrinsics::new(fx_px, fy_px, cx_px, cy_px, width, height)
            .map_err(|source| CalibrationError::Intrinsics { width, height, source })?;
        Ok(Camera { intrinsics, distortion: Distortion::from_ros(&model, &coefficients)? })
    }
}

impl Matrix {
    fn numbers(self, key: &'static str) -> Result<Vec<f64>, CalibrationError> {
        let missing = |part: &str| CalibrationError::Missing { key: format!("{key}: {part}") };
        let rows = self.rows.ok_or_else(|| missing("rows"))?;
        let cols = self.cols.ok_or_else(|| missing("cols"))?;
        let data = self.data.ok_or_else(|| missing("data"))?;
        if rows.checked_mul(cols) != Some(data.len()) {
            return Err(CalibrationError::Shape { key, rows, cols, got: data.len() });
        }
        match data.iter().position(|value| !value.is_finite()) {
            Some(place) => Err(CalibrationError::NotFinite { key, place: place + 1, value: data[place] }),
            None => Ok(data),
        }
    }
}

fn present<T>(key: &str, value: Option<T>) -> Result<T, CalibrationError> {
    value.ok_or_else(|| CalibrationError::Missing { key: key.to_owned() })
}

/// `fx, fy, cx, cy` of a matrix that holds nothing else.
fn pinhole_numbers(matrix: &[f64]) -> Result<[f64; 4], CalibrationError> {
    let &[fx, skew, cx, below_fx, fy, cy, far_x, far_y, one] = matrix else {
        return Err(CalibrationError::CameraMatrixSize { got: matrix.len() });
    };
    if skew != 0.0 {
        return Err(CalibrationError::Skew { skew });
    }
    if [below_fx, far_x, far_y, one] != [0.0, 0.0, 0.0, 1.0] {
        return Err(CalibrationError::NotACameraMatrix);
    }
    Ok([fx, fy, cx, cy])
}

impl Distortion {
    /// A lens by the name that ROS gives its model (`sensor_msgs/distortion_models.hpp`), as in a `CameraInfo`.
    ///
    /// # Errors
    /// A model that is not known, another count of coefficients than it has, coefficients that no lens has.
    pub fn from_ros(model: &str, coefficients: &[f64]) -> Result<Self, CalibrationError> {
        let (name, counts): (&'static str, &'static [usize]) = match model {
            PLUMB_BOB => (PLUMB_BOB, &[4, 5]),
            // Eight by ROS's own words; its tools pass OpenCV's longer models under the same name.
            RATIONAL_POLYNOMIAL => (RATIONAL_POLYNOMIAL, &[8, 12, 14]),
            EQUIDISTANT => (EQUIDISTANT, &[4]),
            _ => return Err(CalibrationError::UnknownModel { model: model.to_owned() }),
        };
        if !counts.contains(&coefficients.len()) {
            let got = coefficients.len();
            return Err(CameraError::CoefficientCount { model: name, got, expected: counts }.into());
        }
        Ok(match name {
            EQUIDISTANT => Self::KannalaBrandt(KannalaBrandt::new(coefficients)?),
            _ => Self::BrownConrady(BrownConrady::new(coefficients)?),
        })
    }

    /// The name that ROS gives the lens's model, and as many coefficients as ROS's tools expect of it.
    #[must_use]
    pub fn to_ros(&self) -> (&'static str, Vec<f64>) {
        let all = self.coefficients();
        let used = all.iter().rposition(|&coefficient| coefficient != 0.0).map_or(0, |last| last + 1);
        let (model, count) = match (self, used) {
            (Self::KannalaBrandt(_), _) => (EQUIDISTANT, 4),
            (Self::None, _) | (Self::BrownConrady(_), 0..=5) => (PLUMB_BOB, 5),
            (Self::BrownConrady(_), 6..=8) => (RATIONAL_POLYNOMIAL, 8),
            (Self::BrownConrady(_), 9..=12) => (RATIONAL_POLYNOMIAL, 12),
            (Self::BrownConrady(_), _) => (RATIONAL_POLYNOMIAL, all.len()),
        };
        (model, all[..count].to_vec())
    }
}

/// What is wrong with a calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// More text than any calibration has.
    #[error(
        "a text of more than `{MAX_BYTES}` bytes is no calibration\nhint: a `camera_info` file of ROS has about a \
         thousand"
    )]
    TooLong,
    /// No text.
    #[error("it is empty\nhint: it should be a `camera_info` file of ROS, in YAML")]
    Empty,
    /// No YAML, or something else in a key's place.
    #[error("it is no `camera_info` in YAML: {reason}\nhint: ROS's camera_calibration writes such a file")]
    Syntax {
        /// What the parser says, with line and column.
        reason: String,
    },
    /// A key that is not there.
    #[error(
        "`{key}` is missing\nhint: a `camera_info` file of ROS has `image_width`, `image_height`, `camera_matrix`, \
         `distortion_model` and `distortion_coefficients`, the matrices with `rows`, `cols` and `data`"
    )]
    Missing {
        /// Which key.
        key: String,
    },
    /// More or fewer numbers than rows and columns say.
    #[error(
        "`{key}` says `{rows}` rows of `{cols}` numbers, but holds `{got}`\nhint: write rows x cols numbers"
    )]
    Shape {
        /// Which matrix.
        key: &'static str,
        /// Rows it says it has.
        rows: usize,
        /// Columns it says it has.
        cols: usize,
        /// Numbers it has.
        got: usize,
    },
    /// NaN or infinite.
    #[error(
        "number `{place}` of `{key}` is `{value}`, not finite\nhint: calibrate again: it did not converge"
    )]
    NotFinite {
        /// Which matrix.
        key: &'static str,
        /// Counted from 1.
        place: usize,
        /// Its value.
        value: f64,
    },
    /// Not nine numbers.
    #[error("`camera_matrix` holds `{got}` numbers, not 9\nhint: `[fx, 0, cx, 0, fy, cy, 0, 0, 1]`, pixels")]
    CameraMatrixSize {
        /// How many there are.
        got: usize,
    },
    /// Columns and rows that are not at right angles.
    #[error(
        "`camera_matrix` has the skew `{skew}` (number 2), not 0\nhint: a depth map's columns and rows are at right \
         angles; calibrate with the skew fixed at 0"
    )]
    Skew {
        /// The number, pixels.
        skew: f64,
    },
    /// Something else than a camera's numbers in their places.
    #[error("`camera_matrix` is not `[fx, 0, cx, 0, fy, cy, 0, 0, 1]`\nhint: write it row after row")]
    NotACameraMatrix,
    /// A lens that nobody here knows.
    #[error(
        "`distortion_model` is `{model:.60}`; known are `plumb_bob`, `rational_polynomial` and `equidistant`\nhint: a \
         picture without distortion has `plumb_bob` and five zeros"
    )]
    UnknownModel {
        /// What is written.
        model: String,
    },
    /// Numbers that no camera has.
    #[error(
        "`camera_matrix` is no camera's with pictures of `{width}x{height}`\nhint: it is `[fx, 0, cx, 0, fy, cy, 0, 0, \
         1]`, pixels at `image_width` x `image_height`; ROS writes zeros for a camera that is not calibrated"
    )]
    Intrinsics {
        /// `image_width`.
        width: u32,
        /// `image_height`.
        height: u32,
        /// What is wrong with them.
        source: CameraError,
    },
    /// Coefficients that no lens has.
    #[error(transparent)]
    Lens(#[from] CameraError),
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// As ROS's `camera_calibration` writes it.
    const WEBCAM: &str = "\
image_width: 640
image_height: 480
camera_name: webcam
camera_matrix:
  rows: 3
  cols: 3
  data: [438.783367, 0.000000, 305.593336, 0.000000, 437.302876, 243.738352, 0.000000, 0.000000, 1.000000]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.361976, 0.110510, 0.001014, 0.000505, 0.000000]
rectification_matrix:
  rows: 3
  cols: 3
  data: [0.999978, 0.002789, -0.006046, -0.002816, 0.999986, -0.004401, 0.006034, 0.004417, 0.999972]
projection_matrix:
  rows: 3
  cols: 4
  data: [393.653800, 0.000000, 322.797939, 0.000000, 0.000000, 393.653800, 241.090902, 0.000000, 0.000000, 0.000000, 1.000000, 0.000000]
";

    /// The message, and behind a bar its cause.
    fn message(text: &str) -> String {
        let error = Calibration::parse(text).unwrap_err();
        let cause = std::error::Error::source(&error).map(|cause| format!(" | {cause}"));
        error.to_string() + &cause.unwrap_or_default()
    }

    /// The message about the file above with one piece of it replaced.
    fn message_with(piece: &str, other: &str) -> String {
        assert!(WEBCAM.contains(piece), "{piece}");
        message(&WEBCAM.replacen(piece, other, 1))
    }

    #[test]
    fn a_file_of_camera_calibration_is_read_whole() {
        let camera = Calibration::parse(WEBCAM).unwrap().camera();
        let expected = Intrinsics::new(438.783367, 437.302876, 305.593336, 243.738352, 640, 480).unwrap();
        assert_eq!(camera.intrinsics, expected);
        let lens = BrownConrady::new(&[-0.361976, 0.110510, 0.001014, 0.000505, 0.0]).unwrap();
        assert_eq!(camera.distortion, Distortion::BrownConrady(lens));
    }

    #[test]
    fn every_model_of_ros_is_read() {
        let fisheye = WEBCAM.replace("plumb_bob", "equidistant").replace("cols: 5", "cols: 4").replace(
            "[-0.361976, 0.110510, 0.001014, 0.000505, 0.000000]",
            "[-0.361976, 0.110510, 0.001014, 0.000505]",
        );
        let lens = KannalaBrandt::new(&[-0.361976, 0.110510, 0.001014, 0.000505]).unwrap();
        let camera = Calibration::parse(&fisheye).unwrap().camera();
        assert_eq!(camera.distortion, Distortion::KannalaBrandt(lens));

        let numbers = [0.5, -2.7, 0.001, 0.0005, 1.5, 0.4, -2.5, 1.4];
        let rational = WEBCAM
            .replace("plumb_bob", "rational_polynomial")
            .replace("cols: 5", "cols: 8")
            .replace("[-0.361976, 0.110510, 0.001014, 0.000505, 0.000000]", &format!("{numbers:?}"));
        let lens = BrownConrady::new(&numbers).unwrap();
        assert_eq!(
            Calibration::parse(&rational).unwrap().camera().distortion,
            Distortion::BrownConrady(lens)
        );
    }

    #[test]
    fn a_lens_goes_to_ros_and_back() {
        let long = [0.1, 0.2, 0.001, 0.002, 0.3, 0.4, 0.5, 0.6, 0.01, 0.02, 0.03, 0.04, 0.05, -0.05];
        for count in [5, 8, 12, 14] {
            let lens = Distortion::BrownConrady(BrownConrady::new(&long[..count]).unwrap());
            let (model, coefficients) = lens.to_ros();
            assert_eq!(model, if count == 5 { "plumb_bob" } else { "rational_polynomial" });
            assert_eq!(coefficients, long[..count]);
            assert_eq!(Distortion::from_ros(model, &coefficients), Ok(lens));
        }
        let lens = Distortion::KannalaBrandt(KannalaBrandt::new(&[0.1, 0.0, 0.0, 0.0]).unwrap());
        assert_eq!(lens.to_ros(), ("equidistant", vec![0.1, 0.0, 0.0, 0.0]));
        assert_eq!(Distortion::None.to_ros(), ("plumb_bob", vec![0.0; 5]));
    }

    #[test]
    fn a_size_of_the_same_shape_is_scaled_to_and_another_is_refused_with_both_named() {
        let calibration = Calibration::parse(WEBCAM).unwrap();
        let twice = calibration.at_size(1280, 960).unwrap();
        assert_eq!(twice.intrinsics.fx_px, 2.0 * 438.783367);
        assert!(calibration.at_size(213, 160).is_ok(), "rounded to whole pixels");
        let error = calibration.at_size(1280, 720).unwrap_err().to_string();
        assert!(
            error.starts_with(
                "a calibration for pictures of `640x480` does not fit pictures of `1280x720`: the sides' ratio \
                 differs\nhint: "
            ),
            "{error}"
        );
        assert!(calibration.at_size(640, 0).is_err() && calibration.at_size(0, 0).is_err());
    }

    #[test]
    fn what_is_missing_is_named() {
        for (piece, other, key) in [
            ("image_width", "width", "image_width"),
            ("image_height: 480", "image_height:", "image_height"),
            ("camera_matrix", "K", "camera_matrix"),
            ("distortion_model", "model", "distortion_model"),
            ("distortion_coefficients", "D", "distortion_coefficients"),
            ("  rows: 3\n", "", "camera_matrix: rows"),
            ("  cols: 3\n", "", "camera_matrix: cols"),
            ("  data: [438", "  numbers: [438", "camera_matrix: data"),
        ] {
            let error = message_with(piece, other);
            assert!(error.starts_with(&format!("`{key}` is missing\nhint: ")), "{error}");
        }
    }

    #[test]
    fn numbers_that_are_no_cameras_are_refused_by_name() {
        for (piece, other, expected) in [
            ("438.783367", ".nan", "number `1` of `camera_matrix` is `NaN`, not finite\nhint: "),
            ("0.110510", "-.inf", "number `2` of `distortion_coefficients` is `-inf`, not finite\nhint: "),
            ("0.000000, 305", "0.25, 305", "`camera_matrix` has the skew `0.25` (number 2), not 0\nhint: "),
            ("0.000000, 1.000000]", "0.0, 2.0]", "`camera_matrix` is not `[fx, 0, cx, 0, fy, cy, 0, 0, 1]`"),
            (
                "-0.361976",
                "-4e7",
                "lens coefficient `k1` is `-40000000`; it must be a number between -1000000",
            ),
        ] {
            let error = message_with(piece, other);
            assert!(error.starts_with(expected), "{error}");
        }
        for (piece, other, cause) in [
            ("438.783367", "-438.8", "focal length `fx` is `-438.8`; it must be greater than 0"),
            ("437.302876", "0", "focal length `fy` is `0`; it must be greater than 0"),
            ("305.593336", "9000", "intrinsic `cx` of `9000` pixels does not fit a picture `640` pixels"),
            ("image_width: 640", "image_width: 0", "a camera with a picture of `0x480` pixels"),
        ] {
            let error = message_with(piece, other);
            assert!(error.starts_with("`camera_matrix` is no camera's with pictures of `"), "{error}");
            assert!(error.contains(&format!(" | {cause}")), "{error}");
        }
    }

    #[test]
    fn a_matrix_of_another_shape_is_refused() {
        let error = message_with("  cols: 5", "  cols: 4");
        assert!(
            error
                .starts_with("`distortion_coefficients` says `1` rows of `4` numbers, but holds `5`\nhint: "),
            "{error}"
        );
        let error =
            message_with("rows: 3\n  cols: 3\n  data: [438.783367, ", "rows: 4\n  cols: 2\n  data: [");
        assert!(error.starts_with("`camera_matrix` holds `8` numbers, not 9\nhint: "), "{error}");
        let huge = usize::MAX.to_string();
        let error = message_with("rows: 1\n  cols: 5", &format!("rows: {huge}\n  cols: {huge}"));
        assert!(error.contains("but holds `5`"), "{error}");
    }

    #[test]
    fn lenses_that_are_not_known_and_coefficients_that_are_too_many_are_refused() {
        let error = message_with("plumb_bob", "fov");
        assert!(
            error.starts_with(
                "`distortion_model` is `fov`; known are `plumb_bob`, `rational_polynomial` and `equidistant`\nhint: "
            ),
            "{error}"
        );
        let error = message_with("plumb_bob", "equidistant");
        assert!(
            error.starts_with("lens model `equidistant` has `4` coefficients, not `5`\nhint: "),
            "{error}"
        );
        let error = message_with("plumb_bob", "rational_polynomial");
        assert!(error.contains("has `8`, `12` or `14` coefficients, not `5`"), "{error}");
        let six = ("cols: 5\n  data: [", "cols: 6\n  data: [0, ");
        let error = message_with(six.0, six.1);
        assert!(error.contains("lens model `plumb_bob` has `4` or `5` coefficients, not `6`"), "{error}");
    }

    #[test]
    fn what_is_no_camera_info_is_refused_with_its_place() {
        for empty in ["", "\n \n"] {
            assert!(message(empty).starts_with("it is empty\nhint: "));
        }
        assert!(message("# nothing\n").starts_with("`image_width` is missing\nhint: "));
        for (text, place) in [
            ("just words", "line 1"),
            ("- 640\n- 480\n", "line 1"),
            ("image_width: 640\nimage_height: {480\n", "line 2"),
            ("image_width: 640\nimage_height: tall\n", "line 2"),
            ("image_width: -640\n", "line 1"),
            ("image_width: 640\ncamera_matrix:\n  data: [438, wide]\n", "line 3"),
            ("\u{0}\u{1}", "line 1"),
        ] {
            let error = message(text);
            assert!(
                error.starts_with("it is no `camera_info` in YAML: ") && error.contains(place),
                "{error}"
            );
        }
    }

    #[test]
    fn a_huge_file_and_one_that_unfolds_into_one_are_refused() {
        let huge = format!("{WEBCAM}# {}", "x".repeat(MAX_BYTES));
        assert!(message(&huge).starts_with("a text of more than `65536` bytes is no calibration\nhint: "));
        let mut bomb = String::from("a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n");
        for level in 1..12 {
            let before = format!("*a{}", level - 1);
            bomb += &format!("a{level}: &a{level} [{}]\n", vec![before; 10].join(", "));
        }
        assert!(message(&bomb).starts_with("it is no `camera_info` in YAML: "), "{}", message(&bomb));
        assert!(message(&"[".repeat(10_000)).starts_with("it is no `camera_info` in YAML: "));
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "\\PC{0,200}", cut in 0..WEBCAM.len(), piece in "[-0-9.:,\\[\\]{}&*!|>%@ \n]{0,8}") {
            let _ = Calibration::parse(&text);
            let _ = Calibration::parse(&format!("{}{piece}{}", &WEBCAM[..cut], &WEBCAM[cut..]));
        }
    }
}
