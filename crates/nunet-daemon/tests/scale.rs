//! `--scale`: where the factor of depth comes from, and what conflicts.

use serde_json::Value;

use crate::support::{Bench, SIZE, calibration, nunetd, run, run_well, text};

/// The stats of `infer` with these arguments.
fn inferred(bench: &Bench, rest: &[&str]) -> Value {
    let (model, photo, out) = (bench.arg("model.onnx"), bench.arg("photo.png"), bench.arg("out"));
    let arguments = ["-q", "infer", &photo, "--out", &out, "--model", &model];
    run_well(nunetd(&[&arguments, rest].concat()));
    serde_json::from_slice(&std::fs::read(bench.path("out/stats.json")).unwrap()).unwrap()
}

/// The exit code and the message of `infer` with these arguments.
fn refused(bench: &Bench, rest: &[&str]) -> (Option<i32>, String) {
    let (model, photo, out) = (bench.arg("model.onnx"), bench.arg("photo.png"), bench.arg("out"));
    let arguments = ["-q", "infer", &photo, "--out", &out, "--model", &model];
    let output = run(nunetd(&[&arguments, rest].concat()));
    (output.status.code(), text(&output.stderr))
}

fn bench_with_photo() -> Bench {
    let bench = Bench::new();
    bench.add_image("photo.png", 7);
    let lens = calibration(SIZE, [500.0, 500.0, 320.0, 240.0], "plumb_bob", &[0.0; 5]);
    std::fs::write(bench.path("plain.yaml"), &lens).unwrap();
    std::fs::write(bench.path("scaled.yaml"), lens + "nunet_scale:\n  factor: 0.5\n").unwrap();
    bench
}

#[test]
fn a_number_multiplies_depth_whatever_the_focal_length() {
    let bench = bench_with_photo();
    inferred(&bench, &["--scale", "off"]);
    let own = bench.depth("out");
    let stats = inferred(&bench, &["--scale", "0.5", "--calibration", &bench.arg("plain.yaml")]);
    assert_eq!((&stats["scale_source"], &stats["scale_factor"]), (&"calibrated".into(), &0.5.into()));
    assert_eq!(stats["scale_age_s"], 0.0);
    let halved = bench.depth("out");
    assert!(own.iter().zip(&halved).all(|(own, half)| own.is_nan() || own * 0.5 == *half));
}

#[test]
fn the_factor_of_a_calibration_file_is_used_unless_scale_is_off() {
    let bench = bench_with_photo();
    let file = bench.arg("scaled.yaml");
    let stats = inferred(&bench, &["--calibration", &file]);
    assert_eq!((&stats["scale_source"], &stats["scale_factor"]), (&"calibrated".into(), &0.5.into()));
    let stats = inferred(&bench, &["--calibration", &file, "--scale", "off"]);
    assert_eq!((&stats["scale_source"], &stats["scale_factor"]), (&"metric".into(), &1.0.into()));
}

#[test]
fn the_factor_of_another_model_is_ignored_with_a_warning() {
    let bench = bench_with_photo();
    let text_of = |name| std::fs::read_to_string(bench.path(name)).unwrap();
    let of_another = text_of("scaled.yaml") + &format!("  model_sha256: \"{}\"\n", "0a".repeat(32));
    std::fs::write(bench.path("other.yaml"), of_another).unwrap();
    let (model, photo, out) = (bench.arg("model.onnx"), bench.arg("photo.png"), bench.arg("out"));
    let file = bench.arg("other.yaml");
    let output =
        run_well(nunetd(&["infer", &photo, "--out", &out, "--model", &model, "--calibration", &file]));
    let stats: Value = serde_json::from_str(&text_of("out/stats.json")).unwrap();
    assert_ne!(stats["scale_source"], "calibrated");
    let log = text(&output.stderr);
    assert!(log.lines().any(|line| line.contains("WARN") && line.contains("factor 0.5 ")), "{log}");
}

#[test]
fn settings_that_conflict_or_cannot_be_are_bad_arguments() {
    let bench = bench_with_photo();
    let file = bench.arg("scaled.yaml");
    let up = ["--scale", "floor", "--mount", "0,0,0.5,0,-1.5,0"];
    for (rest, words) in [
        (&["--scale", "2", "--focal", "off"][..], "cannot be used with"),
        (&["--scale", "0.8", "--calibration", &file], "0.8 conflicts with the factor 0.5"),
        (&["--scale", "floor"], "hint: pass --mount"),
        (&["--scale", "floor", "--mount", "0,0,-1,0,0,0"], "above the floor"),
        (&up, "degrees up"),
        (&["--scale", "floor", "--mount", "0,0,1,0,0,0"], "no class for floor"),
        (&["--scale", "wide"], "expected `auto`, `off`, `floor` or a number, got `wide`"),
        (&["--scale", "1000"], "expected 0.05 to 20"),
    ] {
        let (code, stderr) = refused(&bench, rest);
        assert!(code == Some(2) && stderr.contains(words), "{rest:?}: {code:?} {stderr}");
    }
}
