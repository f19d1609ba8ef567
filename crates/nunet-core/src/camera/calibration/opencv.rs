//! Calibrations that OpenCV's `FileStorage` wrote, as its calibration sample does: YAML behind a directive of its own, and no
//! name of the lens model.

/// The directive is not valid YAML, whose own is `%YAML 1.0`.
const DIRECTIVE: &str = "%YAML:1.0";
/// The tag of OpenCV's matrices.
const MATRIX_TAG: &str = "!!opencv-matrix";

/// The text without OpenCV's directive.
pub(super) fn without_directive(text: &str) -> &str {
    let start = text.trim_start_matches('\u{feff}');
    let rest = start.strip_prefix(DIRECTIVE).and_then(|rest| rest.split_once('\n'));
    rest.map_or(start, |(_, rest)| rest)
}

/// The ROS name of the lens model that OpenCV's file does not name; `None` for files of other programs.
///
/// OpenCV has two models: fisheye, and Brown-Conrady with up to 14 coefficients.
pub(super) fn lens_model(text: &str, is_fisheye: bool, coefficients: usize) -> Option<&'static str> {
    text.contains(MATRIX_TAG).then_some(match (is_fisheye, coefficients) {
        (true, _) => "equidistant",
        (false, 0..=5) => "plumb_bob",
        (false, _) => "rational_polynomial",
    })
}
