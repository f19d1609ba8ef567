//! `nunetd infer`: files that hold what the network said.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt as _;
use std::process::Output;

use nunet_testkit::models;

use crate::support::{Bench, SIZE, nunetd, outcome, run, run_well, snapshot, text};

#[test]
fn the_files_of_an_image_have_the_hand_computed_values() {
    let bench = Bench::new();
    bench.add_image("photo.png", 7);
    let (model, photo, out) = (bench.arg("model.onnx"), bench.arg("photo.png"), bench.arg("out"));
    run_well(nunetd(&["-q", "infer", &photo, "--out", &out, "--model", &model, "--focal", "off"]));
    let rgb = image::open(&photo).unwrap().into_rgb8();
    let depth = bench.depth("out");
    let labels = image::open(bench.path("out/labels.png")).unwrap().into_luma8();
    let millimeters = image::open(bench.path("out/depth_mm.png")).unwrap().into_luma16();
    for (index, pixel) in rgb.pixels().enumerate() {
        let expected = models::connected_depth(pixel.0);
        assert_eq!(depth[index], expected, "pixel {index}");
        assert_eq!(labels.as_raw()[index], models::label(pixel.0), "pixel {index}");
        assert_eq!(f32::from(millimeters.as_raw()[index]), (expected * 1000.0).round(), "pixel {index}");
    }
    let stats: serde_json::Value =
        serde_json::from_slice(&std::fs::read(bench.path("out/stats.json")).unwrap()).unwrap();
    let latency = &stats["latency_ms"];
    let stages: f64 =
        latency["stages"].as_object().unwrap().values().map(|stage| stage["max"].as_f64().unwrap()).sum();
    let total = latency["total"]["max"].as_f64().unwrap();
    assert!(total >= stages && stages > 0.0, "`read` is a part of the total: {latency}");
    let classes = stats["classes"].as_array().unwrap();
    assert!(
        classes.len() > usize::from(*labels.as_raw().iter().max().unwrap()),
        "a name for each label: {stats}"
    );
    assert!(classes.iter().all(|name| name.as_str().is_some_and(|name| !name.is_empty())), "{stats}");
}

/// The signal SIGXFSZ would end the process.
#[test]
fn a_file_larger_than_the_limit_of_the_process_is_an_error_that_names_it() {
    let bench = Bench::new();
    bench.add_image("photo.png", 7);
    let (model, photo, out) = (bench.arg("model.onnx"), bench.arg("photo.png"), bench.arg("out"));
    let infer = nunetd(&["-q", "infer", &photo, "--out", &out, "--model", &model]);
    let mut limited = std::process::Command::new("/bin/sh");
    limited.args(["-c", "ulimit -f 200; exec \"$0\" \"$@\""]).arg(infer.get_program()).args(infer.get_args());
    limited.envs(infer.get_envs().filter_map(|(name, value)| Some((name, value?))));
    let output = run(limited);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("depth.npy`") && stderr.contains("os error 27"), "{stderr}");
}

#[test]
fn a_small_photograph_is_enlarged_to_the_networks_size() {
    let bench = Bench::new();
    let photo = image::RgbImage::from_fn(32, 24, |x, _| image::Rgb([if x < 16 { 10 } else { 200 }, 0, 0]));
    photo.save(bench.path("small.png")).unwrap();
    let (model, small, out) = (bench.arg("model.onnx"), bench.arg("small.png"), bench.arg("out"));
    run_well(nunetd(&["-q", "infer", &small, "--out", &out, "--model", &model, "--focal", "off"]));
    let depth = bench.depth("out");
    assert_eq!(depth[0], models::connected_depth([10, 0, 0]));
    assert_eq!(depth[SIZE.0 as usize - 1], models::connected_depth([200, 0, 0]));
}

