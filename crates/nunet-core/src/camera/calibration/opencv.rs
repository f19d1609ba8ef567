//! Calibrations that OpenCV's `FileStorage` wrote, as its calibration sample does: YAML or JSON
//! without the name of the lens model.

/// The type of OpenCV's matrices: a tag in YAML, `"type_id"` in JSON.
const MATRIX_TYPE: &str = "opencv-matrix";

/// The ROS name of the lens model that OpenCV's file does not name; `None` for files of other programs.
///
/// OpenCV has two models: fisheye, and Brown-Conrady with up to 14 coefficients.
pub(super) fn lens_model(text: &str, is_fisheye: bool, coefficients: usize) -> Option<&'static str> {
    text.contains(MATRIX_TYPE).then_some(match (is_fisheye, coefficients) {
        (true, _) => "equidistant",
        (false, 0..=5) => "plumb_bob",
        (false, _) => "rational_polynomial",
    })
}

#[cfg(test)]
mod tests {
    use crate::camera::{Calibration, Distortion};

    #[test]
    fn a_file_of_opencv_in_json_has_a_lens() {
        let text = |flag: u8, count: usize, numbers: &str| {
            format!(
                r#"{{"image_width": 640, "image_height": 480, "fisheye_model": {flag},
    "camera_matrix": {{ "type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d",
        "data": [ 520.0, 0.0, 320.0, 0.0, 521.0, 240.0, 0.0, 0.0, 1.0 ] }},
    "distortion_coefficients": {{ "type_id": "opencv-matrix", "rows": {count}, "cols": 1, "dt": "d",
        "data": [ {numbers} ] }}
}}
"#
            )
        };
        let lens = |text: &str| Calibration::parse(text).unwrap().camera().distortion;
        let brown = lens(&text(0, 5, "0.1, -0.05, 0.0, 0.0, 0.0"));
        assert!(matches!(brown, Distortion::BrownConrady(_)), "{brown:?}");
        let fisheye = lens(&text(1, 4, "0.1, -0.05, 0.0, 0.0"));
        assert!(matches!(fisheye, Distortion::KannalaBrandt(_)), "{fisheye:?}");
    }
}
