//! A network with a memory in the daemon: what is one stream, and what is not.

use nunet_testkit::models;

use crate::support::{Bench, SIZE, camera, nunetd, run_well, text};

/// Images of a walk, and a network that remembers them.
fn walk() -> Bench {
    let bench = Bench::new();
    bench.add_model("remembering.onnx", &models::remembering(SIZE));
    for step in 0..3 {
        bench.add_image(&format!("walk/{step}.png"), 20 * step);
    }
    bench
}

/// The depth of the last of these images of the walk, computed by hand.
fn depth_after(bench: &Bench, steps: &[usize]) -> Vec<f32> {
    let mut trail = vec![0.0; (SIZE.0 * SIZE.1) as usize];
    let mut depth = Vec::new();
    for step in steps {
        let rgb = image::open(bench.path(&format!("walk/{step}.png"))).unwrap().into_rgb8();
        depth = rgb.pixels().zip(&trail).map(|(pixel, trail)| models::plain_depth(pixel.0) + trail).collect();
        for (trail, pixel) in trail.iter_mut().zip(rgb.pixels()) {
            *trail = models::next_trail(*trail, pixel.0);
        }
    }
    depth
}

/// The depth of the last of so many frames of the looped walk.
fn run(bench: &Bench, frames: &str, rate: &str) -> Vec<f32> {
    let (model, source, out) = (bench.arg("remembering.onnx"), bench.arg("walk"), bench.arg("out"));
    let stream = ["-q", "--model", &model, "--source", &source, "--loop", "--frames", frames, "--rate", rate];
    let rest = ["--out", &out, "--focal", "off", "--camera", &camera("walk")];
    run_well(nunetd(&[&stream[..], &rest[..]].concat()));
    bench.depth("out")
}

#[test]
fn images_of_a_folder_are_one_stream_until_it_restarts() {
    let bench = walk();
    assert_eq!(run(&bench, "3", "max"), depth_after(&bench, &[0, 1, 2]));
    assert_eq!(run(&bench, "4", "max"), depth_after(&bench, &[0]));
    assert_eq!(run(&bench, "5", "max"), depth_after(&bench, &[0, 1]));
}

#[test]
fn frames_more_than_a_second_apart_reset_the_state() {
    let bench = walk();
    assert_eq!(run(&bench, "2", "0.6"), depth_after(&bench, &[1]));
}

#[test]
fn infer_resets_the_state_for_each_image() {
    let bench = walk();
    let (model, out) = (bench.arg("remembering.onnx"), bench.arg("out"));
    let images = [0, 1].map(|step| bench.arg(&format!("walk/{step}.png")));
    let rest = ["--out", &out, "--model", &model, "--focal", "off"];
    run_well(nunetd(&[&["-q", "infer", &images[0], &images[1]], &rest[..]].concat()));
    for step in [0, 1] {
        assert_eq!(bench.depth(&format!("out/{step}")), depth_after(&bench, &[step]));
    }
}

#[test]
fn inspect_lists_the_state_of_a_network() {
    let bench = walk();
    let model = bench.arg("remembering.onnx");
    let printed = text(&run_well(nunetd(&["-q", "inspect", &model])).stdout);
    assert!(printed.contains("count_out -> count_in float32 [1], from frame to frame\n"), "{printed}");
    let json = run_well(nunetd(&["-q", "inspect", &model, "--json"])).stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert_eq!(json["stages"][0]["memory"][1]["output"], "count_out");
}
