use super::*;
use crate::camera::{BrownConrady, KannalaBrandt};
use nunet_types::Hint as _;
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

/// A file of ROS's fisheye calibration, which leaves a skew.
fn fisheye_with_skew() -> String {
    case("fisheye_with_skew/fisheye_ros_skew.yaml")
}

/// The text of a file from the field.
fn case(name: &str) -> String {
    String::from_utf8(nunet_testkit::cases::read(name)).unwrap()
}

fn refusal(text: &str) -> CalibrationError {
    Calibration::parse(text).unwrap_err()
}

/// The refusal of the file above with one piece of it replaced.
fn refusal_with(piece: &str, other: &str) -> CalibrationError {
    assert!(WEBCAM.contains(piece), "{piece}");
    refusal(&WEBCAM.replacen(piece, other, 1))
}

#[test]
fn a_file_of_camera_calibration_is_read() {
    let camera = Calibration::parse(WEBCAM).unwrap().camera();
    let expected = Intrinsics::new(438.783367, 437.302876, 305.593336, 243.738352, 640, 480).unwrap();
    assert_eq!(camera.intrinsics, expected);
    let lens = BrownConrady::new(&[-0.361976, 0.110510, 0.001014, 0.000505, 0.0]).unwrap();
    assert_eq!(camera.distortion, Distortion::BrownConrady(lens));
}

#[test]
fn every_ros_model_is_read() {
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
    assert_eq!(Calibration::parse(&rational).unwrap().camera().distortion, Distortion::BrownConrady(lens));
}

#[test]
fn a_small_skew_is_ignored_and_reported() {
    let calibration = Calibration::parse(&fisheye_with_skew()).unwrap();
    let expected = Intrinsics::new(403.5, 404.2, 321.5, 239.2, 640, 480).unwrap();
    assert_eq!(calibration.camera().intrinsics, expected);
    let skew = IgnoredSkew { skew_px: -0.96, fx_px: 403.5 };
    assert_eq!(calibration.ignored_skew(), Some(skew));
    assert_eq!(skew.to_string(), "the camera matrix has a skew of -0.96 px, 0.24 % of fx, which is ignored");
    assert_eq!(Calibration::parse(WEBCAM).unwrap().ignored_skew(), None);
}

#[test]
fn a_message_is_read_by_the_same_rule_as_a_file() {
    let k = [403.5, -0.96, 321.5, 0.0, 404.2, 239.2, 0.0, 0.0, 1.0];
    let d = [0.0175, -0.0031, 0.0003, -0.0007, 0.0];
    let region = SensorRegion::default();
    let info =
        RosCalibration { width: 640, height: 480, k: &k, distortion_model: "equidistant", d: &d, region };
    assert_eq!(Calibration::from_ros(&info), Calibration::parse(&fisheye_with_skew()));

    let k = [403.5, -9.6, 321.5, 0.0, 404.2, 239.2, 0.0, 0.0, 1.0];
    let skew = CalibrationError::Skew { skew_px: -9.6, fx_px: 403.5 };
    assert_eq!(Calibration::from_ros(&RosCalibration { k: &k, ..info }), Err(skew.clone()));
    assert_eq!(refusal(&fisheye_with_skew().replace("-0.96", "-9.6")), skew);
    let four = CalibrationError::CameraMatrixSize { got: 4 };
    assert_eq!(Calibration::from_ros(&RosCalibration { k: &k[..4], ..info }), Err(four));
}

#[test]
fn a_size_of_the_same_aspect_ratio_is_scaled_to_and_another_is_refused() {
    let calibration = Calibration::parse(WEBCAM).unwrap();
    let twice = calibration.at_size(1280, 960).unwrap();
    assert_eq!(twice.intrinsics.fx_px, 2.0 * 438.783367);
    assert!(calibration.at_size(213, 160).is_ok(), "rounded to whole pixels");
    let expected =
        CameraError::Aspect { calibrated_width: 640, calibrated_height: 480, width: 1280, height: 720 };
    assert_eq!(calibration.at_size(1280, 720), Err(expected));
    assert!(calibration.at_size(640, 0).is_err() && calibration.at_size(0, 0).is_err());
}

