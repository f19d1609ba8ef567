//! What a user sees when something is wrong: the message, the hint and the exit code, as snapshots.

use std::process::Command;

use nunet_testkit::onnx::{ModelBuilder, OnnxElement};
use nunet_testkit::{manifests, models};

use crate::support::{
    Bench, SIZE, calibration, camera, nunetd, outcome, run, run_well, seen, snapshot, text,
};

/// Tries a model file.
fn model(bench: &Bench, name: &str) -> String {
    let (model, camera) = (bench.arg(name), camera("bad_model"));
    outcome(
        bench,
        nunetd(&["-q", "--model", &model, "--source", "demo", "--frames", "1", "--camera", &camera]),
    )
}

/// Tries arguments with a good model.
fn arguments(bench: &Bench, rest: &[&str]) -> String {
    let (model, camera) = (bench.arg("model.onnx"), camera("bad_arguments"));
    let mut all = vec!["-q", "--model", &model, "--frames", "1", "--camera", &camera];
    all.extend(rest);
    outcome(bench, nunetd(&all))
}

#[test]
fn model_missing() {
    let bench = Bench::new();
    snapshot!(model(&bench, "no_such.onnx"));
}

#[test]
fn model_name_unknown() {
    let bench = Bench::new();
    snapshot!(outcome(&bench, nunetd(&["-q", "--model", "wnet_x", "--frames", "1"])));
}

#[test]
fn model_empty() {
    let bench = Bench::new();
    std::fs::write(bench.path("empty.onnx"), b"").unwrap();
    snapshot!(model(&bench, "empty.onnx"));
}

#[test]
fn model_truncated() {
    let bench = Bench::new();
    let whole = std::fs::read(bench.path("model.onnx")).unwrap();
    std::fs::write(bench.path("half.onnx"), &whole[..whole.len() / 2]).unwrap();
    snapshot!(model(&bench, "half.onnx"));
}

#[test]
fn model_is_not_onnx() {
    let bench = Bench::new();
    std::fs::write(bench.path("text.onnx"), "this is a text and not a network\n").unwrap();
    snapshot!(model(&bench, "text.onnx"));
}

#[test]
fn model_is_a_folder() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("folder.onnx")).unwrap();
    snapshot!(model(&bench, "folder.onnx"));
}

#[test]
fn model_that_never_ends() {
    let bench = Bench::new();
    std::fs::File::create(bench.path("huge.onnx")).unwrap().set_len(1 << 36).unwrap();
    snapshot!(model(&bench, "huge.onnx"));
}

/// What the child process does when the file is another than the one whose hash it was given.
#[test]
fn model_that_changed_after_it_was_hashed() {
    let bench = Bench::new();
    let output = run(nunetd(&["-q", "check-model", &bench.arg("model.onnx"), "--hash", &"0".repeat(64)]));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["kind"], "model");
    snapshot!(seen(&bench, &output));
}

#[test]
fn model_of_another_metadata_version() {
    let bench = Bench::new();
    bench.add_model("v2.onnx", &models::unet(SIZE).metadata("nunet.version", "2"));
    snapshot!(model(&bench, "v2.onnx"));
}

#[test]
fn model_without_metadata_and_sidecar() {
    let bench = Bench::new();
    bench.add_model("foreign.onnx", &models::undescribed_unet(SIZE));
    snapshot!(model(&bench, "foreign.onnx"));
}

#[test]
fn model_with_depth_of_the_wrong_type() {
    let bench = Bench::new();
    let (width, height) = (i64::from(SIZE.0), i64::from(SIZE.1));
    let to_double = [("to", (OnnxElement::F64 as i64).into())];
    let wrong = ModelBuilder::new()
        .input("rgb", OnnxElement::U8, &[1, height, width, 3])
        .constant_i64("shape", &[4], &[1, 3, height, width])
        .node("Cast", &["rgb"], &["double"], &to_double)
        .node("Reshape", &["double", "shape"], &["depth"], &[])
        .output("depth", OnnxElement::F64, &[1, 3, height, width]);
    bench.add_model("double.onnx", &models::describe(wrong, "unet", false));
    snapshot!(model(&bench, "double.onnx"));
}

#[test]
fn model_whose_numbers_are_wrong_on_this_machine() {
    let bench = Bench::new();
    let rows = |value: &str| format!("[{}]", vec![format!("[{}]", [value; 8].join(", ")); 6].join(", "));
    let selftest = format!(
        r#"{{"version": 1, "picture": "nunet-selftest-1", "precision": "fp32", "depth": {}, "tolerance": {{"fp32": {{"depth": 0.001, "label_cells": 0}}}}}}"#,
        rows("3.5")
    );
    bench.add_model("wrong.onnx", &models::unet(SIZE).metadata("nunet.selftest", &selftest));
    snapshot!(model(&bench, "wrong.onnx"));
}