#[test]
fn folders_and_globs_are_accepted() {
    let bench = Bench::new();
    for (name, frame) in [("folder/a.png", 0), ("folder/b.jpg", 1), ("more/c.png", 2), ("more/d.png", 3)] {
        bench.add_image(name, frame);
    }
    std::fs::write(bench.path("folder/notes.txt"), "no image").unwrap();
    let (model, folder, glob, out) =
        (bench.arg("model.onnx"), bench.arg("folder"), bench.arg("more/c*.png"), bench.arg("out"));
    run_well(nunetd(&["-q", "infer", &folder, &glob, "--out", &out, "--model", &model]));
    let mut made: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    made.sort();
    assert_eq!(made, ["a", "b", "c"]);
}

#[test]
fn a_file_that_is_no_image_is_reported_before_the_network_is_loaded_and_leaves_no_folder() {
    let bench = Bench::new();
    std::fs::write(bench.path("photo.bmp"), b"BM\x46\0\0\0").unwrap();
    let (bmp, missing, out) = (bench.arg("photo.bmp"), bench.arg("missing.png"), bench.arg("out"));
    let infer = |image: &str| {
        outcome(&bench, nunetd(&["-q", "infer", image, "--out", &out, "--model", "no_such_model.onnx"]))
    };
    snapshot!([infer(&bmp), infer(&missing)].join("\n\n"));
    assert!(!bench.path("out").exists(), "a folder of results without a result");
}

#[test]
fn an_image_that_cannot_be_decoded_leaves_no_folder() {
    let bench = Bench::new();
    bench.add_image("whole.png", 0);
    let whole = std::fs::read(bench.path("whole.png")).unwrap();
    std::fs::write(bench.path("cut.png"), &whole[..whole.len() / 3]).unwrap();
    let (model, cut, out) = (bench.arg("model.onnx"), bench.arg("cut.png"), bench.arg("new/out"));
    let output = run(nunetd(&["-q", "infer", &cut, "--out", &out, "--model", &model]));
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    assert!(!bench.path("new").exists());
    let taken = bench.arg("cut.png/out");
    let output =
        run(nunetd(&["-q", "infer", &bench.arg("whole.png"), "--out", &taken, "--model", "missing"]));
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text(&output.stderr).contains("cut.png`"),
        "it is reported before the model: {}",
        text(&output.stderr)
    );
}

/// Bytes of a file, to see that nothing has changed them.
fn bytes(bench: &Bench, name: &str) -> Vec<u8> {
    std::fs::read(bench.path(name)).unwrap()
}

#[test]
fn no_output_is_an_input_or_another_output() {
    let bench = Bench::new();
    bench.add_image("io/depth.png", 0);
    bench.add_image("io/two/a.png", 1);
    std::fs::write(bench.path("run.toml"), "source = \"demo\"\n").unwrap();
    let (model, io) = (bench.arg("model.onnx"), bench.arg("io"));
    let (image, stats, config) = (bench.arg("io/depth.png"), bench.arg("s.json"), bench.arg("run.toml"));
    let mcap = bench.arg("s.mcap");
    let before = (bytes(&bench, "io/depth.png"), bytes(&bench, "model.onnx"), bytes(&bench, "run.toml"));
    let refusals = [
        &["infer", &image, "--model", &model, "--out", &io][..],
        &["--source", &io, "--out", &io],
        &["--source", &io, "--record", &bench.arg("io/new.mcap")],
        &["--source", "demo", "--record", &model, "--force"],
        &["--source", "demo", "--record", &mcap, "--stats-json", &mcap],
        &["--source", &image, "--stats-json", &image],
        &["--config", &config, "--stats-json", &config],
        &["--source", "demo", "--out", &io, "--stats-json", &bench.arg("io/labels.png")],
    ]
    .map(|arguments| {
        let once = ["--model", &model, "--frames", "1"];
        let rest = if arguments[0] == "infer" { &[][..] } else { &once[..] };
        let outcome = outcome(&bench, nunetd(&[&["-q"][..], arguments, rest].concat()));
        format!("{}\n{outcome}", bench.redact(&arguments.join(" ")))
    });
    let after = (bytes(&bench, "io/depth.png"), bytes(&bench, "model.onnx"), bytes(&bench, "run.toml"));
    assert!(before == after, "an input was changed");
    snapshot!(refusals.join("\n\n"));
    assert!(![stats, mcap].iter().any(|file| std::path::Path::new(file).exists()), "something was created");
}