#[test]
fn missing_keys_are_named() {
    for (piece, other, key) in [
        ("image_width", "wide", "image_width"),
        ("image_height: 480", "image_height:", "image_height"),
        ("camera_matrix", "matrix", "camera_matrix"),
        ("distortion_model", "model", "distortion_model"),
        ("distortion_coefficients", "coefficients", "distortion_coefficients"),
        ("  rows: 3\n", "", "camera_matrix: rows"),
        ("  cols: 3\n", "", "camera_matrix: cols"),
        ("  data: [438", "  numbers: [438", "camera_matrix: data"),
    ] {
        assert_eq!(refusal_with(piece, other), CalibrationError::Missing { key: key.to_owned() });
    }
}

#[test]
fn invalid_numbers_are_refused_by_name() {
    let error = refusal_with("438.783367", ".nan");
    assert!(matches!(error, CalibrationError::NotFinite { key: "camera_matrix", place: 1, .. }), "{error}");
    let error = refusal_with("0.110510", "-.inf");
    assert!(
        matches!(error, CalibrationError::NotFinite { key: "distortion_coefficients", place: 2, .. }),
        "{error}"
    );
    let error = refusal_with("0.000000, 1.000000]", "0.0, 2.0]");
    assert_eq!(error, CalibrationError::NotACameraMatrix);
    let error = refusal_with("-0.361976", "-4e7");
    let k1 = CameraError::Coefficient { name: "k1", value: -4e7, limit: 1e6 };
    assert_eq!(error, CalibrationError::Lens(k1));
    for (piece, other, source) in [
        ("438.783367", "-438.8", CameraError::NotPositive { name: "fx", value: -438.8 }),
        ("437.302876", "0", CameraError::NotPositive { name: "fy", value: 0.0 }),
        ("305.593336", "9000", CameraError::OutOfRange { name: "cx", value: 9000.0, side: 640 }),
        ("image_width: 640", "image_width: 0", CameraError::Size { width: 0, height: 480 }),
    ] {
        let width = if piece.starts_with("image_width") { 0 } else { 640 };
        let expected = CalibrationError::Intrinsics { width, height: 480, source };
        assert_eq!(refusal_with(piece, other), expected);
    }
}

#[test]
fn a_camera_that_ros_has_not_calibrated_is_named() {
    let echo = "width: 640\nheight: 480\ndistortion_model: ''\nd: []\nk: [0, 0, 0, 0, 0, 0, 0, 0, 0]\n";
    assert_eq!(refusal(echo), CalibrationError::NotCalibrated);
    assert!(refusal(echo).hint().unwrap().contains("ROS writes zeros"));
}

#[test]
fn a_matrix_of_another_shape_is_refused() {
    let shape = |rows, cols| CalibrationError::Shape { key: "distortion_coefficients", rows, cols, got: 5 };
    assert_eq!(refusal_with("  cols: 5", "  cols: 4"), shape(1, 4));
    let error = refusal_with("rows: 3\n  cols: 3\n  data: [438.783367, ", "rows: 4\n  cols: 2\n  data: [");
    assert_eq!(error, CalibrationError::CameraMatrixSize { got: 8 });
    let huge = format!("rows: {0}\n  cols: {0}", usize::MAX);
    assert_eq!(refusal_with("rows: 1\n  cols: 5", &huge), shape(usize::MAX, usize::MAX));
}

#[test]
fn unsupported_lens_models_are_refused_by_name() {
    let error = refusal_with("plumb_bob", "fov");
    assert_eq!(error, CalibrationError::UnknownModel { model: "fov".to_owned() });
}