/// A file that asks for more memory than the child may have is refused by name, whatever it would do to this
/// process.
#[test]
fn model_that_asks_for_all_the_memory() {
    let bench = Bench::new();
    let (width, height) = (i64::from(SIZE.0), i64::from(SIZE.1));
    let huge = ModelBuilder::new()
        .input("rgb", OnnxElement::U8, &[1, height, width, 3])
        .constant_i64("giant", &[4], &[1, 40_000, height, width])
        .node("Expand", &["zero", "giant"], &["all"], &[])
        .node("ReduceSum", &["all", "channels"], &["depth"], &[])
        .constant_f32("zero", &[1, 1, 1, 1], &[1.0])
        .constant_i64("channels", &[1], &[1])
        .output("depth", OnnxElement::F32, &[1, 1, height, width]);
    bench.add_model("huge.onnx", &models::describe(huge, "unet", false));
    let outcome = model(&bench, "huge.onnx");
    assert!(outcome.starts_with("exit code 1\nerror: "), "{outcome}");
}

#[test]
fn stages_that_do_not_fit() {
    let bench = Bench::new();
    bench.add_model("segmentation.onnx", &models::segmentation_stage(SIZE));
    bench.add_model("depth.onnx", &models::depth_stage((320, 240), true));
    std::fs::write(bench.path("mixed.toml"), manifests::two_stages(true, 1)).unwrap();
    snapshot!(model(&bench, "mixed.toml"));
}

#[test]
fn source_missing() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "no/such/folder"]));
}

#[test]
fn recording_missing() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "no_such.mcap"]));
}

#[test]
fn folder_of_a_recording_instead_of_its_file() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("bag")).unwrap();
    for file in ["metadata.yaml", "bag_1.mcap", "bag_0.mcap"] {
        std::fs::write(bench.path("bag").join(file), b"").unwrap();
    }
    let (bag, out) = (bench.arg("bag"), bench.arg("out.mcap"));
    let source = arguments(&bench, &["--source", &bag]);
    snapshot!(format!("{source}\n\n{}", outcome(&bench, nunetd(&["-q", "replay", &bag, &out]))));
}

#[test]
fn pipe_without_an_image() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "-", "--size", "10x10", "--format", "rgb8"]));
}

#[test]
fn recording_into_a_folder_that_does_not_exist() {
    let bench = Bench::new();
    let folder = bench.arg("nowhere/");
    snapshot!(arguments(&bench, &["--source", "demo", "--record", &folder]));
}

#[test]
fn source_folder_without_images() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("nothing")).unwrap();
    let folder = bench.arg("nothing");
    snapshot!(arguments(&bench, &["--source", &folder]));
}

#[test]
fn intrinsics_that_are_no_numbers() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--intrinsics", "525,nan,320,240"]));
}

#[test]
fn intrinsics_that_are_negative() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--intrinsics", "-525,525,320,240"]));
}

#[test]
fn intrinsics_that_are_too_few() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--intrinsics", "525,525,320"]));
}

/// Tries a calibration file of this text.
fn calibrated(text: &str) -> String {
    let bench = Bench::new();
    std::fs::write(bench.path("camera.yaml"), text).unwrap();
    let file = bench.arg("camera.yaml");
    arguments(&bench, &["--source", "demo", "--calibration", &file])
}

#[test]
fn calibration_missing() {
    let bench = Bench::new();
    let file = bench.arg("no_such.yaml");
    snapshot!(arguments(&bench, &["--source", "demo", "--calibration", &file]));
}

#[test]
fn calibration_that_is_empty() {
    snapshot!(calibrated(""));
}

#[test]
fn calibration_that_is_no_yaml() {
    snapshot!(calibrated("image_width: 640\nimage_height: {480\n"));
}

#[test]
fn calibration_without_a_lens() {
    snapshot!(calibrated(
        "image_width: 640\nimage_height: 480\ncamera_matrix: {rows: 3, cols: 3, data: [500, 0, 320, 0, 500, 240, 0, 0, 1]}\n"
    ));
}

#[test]
fn calibration_with_a_negative_focal_length() {
    snapshot!(calibrated(&calibration(SIZE, [-500.0, 500.0, 320.0, 240.0], "plumb_bob", &[0.0; 5])));
}

#[test]
fn calibration_with_more_coefficients_than_its_model_has() {
    snapshot!(calibrated(&calibration(
        SIZE,
        [500.0, 500.0, 320.0, 240.0],
        "equidistant",
        &[0.0, 0.0, 0.0, 0.0, 0.1]
    )));
}

#[test]
fn calibration_that_is_no_plain_file() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "demo", "--calibration", "/dev/zero"]));
}