#[test]
fn a_secret_is_not_printed_and_not_ignored() {
    let mut command = nunetd(&["-q", "--source", "demo", "--frames", "1", "--view", "127.0.0.1:0"]);
    command.env("NUNET_VIEW_TOKEN", "my secret");
    let bad = outcome(&Bench::new(), command);
    assert!(!bad.contains("secret"), "{bad}");
    let unused = outcome(&Bench::new(), nunetd(&["-q", "--source", "demo", "--view-token", "abc"]));
    snapshot!([bad, unused].join("\n\n"));
}

/// `nunetd config` with a value of the variable, and other flags.
fn config_with_token(token: &OsStr, rest: &[&str]) -> Output {
    let bench = Bench::new();
    let model = bench.arg("model.onnx");
    let mut command = nunetd(&[&["-q", "config", "--source", "demo", "--model", &model], rest].concat());
    command.env("NUNET_VIEW_TOKEN", token);
    run(command)
}

#[test]
fn a_token_in_the_environment_is_ignored_without_the_view_and_unset_if_it_is_empty() {
    let loopback = ["--view", "127.0.0.1:0"];
    for token in [&b""[..], b"my secret", b"\xff", &[b'x'; 300]].map(OsStr::from_bytes) {
        let output = config_with_token(token, &[]);
        assert_eq!(output.status.code(), Some(0), "{token:?}: {}", text(&output.stderr));
        let code = if token.is_empty() { 0 } else { 2 };
        let output = config_with_token(token, &loopback);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{token:?}: {error}");
        assert_eq!(error.contains("NUNET_VIEW_TOKEN"), code == 2, "{error}");
    }
    let output = config_with_token(OsStr::new(""), &["--view", "0.0.0.0:0"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    // A user who passes an empty token wants one.
    let output = config_with_token(OsStr::new("abc"), &[&loopback[..], &["--view-token", ""]].concat());
    let error = text(&output.stderr);
    assert!(output.status.code() == Some(2) && error.contains("--view-token"), "{error}");
    let output = config_with_token(OsStr::new("abc"), &["--view-token", "abc"]);
    assert_eq!(output.status.code(), Some(2), "no --view: {}", text(&output.stderr));
}

#[test]
fn the_printed_configuration_names_the_variable_of_the_token_and_not_its_value() {
    let view = ["--view", "127.0.0.1:0"];
    let printed = |rest: &[&str]| {
        let output = config_with_token(OsStr::new("s3cret"), rest);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let printed = text(&output.stdout);
        assert!(!printed.contains("s3cret"), "{printed}");
        printed
    };
    assert!(printed(&view).contains("\n# view-token is set by NUNET_VIEW_TOKEN\n"), "{}", printed(&view));
    assert!(printed(&[]).contains("\n# view-token is not set\n"), "{}", printed(&[]));
    let of_flag = printed(&[&view[..], &["--view-token", "abc"]].concat());
    assert!(of_flag.contains("\nview-token = \"abc\"\n"), "a file that --config takes: {of_flag}");
}

#[test]
fn a_negative_number_is_a_value_and_not_a_flag() {
    for flag in ["--frames", "--rate", "--max-range", "--threads"] {
        let output = run(nunetd(&["-q", "--source", "demo", flag, "-1"]));
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr.contains(flag) && stderr.contains("`-1`"), "{flag}: {stderr}");
    }
}

#[test]
fn a_root_of_shared_memory_that_is_a_file_is_not_called_another_users() {
    let bench = Bench::new();
    std::fs::write(bench.path("f"), "").unwrap();
    let mut command = nunetd(&["-q", "watch", "nobody", "--timeout", "1"]);
    command.env("NUNET_IPC_ROOT", bench.path("f"));
    snapshot!(outcome(&bench, command));
}
