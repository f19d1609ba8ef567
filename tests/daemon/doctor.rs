//! `nunetd doctor --json`, in a world of its own: what others left behind is none of its business.

use serde_json::Value;

use crate::support::{Bench, nunetd, run, text};

/// Exit code and report.
fn doctor(bench: &Bench, model: &str) -> (Option<i32>, Value) {
    std::fs::create_dir_all(bench.path("config")).unwrap();
    let root = bench.arg("shared");
    let config =
        format!("[global]\nroot-path = \"{root}\"\nprefix = \"nunetdoctor{}_\"\n", std::process::id());
    std::fs::write(bench.path("config/iceoryx2.toml"), config).unwrap();
    let mut command = nunetd(&["-q", "doctor", "--json", "--provider", "cpu", "--model", &bench.arg(model)]);
    command.current_dir(bench.path(""));
    let output = run(command);
    let report = serde_json::from_slice(&output.stdout);
    (output.status.code(), report.unwrap_or_else(|error| panic!("{error}: {}", text(&output.stderr))))
}

fn check<'a>(report: &'a Value, name: &str) -> &'a Value {
    let checks = report["checks"].as_array().unwrap();
    checks.iter().find(|check| check["name"] == name).unwrap_or_else(|| panic!("no `{name}` in {report}"))
}

#[test]
fn the_report_names_every_check_and_says_who_computes_how_many_nodes() {
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
    for name in ["library", "model", "provider", "self-test", "shared memory", "orphans", "cache"] {
        assert_eq!(check(&report, name)["ok"], true, "{report:#}");
    }
    for name in ["sticky bits", "permissions", "overcommit", "clock", "logout"] {
        check(&report, name);
    }
    let provider = check(&report, "provider")["detail"].as_str().unwrap();
    let nodes =
        provider.strip_prefix("cpu: ").and_then(|text| text.strip_suffix(" nodes on CPUExecutionProvider"));
    assert!(nodes.is_some_and(|nodes| nodes.parse::<u32>().unwrap() > 1), "{provider}");
}

#[test]
fn a_model_that_is_missing_is_a_problem_with_its_mend_and_the_other_checks_go_on() {
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
