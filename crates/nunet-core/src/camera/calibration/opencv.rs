//! Calibrations that OpenCV's `FileStorage` wrote, as its calibration sample does: YAML without the
//! name of the lens model.

/// The tag of OpenCV's matrices.
const MATRIX_TAG: &str = "!!opencv-matrix";

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