#[test]
fn text_that_is_not_a_camera_info_is_refused_with_its_place() {
    for empty in ["", "\n \n"] {
        assert_eq!(refusal(empty), CalibrationError::Empty);
    }
    let missing = CalibrationError::Missing { key: "image_width".to_owned() };
    assert_eq!(refusal("# nothing\n"), missing);
    for (text, place) in [
        ("just words", "line 1"),
        ("- 640\n- 480\n", "line 1"),
        ("image_width: 640\nimage_height: {480\n", "line 2"),
        ("image_width: 640\nimage_height: tall\n", "line 2"),
        ("image_width: -640\n", "line 1"),
        ("image_width: 640\ncamera_matrix:\n  data: [438, wide]\n", "line 3"),
        ("\u{1}\u{2}", "line 1"),
    ] {
        let error = refusal(text);
        let CalibrationError::Syntax { reason } = &error else { panic!("{error}") };
        assert!(reason.contains(place), "{reason}");
    }
}

#[test]
fn a_huge_file_and_one_that_expands_into_one_are_refused() {
    let huge = format!("{WEBCAM}# {}", "x".repeat(MAX_BYTES));
    assert_eq!(refusal(&huge), CalibrationError::TooLong);
    let mut bomb = String::from("a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n");
    for level in 1..12 {
        let before = format!("*a{}", level - 1);
        bomb += &format!("a{level}: &a{level} [{}]\n", vec![before; 10].join(", "));
    }
    for text in [bomb, "[".repeat(10_000)] {
        assert!(matches!(refusal(&text), CalibrationError::Syntax { .. }));
    }
}

proptest! {
    #[test]
    fn no_text_panics(text in "\\PC{0,200}", cut in 0..WEBCAM.len(), piece in "[-0-9.:,\\[\\]{}&*!|>%@ \n]{0,8}") {
        let _ = Calibration::parse(&text);
        let _ = Calibration::parse(&format!("{}{piece}{}", &WEBCAM[..cut], &WEBCAM[cut..]));
    }
}

#[test]
fn kalibrs_camchain_and_an_echoed_message_are_read() {
    let case = |name: &str| case(&format!("calibration_kinds/{name}"));
    for text in [case("kalibr.yaml"), case("topic_echo.yaml"), case("topic_echo.yaml").repeat(2)] {
        let camera = Calibration::parse(&text).unwrap().camera();
        let Intrinsics { fx_px, fy_px, cx_px, cy_px, width, height } = camera.intrinsics;
        assert_eq!([fx_px, fy_px, cx_px, cy_px], [500.5, 501.25, 321.25, 238.75]);
        assert_eq!((width, height), (640, 480));
        assert_eq!(camera.distortion.coefficients()[..5], [-0.31, 0.11, 0.0007, -0.0004, 0.0]);
    }
    let kalibr = case("kalibr.yaml");
    let two = format!("{kalibr}{}", kalibr.replace("cam0", "cam1"));
    let two = Calibration::parse(&two).unwrap_err();
    assert_eq!(two, CalibrationError::SeveralCameras { names: "`cam0`, `cam1`".to_owned() });
    for (from, to) in [("pinhole", "omni"), ("pinhole", "eucm"), ("radtan", "fov")] {
        let other = Calibration::parse(&kalibr.replace(from, to)).unwrap_err();
        assert!(matches!(other, CalibrationError::UnknownModel { .. }), "{other}");
        assert!(!other.hint().unwrap().contains("zeros"), "a lens is not replaced by none");
    }
    let ros1 = case("topic_echo.yaml").replace("\nd:", "\nD:").replace("\nk:", "\nK:");
    assert_eq!(Calibration::parse(&ros1), Calibration::parse(&case("topic_echo.yaml")));
}

