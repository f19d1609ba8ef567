//! Losses are counted and give exit code 3; everything else is done.

use serde_json::Value;

use crate::support::{Bench, camera, nunetd, run, text};

#[test]
fn exit_code_is_3_when_an_image_of_a_folder_was_unreadable_and_the_rest_is_done() {
    let bench = Bench::new();
    for frame in [0, 1, 3] {
        bench.add_image(&format!("images/{frame}.png"), frame);
    }
    bench.add_image("images/2.jpg", 2);
    let whole = std::fs::read(bench.path("images/2.jpg")).unwrap();
    std::fs::write(bench.path("images/2.jpg"), &whole[..whole.len() / 2]).unwrap();
    let (model, images, stats) = (bench.arg("model.onnx"), bench.arg("images"), bench.arg("stats.json"));
    let output = run(nunetd(&[
        "--model",
        &model,
        "--source",
        &images,
        "--camera",
        &camera("lossy"),
        "--stats-json",
        &stats,
    ]));
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("2.jpg`"), "{}", text(&output.stderr));
    let stats: Value = serde_json::from_slice(&std::fs::read(bench.path("stats.json")).unwrap()).unwrap();
    assert_eq!(stats["frames"]["captured"], 4);
    assert_eq!(stats["frames"]["published"], 3);
    assert_eq!(stats["frames"]["failed"], 1);
}

#[test]
fn exit_code_is_3_when_one_of_several_images_could_not_be_inferred() {
    let bench = Bench::new();
    bench.add_image("good.png", 0);
    std::fs::write(bench.path("bad.png"), b"").unwrap();
    let (model, good, bad, out) =
        (bench.arg("model.onnx"), bench.arg("good.png"), bench.arg("bad.png"), bench.arg("out"));
    let output = run(nunetd(&["-q", "infer", &bad, &good, "--out", &out, "--model", &model]));
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
    assert!(bench.path("out/good/depth.npy").is_file());
    assert!(!bench.path("out/bad").exists());
}

#[test]
fn superseded_frames_are_no_loss() {
    let bench = Bench::new();
    let (model, stats) = (bench.arg("model.onnx"), bench.arg("stats.json"));
    let output = run(nunetd(&[
        "-q",
        "--model",
        &model,
        "--source",
        "demo",
        "--rate",
        "2000",
        "--frames",
        "50",
        "--camera",
        &camera("fast"),
        "--stats-json",
        &stats,
    ]));
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let stats: Value = serde_json::from_slice(&std::fs::read(bench.path("stats.json")).unwrap()).unwrap();
    let count = |key: &str| stats["frames"][key].as_u64().unwrap();
    assert_eq!(count("captured"), count("published") + count("superseded"));
}

#[test]
fn the_reason_of_the_exit_code_is_logged_with_q_too() {
    let bench = Bench::new();
    bench.add_image("images/0.png", 0);
    std::fs::write(bench.path("images/1.png"), "no image").unwrap();
    let (model, images, name) = (bench.arg("model.onnx"), bench.arg("images"), camera("quiet"));
    let quiet = |arguments: &[&str]| {
        let output = run(nunetd(&[&["-q"][..], arguments].concat()));
        assert_eq!(output.status.code(), Some(3), "{arguments:?}");
        text(&output.stderr)
    };
    let stderr = quiet(&["run", "--model", &model, "--source", &images, "--camera", &name]);
    assert!(stderr.contains("1 of 2 frames"), "{stderr}");
    let stderr = quiet(&["feed", &images, "--camera", &name]);
    assert!(stderr.contains("1 of 2 frames"), "{stderr}");

    let (whole, cut) = (bench.arg("whole.mcap"), bench.arg("cut.mcap"));
    let record = ["run", "--model", &model, "--source", "demo", "--frames", "4", "--camera", &name];
    assert_eq!(run(nunetd(&[&record[..], &["--record", &whole]].concat())).status.code(), Some(0));
    let bytes = std::fs::read(&whole).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() - 40]).unwrap();
    let stderr = quiet(&["run", "--model", &model, "--source", &cut, "--camera", &name]);
    assert!(stderr.contains(&format!("`{cut}`")), "{stderr}");
}