#[test]
fn calibration_that_never_ends() {
    let bench = Bench::new();
    std::fs::File::create(bench.path("camera.yaml")).unwrap().set_len(1 << 36).unwrap();
    snapshot!(arguments(&bench, &["--source", "demo", "--calibration", &bench.arg("camera.yaml")]));
}

#[test]
fn stats_into_a_named_pipe() {
    let bench = Bench::new();
    let pipe = bench.arg("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    snapshot!(arguments(&bench, &["--source", "demo", "--stats-json", &pipe]));
}

#[test]
fn calibration_beside_intrinsics() {
    let bench = Bench::new();
    let both = ["--source", "demo", "--intrinsics", "500,500,320,240", "--calibration", "camera.yaml"];
    snapshot!(arguments(&bench, &both));
}

#[test]
fn calibration_for_images_of_another_shape() {
    let bench = Bench::new();
    bench.add_image("photo.png", 0);
    let text = calibration((1280, 720), [900.0, 900.0, 640.0, 360.0], "plumb_bob", &[0.0; 5]);
    std::fs::write(bench.path("camera.yaml"), text).unwrap();
    let (model, photo, out) = (bench.arg("model.onnx"), bench.arg("photo.png"), bench.arg("out"));
    let file = bench.arg("camera.yaml");
    let infer = ["-q", "infer", &photo, "--out", &out, "--model", &model, "--calibration", &file];
    snapshot!(outcome(&bench, nunetd(&infer)));
}

#[test]
fn camera_name_that_is_none() {
    let bench = Bench::new();
    let model = bench.arg("model.onnx");
    snapshot!(outcome(
        &bench,
        nunetd(&["-q", "--model", &model, "--camera", "front/left", "--source", "demo"])
    ));
}

#[test]
fn frame_id_that_would_be_cut() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "demo", "--frame-id", &"x".repeat(65)]));
}

#[test]
fn frame_id_of_a_long_camera_name_that_would_be_cut() {
    let bench = Bench::new();
    let (model, camera) = (bench.arg("model.onnx"), "x".repeat(60));
    snapshot!(outcome(
        &bench,
        nunetd(&["-q", "--model", &model, "--camera", &camera, "--source", "demo", "--frames", "1"])
    ));
}

#[test]
fn word_that_is_no_subcommand() {
    let bench = Bench::new();
    snapshot!(outcome(&bench, nunetd(&["inferr", "photo.jpg"])));
}

#[test]
fn pace_of_a_camera_that_has_its_own() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "shm:front", "--rate", "5"]));
}

#[test]
fn size_of_a_source_that_has_its_own() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "demo", "--size", "640x480"]));
}

#[test]
fn format_of_a_camera_that_chooses_it_itself() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "/dev/video0", "--size", "640x480", "--format", "rgb8"]));
}

#[test]
fn rate_that_is_none() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "demo", "--rate", "0"]));
}

/// The child that tests the model would not come to an end.
#[test]
fn threads_that_the_machine_cannot_run() {
    let bench = Bench::new();
    let outcome = arguments(&bench, &["--source", "demo", "--threads", "99999"]);
    assert!(outcome.starts_with("exit code 2\nerror: 99999 threads on "), "{outcome}");
}

#[test]
fn filter_that_is_none() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "demo", "--filter", "median"]));
}

#[test]
fn filter_with_a_setting_out_of_range() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "demo", "--filter", "spatial=alpha:0.5,delta:20"]));
}

#[test]
fn filter_that_is_given_twice() {
    let bench = Bench::new();
    let twice = ["--source", "demo", "--filter", "spatial=alpha:0.4", "--filter", "spatial=delta:0.1"];
    snapshot!(arguments(&bench, &twice));
}

#[test]
fn stage_of_every_that_does_not_exist() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "demo", "--every", "segmentation=2"]));
}

#[test]
fn output_folder_that_is_a_file() {
    let bench = Bench::new();
    std::fs::write(bench.path("taken"), b"").unwrap();
    let taken = bench.arg("taken");
    snapshot!(arguments(&bench, &["--source", "demo", "--out", &taken]));
}

#[test]
fn statistics_file_in_a_folder_that_does_not_exist() {
    let bench = Bench::new();
    let nowhere = bench.arg("nowhere/stats.json");
    snapshot!(arguments(&bench, &["--source", "demo", "--stats-json", &nowhere]));
}

#[test]
fn library_missing() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "demo", "--onnxruntime", "/nonexistent/libonnxruntime.so"]));
}

#[test]
fn library_that_is_a_text() {
    let bench = Bench::new();
    std::fs::write(bench.path("library.so"), "no library\n").unwrap();
    let library = bench.arg("library.so");
    snapshot!(arguments(&bench, &["--source", "demo", "--onnxruntime", &library]));
}

