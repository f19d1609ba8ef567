//! What the command line says of mistakes: `config` refuses what `run` refuses, and errors follow the log format.

use serde_json::Value;

use crate::support::{Bench, camera, nunetd, run, text};

/// The error of a command: its exit code, and its lines without log lines.
fn error_of(arguments: &[&str]) -> (Option<i32>, String) {
    let output = run(nunetd(arguments));
    let stderr = text(&output.stderr);
    let from = stderr.find("error: ").unwrap_or_else(|| panic!("{arguments:?} has no error: {stderr}"));
    (output.status.code(), stderr[from..].to_owned())
}

#[test]
fn config_refuses_files_that_run_refuses_with_the_same_words() {
    let bench = Bench::new();
    let (model, name) = (bench.arg("model.onnx"), camera("config"));
    let (missing, no_folder) = (bench.arg("missing"), bench.arg("missing/a.mcap"));
    let good = ["--model", &model, "--source", "demo", "--camera", &name];
    let (no_recording, no_video) = (bench.arg("missing.mcap"), "/dev/video-of-nobody");
    for bad in [
        ["--model", &missing],
        ["--calibration", &missing],
        ["--source", &missing],
        ["--source", &no_recording],
        ["--source", no_video],
        ["--record", &no_folder],
        ["--stats-json", &no_folder],
    ] {
        // The last one of two equal flags would be an error: the good one is omitted.
        let others = good.chunks(2).filter(|pair| pair[0] != bad[0]).flatten().copied();
        let arguments: Vec<&str> = others.chain(bad).chain(["--frames", "1"]).collect();
        let by_run = error_of(&[&["-q", "run"][..], &arguments].concat());
        let by_config = error_of(&[&["-q", "config"][..], &arguments].concat());
        assert_eq!(by_config, by_run, "{bad:?}");
    }
    let fine = run(nunetd(&[&["-q", "config"][..], &good].concat()));
    assert_eq!(fine.status.code(), Some(0), "{}", text(&fine.stderr));
}

/// The only line of stderr, as JSON.
fn json_error(arguments: &[&str], code: i32) -> Value {
    let output = run(nunetd(arguments));
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{stderr}");
    let last = stderr.lines().last().expect("an error is printed");
    let error: Value = serde_json::from_str(last).unwrap_or_else(|_| panic!("not JSON: {stderr}"));
    assert!(stderr.lines().all(|line| serde_json::from_str::<Value>(line).is_ok()), "{stderr}");
    assert_eq!((&error["level"], &error["exit_code"]), (&"ERROR".into(), &code.into()), "{error}");
    error
}

#[test]
fn fatal_errors_are_json_if_the_log_is() {
    let bench = Bench::new();
    let missing = bench.arg("missing.onnx");
    let error = json_error(&["--log-format", "json", "inspect", &missing], 2);
    assert!(error["message"].as_str().unwrap().contains("missing.onnx"), "{error}");
    let error = json_error(&["run", "--frames", "0", "--log-format=json"], 2);
    assert!(error["message"].as_str().unwrap().contains("expected a whole number"), "{error}");
    let error = json_error(&["--log-format", "json", "inferr"], 2);
    assert_eq!(error["message"], "`inferr` is not a subcommand of nunetd");
    assert!(error["hint"].as_str().unwrap().starts_with("one of run, infer"), "{error}");
}

#[test]
fn a_camera_that_does_not_fit_ends_run_and_feed_at_the_first_frame() {
    let bench = Bench::new();
    let (model, name) = (bench.arg("model.onnx"), camera("misfit"));
    // The demo is 320x240 and has no end.
    let camera = ["--intrinsics", "500,500,320,180@640x360", "--camera", &name];
    for subcommand in [&["run", "--model", &model, "--source", "demo"][..], &["feed", "demo"]] {
        let (code, error) = error_of(&[&["-q"][..], subcommand, &camera].concat());
        assert_eq!(code, Some(2), "{error}");
        assert!(error.starts_with("error: the given calibration or intrinsics do not fit"), "{error}");
        assert!(error.contains("320x240") && error.lines().count() < 6, "{error}");
    }
}
