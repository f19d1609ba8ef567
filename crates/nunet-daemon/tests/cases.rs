//! Inputs that users really have, through `nunetd`: depth and metrics have the right values.

use nunet_testkit::cases;
use serde_json::Value;

use crate::support::{Bench, camera, nunetd, repository, run, run_well, text};

/// Adds `ch0_64x48`, whose depth is the red channel plus 1, as a network of another depth encoding.
fn add_network(bench: &Bench, encoding: &str) -> String {
    std::fs::write(bench.path("ch0.onnx"), cases::read("nets/ch0_64x48.onnx")).unwrap();
    let sidecar = String::from_utf8(cases::read("nets/ch0_64x48.toml")).unwrap();
    assert!(sidecar.contains("\"metric\""), "{sidecar}");
    std::fs::write(bench.path("ch0.toml"), sidecar.replace("\"metric\"", &format!("\"{encoding}\"")))
        .unwrap();
    bench.arg("ch0.onnx")
}

/// The report of `eval` about a case.
fn report(case: &str, encoding: &str, rest: &[&str]) -> Value {
    let (bench, data) = (Bench::new(), cases::path(case));
    let model = add_network(&bench, encoding);
    let arguments = ["-q", "eval", data.to_str().unwrap(), "--model", &model, "--json"];
    let output = run_well(nunetd(&[&arguments[..], rest].concat()));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[track_caller]
fn assert_measured(found: &Value, images: u64, rmse: f64, tolerance: f64) {
    assert_eq!((&found["pictures"], &found["skipped"]), (&images.into(), &0.into()), "{found}");
    assert_eq!((&found["pixels"], &found["pixels_beyond"]), (&(images * 64 * 48).into(), &0.into()));
    assert_near(&found["metrics"]["rmse"], rmse, tolerance);
}

#[track_caller]
fn assert_near(value: &Value, expected: f64, tolerance: f64) {
    let value = value.as_f64().unwrap();
    assert!((value - expected).abs() <= tolerance, "{value} instead of {expected}");
}

/// The image is 200 / depth, in whole levels: its smallest, 40, is up to 1.3 % off.
#[test]
fn disparity_up_to_scale_is_right_after_stretching_and_has_no_meters() {
    let found = report("relative_disparity/rel", "relative_inverse", &[]);
    assert_eq!((&found["units"], &found["pixels"]), (&"relative".into(), &(64 * 48).into()));
    assert_eq!(found["metrics"], Value::Object(serde_json::Map::new()), "no metrics in meters");
    assert_near(&found["minmax"]["rmse"], 0.0, 0.006);
    let swapped = report("relative_disparity/rel", "relative", &[]);
    assert!(swapped["minmax"]["rmse"].as_f64().unwrap() > 0.5, "near and far are swapped: {swapped}");
}

/// Depth as `compressedDepth` is 0.257 m per level of green; the network says the level of red plus 1. JPEG
/// decoders differ by a level or two.
#[test]
fn compressed_depth_is_compared() {
    let found = report("compressed_depth_eval/rgbd_compressed.mcap", "metric", &["--depth-cap", "300"]);
    assert_measured(&found, 1, 149.91, 1.0);
}

/// KITTI's unit of 1/256 m, and true depth of 30 m. The network says 101 m.
#[test]
fn true_depth_beyond_10_m_is_compared_up_to_a_cap_of_choice_which_the_hint_names() {
    let kitti = ["--depth-scale", "0.00390625"];
    let found = report("eval_beyond_10_m/kitti", "metric", &[&kitti[..], &["--depth-cap", "200"]].concat());
    assert_measured(&found, 2, 101.0 - 30.0, 1e-3);

    let bench = Bench::new();
    let (model, data) = (add_network(&bench, "metric"), cases::path("eval_beyond_10_m/kitti"));
    let arguments = ["-q", "eval", data.to_str().unwrap(), "--model", &model];
    let output = run(nunetd(&[&arguments[..], &kitti].concat()));
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.ends_with("hint: compare up to a larger distance: --depth-cap 31\n"), "{stderr}");
}

/// TUM's images and depth are 15 ms apart, and so are their names. True depth is 2 m with this unit, and the
/// network says 101 m.
#[test]
fn images_and_depth_that_are_named_by_different_times_are_joined() {
    let unit = ["--depth-scale", "0.0002", "--depth-cap", "200"];
    assert_measured(&report("tum_pairs/tum", "metric", &unit), 3, 101.0 - 2.0, 1e-3);
}

/// The median depth of a recording, by the bundled network.
fn median_m(case: &str, rest: &[&str]) -> f32 {
    let (bench, source, name) = (Bench::new(), cases::path(case), camera("t265"));
    let (model, out) = (repository().join("models/wnet_c.onnx"), bench.arg("out"));
    let (source, model) = (source.to_str().unwrap(), model.to_str().unwrap());
    let arguments = ["-q", "--source", source, "--model", model, "--camera", &name, "--out", &out];
    run_well(nunetd(&[&arguments[..], rest].concat()));
    let mut depth_m: Vec<f32> = bench.depth("out").into_iter().filter(|depth_m| !depth_m.is_nan()).collect();
    depth_m.sort_unstable_by(f32::total_cmp);
    depth_m[depth_m.len() / 2]
}

/// 1.35 m was measured when the recording was made. Newer weights of the network may differ by 15 %.
#[test]
fn a_fisheye_with_a_fifth_coefficient_of_zero_has_the_depth_of_four() {
    let [four, five] = ["4", "5"].map(|count| {
        let case = format!("camera_info_coefficients/t265_{count}.mcap");
        median_m(&case, &[])
    });
    assert!((five - 1.35).abs() < 0.2, "{five} m");
    assert_eq!(four, five);
    let unscaled = median_m("camera_info_coefficients/t265_5.mcap", &["--scale", "off"]);
    assert!(unscaled > 2.0 * five, "{unscaled} m without the camera's focal length, {five} m with it");
}
