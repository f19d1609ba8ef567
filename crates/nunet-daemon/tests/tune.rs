//! `nunetd tune`: the fastest provider and thread count on this machine, as a report and as a configuration.

use serde_json::Value;

use crate::support::{Bench, nunetd, outcome, run_well, snapshot, text};

#[test]
fn every_combination_is_measured_and_the_best_one_written_as_a_configuration() {
    let bench = Bench::new();
    let (model, out) = (bench.arg("model.onnx"), bench.arg("tuned.toml"));
    let arguments = ["-q", "tune", &model, "--provider", "cpu", "--runs", "2", "--json", "--out", &out];
    let found: Value = serde_json::from_slice(&run_well(nunetd(&arguments)).stdout).unwrap();
    assert_eq!(found["contract"], 1);
    let cores = std::thread::available_parallelism().unwrap().get() as u64;
    let all = found["combinations"].as_array().unwrap();
    assert_eq!((&all[0]["threads"], &all[all.len() - 1]["threads"]), (&1.into(), &cores.into()));
    assert!(all.iter().all(|one| one["end_to_end_ms"]["p50"].as_f64().unwrap() > 0.0), "{found}");
    let config = std::fs::read_to_string(bench.path("tuned.toml")).unwrap();
    let threads = &found["best"]["threads"];
    assert_eq!(config, format!("model = \"{model}\"\nprovider = \"cpu\"\nthreads = {threads}\n"));
    let checked = run_well(nunetd(&["-q", "config", "--config", &out, "--source", "demo"]));
    assert!(text(&checked.stdout).contains(&format!("threads = {threads}")), "{}", text(&checked.stdout));
}

#[test]
fn the_text_output_names_the_flags() {
    let bench = Bench::new();
    let model = bench.arg("model.onnx");
    let arguments = ["-q", "tune", &model, "--provider", "cpu", "--threads", "1", "--runs", "2"];
    let table = text(&run_well(nunetd(&arguments)).stdout);
    assert!(table.starts_with("model.onnx\n") && table.contains("\n  cpu 1 "), "{table}");
    assert!(table.contains("\n--provider cpu --threads 1: "), "{table}");
}

#[test]
fn an_existing_file_is_not_overwritten_and_a_missing_model_is_named() {
    let bench = Bench::new();
    std::fs::write(bench.path("mine.toml"), "rate = 30\n").unwrap();
    let (model, out) = (bench.arg("model.onnx"), bench.arg("mine.toml"));
    let existing = outcome(&bench, nunetd(&["-q", "tune", &model, "--out", &out]));
    assert_eq!(std::fs::read_to_string(bench.path("mine.toml")).unwrap(), "rate = 30\n");
    // Nothing is measured in vain: each prints nothing.
    let no_folder = outcome(&bench, nunetd(&["-q", "tune", &model, "--out", &bench.arg("none/tuned.toml")]));
    let no_model = outcome(&bench, nunetd(&["-q", "tune", &bench.arg("none.onnx")]));
    snapshot!([existing, no_folder, no_model].join("\n\n"));
}
