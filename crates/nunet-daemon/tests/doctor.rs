//! `nunetd doctor --json` and `nunetd --version`. Doctor runs with a root folder of its own, apart from other
//! cameras.

use std::collections::HashSet;
use std::path::PathBuf;
use std::time::Instant;

use serde_json::Value;

use crate::support::{Bench, Guarded, TIMEOUT, nunetd, run, text};

/// Exit code and report.
fn doctor(bench: &Bench, model: &str) -> (Option<i32>, Value) {
    let mut command = nunetd(&["-q", "doctor", "--json", "--provider", "cpu", "--model", &bench.arg(model)]);
    bench.enclose(&mut command);
    let output = run(command);
    let report = serde_json::from_slice(&output.stdout);
    (output.status.code(), report.unwrap_or_else(|error| panic!("{error}: {}", text(&output.stderr))))
}

fn check<'a>(report: &'a Value, name: &str) -> &'a Value {
    let checks = report["checks"].as_array().unwrap();
    checks.iter().find(|check| check["name"] == name).unwrap_or_else(|| panic!("no `{name}` in {report}"))
}

#[test]
fn the_report_names_every_check_and_the_nodes_of_each_provider() {
    let bench = Bench::new();
    let (code, report) = doctor(&bench, "model.onnx");
    assert_eq!(report["contract"], 1);
    let checks = report["checks"].as_array().unwrap();
    // The machine may have problems of its own; the report and the exit code must agree about them.
    let well = checks.iter().all(|check| check["ok"] == true);
    assert_eq!((&report["ok"], code), (&well.into(), Some(i32::from(!well))), "{report:#}");
    for found in checks {
        assert!(found["detail"].as_str().is_some_and(|detail| !detail.is_empty()), "{found}");
        assert!(found["ok"] == false || found["hint"].is_null(), "{found}");
    }
    for name in [
        "library",
        "model",
        "provider",
        "self-test",
        "network",
        "shared memory",
        "orphans",
        "cache",
        "published",
    ] {
        assert_eq!(check(&report, name)["ok"], true, "{report:#}");
    }
    let network = check(&report, "network")["detail"].as_str().unwrap();
    assert!(network.contains("telemetry is off"), "{network}");
    let sticky = ["/dev/shm", "/tmp"].map(|folder| format!("sticky bit of {folder}"));
    let others = ["permissions", "access", "overcommit", "clock", "logout"];
    for name in sticky.iter().map(String::as_str).chain(others) {
        check(&report, name);
    }
    let names: HashSet<_> = checks.iter().map(|check| check["name"].as_str().unwrap()).collect();
    assert_eq!(names.len(), checks.len(), "each name once: {names:?}");
    let provider = check(&report, "provider")["detail"].as_str().unwrap();
    let nodes =
        provider.strip_prefix("cpu: ").and_then(|text| text.strip_suffix(" nodes on CPUExecutionProvider"));
    assert!(nodes.is_some_and(|nodes| nodes.parse::<u32>().unwrap() > 1), "{provider}");
}

#[test]
fn a_missing_model_is_a_problem_with_a_hint_and_the_other_checks_run() {
    let bench = Bench::new();
    let (code, report) = doctor(&bench, "missing.onnx");
    assert_eq!((code, &report["ok"]), (Some(1), &false.into()));
    let model = check(&report, "model");
    assert_eq!(model["ok"], false);
    assert!(model["detail"].as_str().unwrap().contains("missing.onnx"), "{model}");
    assert!(model["hint"].as_str().is_some_and(|hint| !hint.is_empty()), "{model}");
    assert_eq!(check(&report, "library")["ok"], true);
    check(&report, "clock");
}

#[test]
fn cameras_that_are_published_are_named_by_doctor_and_by_a_watch_that_finds_none() {
    let bench = Bench::new();
    let model = bench.arg("model.onnx");
    let daemon = |camera: &str| {
        let mut command =
            nunetd(&["-q", "--model", &model, "--source", "demo", "--rate", "5", "--camera", camera]);
        bench.enclose(&mut command);
        Guarded::start(command)
    };
    let daemons = ["rear", "front"].map(daemon);
    let start = Instant::now();
    let published = loop {
        let (_, report) = doctor(&bench, "model.onnx");
        let published = check(&report, "published")["detail"].as_str().unwrap().to_owned();
        if published.contains("rear") && published.contains("front") {
            break published;
        }
        assert!(start.elapsed() < TIMEOUT, "{published}");
    };
    assert_eq!(published, "depth of `front`, `rear`; no images");
    let mut command = nunetd(&["watch", "fornt", "--timeout", "0.2"]);
    bench.enclose(&mut command);
    let output = run(command);
    assert_eq!(output.status.code(), Some(1));
    let expected = "error: no `nunet/fornt/depth` after 0.2 s\nhint: published cameras: `front`, `rear`\n";
    assert_eq!(text(&output.stderr), expected);
    for mut daemon in daemons {
        assert_eq!(daemon.stop(), Some(0));
    }
    let left = bench.shared_memory();
    let is_counter = |file: &PathBuf| file.to_string_lossy().ends_with(".global_mgmt");
    assert!(left.len() <= 1 && left.iter().all(is_counter), "{left:?}");
}

#[test]
fn the_version_names_commit_contract_and_the_onnx_runtime_that_is_found() {
    let bench = Bench::new();
    let version = |library: &str| {
        let mut command = nunetd(&["--version"]);
        command.env("ORT_DYLIB_PATH", library);
        bench.enclose(&mut command);
        let output = run(command);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        text(&output.stdout).lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let library = nunet_testkit::runtime_library();
    let lines = version(&library.to_string_lossy());
    assert!(lines[0].starts_with(concat!("nunetd ", env!("CARGO_PKG_VERSION"), " (")), "{lines:?}");
    assert_eq!(lines[1], "contract 1");
    let found = lines[2].strip_prefix("ONNX Runtime 1.").unwrap_or_else(|| panic!("{lines:?}"));
    assert!(found.contains(&library.display().to_string()), "{found}");
    assert_eq!(
        version("/nonexistent/lib.so")[2],
        "ONNX Runtime: no ONNX Runtime library at `/nonexistent/lib.so`"
    );
}
