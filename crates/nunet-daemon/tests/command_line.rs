//! What the command line says of mistakes: `config` refuses what `run` refuses, and errors follow the log
//! format.

use std::fs::OpenOptions;
use std::io::{BufRead as _, BufReader};
use std::net::TcpListener;
use std::process::Stdio;

use nunet_testkit::models;
use serde_json::Value;

use crate::support::{Bench, Guarded, SIZE, camera, nunetd, run, run_into, snapshot, text};

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

#[test]
fn config_refuses_topics_and_addresses_that_run_refuses() {
    let bench = Bench::new();
    bench.add_model("unet.onnx", &models::unet(SIZE));
    let (model, name) = (bench.arg("unet.onnx"), camera("config_network"));
    let config = |rest: &[&str]| {
        let all = ["-q", "config", "--model", &model, "--source", "demo", "--camera", &name];
        run(nunetd(&[&all[..], rest].concat()))
    };
    // The model has no labels.
    for topic in ["labels/image_raw", "labels/label_info", "labels/confidence", "scan"] {
        let output = config(&["--ros2", "dds", "--ros2-topics", topic]);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{topic}: {error}");
        assert!(error.contains(&format!("`{topic}`")), "{error}");
    }
    let output = config(&["--ros2", "dds", "--ros2-topics", "depth/points"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    // An address for documentation (RFC 5737), which no machine has.
    for flags in [
        &["--metrics", "192.0.2.1:8080"][..],
        &["--view", "192.0.2.1:8080", "--view-token", "t"],
        &["--foxglove", "192.0.2.1:8080", "--foxglove-public"],
    ] {
        let output = config(flags);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{flags:?}: {error}");
        assert!(error.contains("hint: choose an address of this machine"), "{error}");
    }
    // It may be a running nunetd that uses the port.
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let output = config(&["--metrics", &taken.local_addr().unwrap().to_string()]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
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
    assert!(error["message"].as_str().unwrap().contains("--frames"), "{error}");
    let error = json_error(&["--log-format", "json", "inferr"], 2);
    assert!(error["message"].as_str().unwrap().contains("`inferr`"), "{error}");
    assert!(error["hint"].as_str().unwrap().contains("run, infer, feed, "), "{error}");
}

#[test]
fn a_camera_that_does_not_fit_ends_run_and_feed_at_the_first_frame() {
    let bench = Bench::new();
    let (model, name) = (bench.arg("model.onnx"), camera("misfit"));
    // The demo is 320x240 and has no end.
    let camera = ["--intrinsics", "500,500,320,180@640x360", "--camera", &name];
    let subcommands = [&["run", "--model", &model, "--source", "demo"][..], &["feed", "demo"]];
    let [of_run, of_feed] =
        subcommands.map(|subcommand| error_of(&[&["-q"][..], subcommand, &camera].concat()));
    assert_eq!(of_run, of_feed);
    assert_eq!(of_run.0, Some(2), "{}", of_run.1);
    snapshot!(of_run.1);
}

#[test]
fn the_contract_has_one_format_which_must_be_asked_for() {
    let (code, error) = error_of(&["contract"]);
    assert_eq!(code, Some(2), "{error}");
    assert!(error.contains("--json"), "{error}");
}

/// Subcommands that print results, and what stops without a model or a camera.
fn printing(model: &str) -> Vec<Vec<&str>> {
    vec![
        vec!["--version"],
        vec!["--help"],
        vec!["run", "--help"],
        vec!["-q", "contract", "--json"],
        vec!["-q", "config", "--model", model, "--source", "demo"],
        vec!["-q", "inspect", model],
        vec!["-q", "inspect", model, "--json"],
        vec!["-q", "doctor", "--model", model],
        vec!["-q", "bench", "--model", model, "--runs", "1"],
        vec!["-q", "tune", model, "--runs", "1", "--provider", "cpu"],
    ]
}

#[test]
fn results_that_cannot_be_written_are_a_failure() {
    let bench = Bench::new();
    for arguments in printing(&bench.arg("model.onnx")) {
        let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
        let output = run_into(nunetd(&arguments), full.into());
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {stderr}");
        let expected = "error: cannot write to standard output\n  because: No space left on device";
        assert!(stderr.contains(expected), "{arguments:?}: {stderr}");
    }
}

#[test]
fn a_reader_that_closes_the_pipe_ends_the_work_quietly() {
    let bench = Bench::new();
    for arguments in printing(&bench.arg("model.onnx")) {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = run_into(nunetd(&arguments), writer.into());
        assert_eq!((output.status.code(), text(&output.stderr).as_str()), (Some(0), ""), "{arguments:?}");
    }
}

#[test]
fn watch_ends_if_no_frame_comes_within_its_timeout() {
    let (bench, name) = (Bench::new(), camera("timeout"));
    let (code, error) = error_of(&["-q", "watch", &name, "--timeout", "0.2"]);
    assert_eq!(code, Some(1), "{error}");
    assert!(error.contains(&name) && error.contains("0.2 s"), "{error}");

    let model = bench.arg("model.onnx");
    let mut daemon =
        Guarded::start(nunetd(&["-q", "--model", &model, "--source", "demo", "--camera", &name]));
    let mut watch = nunetd(&["-q", "watch", &name, "--timeout", "2"]);
    let mut watch = watch.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(watch.stdout.take().unwrap()).lines();
    assert!(lines.next().unwrap().unwrap().starts_with("frame "), "it prints frames while there are some");
    assert_eq!(daemon.stop(), Some(0));
    lines.for_each(|line| drop(line.unwrap()));
    let output = watch.wait_with_output().unwrap();
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    snapshot!(stderr.lines().next().unwrap());
}

#[test]
fn a_root_of_shared_memory_that_cannot_be_created_is_explained_in_words() {
    let bench = Bench::new();
    let model = bench.arg("model.onnx");
    // Read-only in a container; elsewhere no user may create a folder there.
    let root = "/sys/nunet";
    let mut command = nunetd(&["-q", "--model", &model, "--source", "demo", "--frames", "1"]);
    let output = run({
        command.env("NUNET_IPC_ROOT", root);
        command
    });
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains(&format!("`{root}`")), "{stderr}");
    assert!(stderr.contains("\nhint: "), "{stderr}");
    for name in ["Error", "Failure", "Insufficient", "InternalError"] {
        assert!(!stderr.contains(name), "a name of iceoryx2: {stderr}");
    }
}

#[test]
fn a_file_name_cannot_add_a_line_to_the_log_or_to_an_error() {
    let bench = Bench::new();
    let (model, name) = (bench.arg("model.onnx"), "a`\nerror: b`\u{1b}[2J.png");
    std::fs::write(bench.path(name), "not an image").unwrap();
    bench.add_image("good.png", 0);
    let (bad, good, out) = (bench.arg(name), bench.arg("good.png"), bench.arg("out"));
    // Before the escape character, of which there are two spellings.
    let escaped = "a`\\nerror: b`\\";
    for images in [&[bad.as_str()][..], &[&bad, &good]] {
        let arguments = [&["infer", "--model", &model, "--out", &out][..], images].concat();
        let output = run(nunetd(&arguments));
        let stderr = text(&output.stderr);
        assert!(stderr.contains(escaped) && !stderr.contains('\u{1b}'), "{stderr}");
        assert!(!stderr.lines().any(|line| line.trim_start().starts_with("error: b")), "{stderr}");
    }
}