#[test]
fn the_file_of_opencvs_calibration_sample_is_read() {
    let file = |fisheye: &str, coefficients: &str| {
        let count = coefficients.split(',').count();
        format!(
            "%YAML:1.0\n---\ncalibration_time: \"Sun 29 Nov 2026 12:00:00\"\nimage_width: 640\nimage_height: 480\n{fisheye}\
             camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 500., 0., 320., 0., 501., \
             240., 0.,\n       0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: {count}\n   cols: 1\n   dt: d\n   \
             data: [ {coefficients} ]\navg_reprojection_error: 2.5e-01\n"
        )
    };
    let camera = |text: &str| Calibration::parse(text).unwrap().camera();
    let text = file("", "-3.1e-01, 0.11, 0.0007, -0.0004, 0.");
    let sample = camera(&text);
    assert_eq!((sample.intrinsics.fx_px, sample.intrinsics.cy_px), (500.0, 240.0));
    assert_eq!(sample.distortion.coefficients()[..4], [-0.31, 0.11, 0.0007, -0.0004]);
    assert_eq!(camera(&text.replace('\n', "\r\n")), sample);
    let fisheye = camera(&file("fisheye_model: 1\n", "0.1, -0.02, 0.001, 0.002"));
    assert!(matches!(fisheye.distortion, Distortion::KannalaBrandt(_)), "{fisheye:?}");
    let rational = camera(&file("fisheye_model: 0\n", "0.1, -0.2, 0., 0., 0., 0.01, 0., 0."));
    assert_eq!(rational.distortion.coefficients()[5], 0.01);
}

#[test]
fn calibrations_in_other_formats_are_named() {
    for (text, name) in [
        ("# oST version 5.0\n[image]\n\nwidth\n640\n", "INI"),
        ("<?xml version=\"1.0\"?>\n<opencv_storage>\n", "XML"),
        ("\u{fffd}i\0m\0a\0g\0e\0", "UTF-16"),
    ] {
        let error = refusal(text);
        let CalibrationError::Syntax { reason } = &error else { panic!("{error}") };
        assert!(reason.contains(name), "{reason}");
    }
}

#[test]
fn a_region_of_interest_and_binning_are_those_of_a_message() {
    let echo = case("calibration_kinds/topic_echo.yaml");
    let echo = echo.split("binning_x").next().unwrap();
    let with = |lines: &str| Calibration::parse(&format!("{echo}{lines}"));
    let roi = "roi:\n  x_offset: 160\n  y_offset: 120\n  height: 240\n  width: 320\n  do_rectify: false\n";
    let numbers = |calibration: Calibration| {
        let Intrinsics { fx_px, fy_px, cx_px, cy_px, width, height } = calibration.camera().intrinsics;
        ([fx_px, fy_px, cx_px, cy_px], [width, height])
    };
    let cropped = with(roi).unwrap();
    assert_eq!(numbers(cropped), ([500.5, 501.25, 161.25, 118.75], [320, 240]));
    let with_binning = with(&format!("binning_x: 2\nbinning_y: 2\n{roi}")).unwrap();
    assert_eq!(numbers(with_binning), ([250.25, 250.625, 80.375, 59.125], [160, 120]));
    let outside = with(&roi.replace("160", "400")).unwrap_err();
    assert!(matches!(outside, CalibrationError::Region(_)), "{outside}");
}

#[test]
fn older_key_names_of_opencv_are_read() {
    let expected = Calibration::parse(WEBCAM).unwrap();
    for (key, older) in [
        ("camera_matrix", "Camera_Matrix"),
        ("camera_matrix", "cameraMatrix"),
        ("distortion_coefficients", "Distortion_Coefficients"),
        ("distortion_coefficients", "distCoeffs"),
        ("image_width", "image_Width"),
        ("image_height", "image_Height"),
    ] {
        assert_eq!(Calibration::parse(&WEBCAM.replace(key, older)).unwrap(), expected, "{older}");
    }
}

#[test]
fn comments_and_directives_before_a_file_are_passed_over() {
    let expected = Calibration::parse(WEBCAM);
    for before in [
        "---\n",
        "# front\n",
        "# front\n---\n",
        "%YAML 1.2\n---\n",
        "\n\n",
        "\u{feff}",
        "%YAML:1.0\r\n---\r\n",
    ] {
        assert_eq!(Calibration::parse(&format!("{before}{WEBCAM}...\n")), expected, "{before:?}");
    }
    let error = refusal("# front\n---\nimage_width: wide\n");
    assert!(error.to_string().contains("line 3"), "{error}");
}

#[test]
fn intrinsics_out_of_range_have_one_hint() {
    let error = refusal_with("305.593336", "9000");
    let CalibrationError::Intrinsics { source, .. } = &error else { panic!("{error}") };
    assert!(error.hint().is_none() && source.hint().is_some());
}