#[test]
fn provider_that_the_library_has_not() {
    let bench = Bench::new();
    snapshot!(arguments(&bench, &["--source", "demo", "--provider", "cuda"]));
}

#[test]
fn image_that_is_cut_off() {
    let bench = Bench::new();
    bench.add_image("whole.png", 0);
    let whole = std::fs::read(bench.path("whole.png")).unwrap();
    std::fs::write(bench.path("cut.png"), &whole[..whole.len() / 3]).unwrap();
    let (model, cut, out) = (bench.arg("model.onnx"), bench.arg("cut.png"), bench.arg("out"));
    snapshot!(outcome(&bench, nunetd(&["-q", "infer", &cut, "--out", &out, "--model", &model])));
}

#[test]
fn image_that_claims_to_be_giant() {
    let bench = Bench::new();
    // A PNG's header may claim any size: 60,000 x 60,000 here, with a body of a few bytes.
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\xea\x60\0\0\xea\x60\x08\x02\0\0\0".to_vec();
    png.extend(crc32(&png[12..]).to_be_bytes());
    png.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e");
    std::fs::write(bench.path("giant.png"), png).unwrap();
    let (model, giant, out) = (bench.arg("model.onnx"), bench.arg("giant.png"), bench.arg("out"));
    snapshot!(outcome(&bench, nunetd(&["-q", "infer", &giant, "--out", &out, "--model", &model])));
}

#[test]
fn images_of_one_name() {
    let bench = Bench::new();
    bench.add_image("a/1.png", 0);
    bench.add_image("b/1.png", 1);
    let (one, other, out) = (bench.arg("a/1.png"), bench.arg("b/1.png"), bench.arg("out"));
    snapshot!(outcome(&bench, nunetd(&["-q", "infer", &one, &other, "--out", &out])));
}

#[test]
fn camera_that_nobody_publishes() {
    let bench = Bench::new();
    let mut command = nunetd(&["watch", "nobody_is_here", "--timeout", "0.2"]);
    bench.enclose(&mut command);
    snapshot!(outcome(&bench, command));
}

/// The checksum of PNG chunks (PNG specification, annex D), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(
            crc ^ u32::from(byte),
            |crc, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 },
        )
    })
}

#[test]
fn sixteen_bit_images_that_use_only_the_lower_bits_are_reported_once_by_every_subcommand() {
    let bench = Bench::new();
    for folder in ["data/rgb", "data/depth"] {
        std::fs::create_dir_all(bench.path(folder)).unwrap();
    }
    let mut table = "image,u,v,distance\n".to_owned();
    for name in ["a", "b", "c"] {
        let dim =
            image::ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, _| image::Rgb([(x % 1000) as u16, 1023, 500]));
        dim.save(bench.path(&format!("data/rgb/{name}.png"))).unwrap();
        let depth = image::ImageBuffer::from_pixel(SIZE.0, SIZE.1, image::Luma([2000_u16]));
        depth.save(bench.path(&format!("data/depth/{name}.png"))).unwrap();
        table += &format!("data/rgb/{name}.png,320,240,2\n");
    }
    std::fs::write(bench.path("pairs.csv"), table).unwrap();
    let (data, rgb, pairs) = (bench.arg("data"), bench.arg("data/rgb"), bench.arg("pairs.csv"));
    let (image, out, name) = (bench.arg("data/rgb/a.png"), bench.arg("out"), camera("dim"));
    for subcommand in [
        &["run", "--source", &rgb, "--camera", &name][..],
        &["infer", &rgb, "--out", &out],
        &["eval", &data],
        &["calibrate", "--truth", &data],
        &["calibrate", "--pairs", &pairs],
        &["calibrate", "--source", &rgb, "--distance", "2"],
        &["bench", "--image", &image, "--runs", "1"],
    ] {
        let output = run_well(nunetd(&[subcommand, &["--model", &bench.arg("model.onnx")]].concat()));
        let stderr = text(&output.stderr);
        let warnings: Vec<_> = stderr.lines().filter(|line| line.contains("1023 of 65535")).collect();
        let [warning] = warnings[..] else { panic!("{subcommand:?}: {stderr}") };
        assert!(warning.contains("WARN") && warning.contains("16 bits"), "{subcommand:?}: {stderr}");
    }
}

#[test]
fn a_mount_that_nothing_uses_is_refused() {
    let bench = Bench::new();
    bench.add_image("a.png", 1);
    let (image, out, model) = (bench.arg("a.png"), bench.arg("out"), bench.arg("model.onnx"));
    let outcomes = [&["infer", &image, "--out", &out][..], &["eval", "data"]].map(|subcommand| {
        let rest = ["--mount", "0,0,0.5,0,0,0", "--model", &model];
        outcome(&bench, nunetd(&[&["-q"], subcommand, &rest].concat()))
    });
    snapshot!(outcomes.join("\n\n"));
}
