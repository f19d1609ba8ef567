//! `nunetd calibrate`: a factor from a distance, readings, true depth; and what is refused.

use std::fs::File;
use std::io::Write as _;
use std::path::Path;

use nunet_testkit::models;
use serde_json::Value;

use crate::support::{
    Bench, Guarded, SIZE, calibration, nunetd, outcome, run, run_well, seen, signal, snapshot, text,
};

/// True depth over the network's depth of the images of these tests.
const FACTOR: f64 = 0.5;
const LENS: [f64; 4] = [500.0, 500.0, 319.0, 239.0];

/// A folder with three images of one color each, and a calibration.
fn bench_with_images() -> (Bench, f64) {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("images")).unwrap();
    let color = [90, 120, 60];
    for name in ["a.png", "b.png", "c.png"] {
        let image = image::RgbImage::from_pixel(SIZE.0, SIZE.1, image::Rgb(color));
        image.save(bench.path(&format!("images/{name}"))).unwrap();
    }
    let lens = calibration(SIZE, LENS, "plumb_bob", &[0.0; 5]);
    std::fs::write(bench.path("front.yaml"), lens + "# the end\n").unwrap();
    (bench, f64::from(models::connected_depth(color)))
}

fn calibrate(bench: &Bench, rest: &[&str]) -> Value {
    let model = bench.arg("model.onnx");
    let output = run_well(nunetd(&[&["-q", "calibrate", "--model", &model, "--json"], rest].concat()));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// What a user sees of a calibration that is refused, below its arguments.
fn refused(bench: &Bench, rest: &[&str]) -> String {
    format!("{}\n{}", bench.redact(&rest.join(" ")), outcome_of(bench, rest))
}

fn outcome_of(bench: &Bench, rest: &[&str]) -> String {
    let model = bench.arg("model.onnx");
    outcome(bench, nunetd(&[&["-q", "calibrate", "--model", &model], rest].concat()))
}

fn assert_factor(found: &Value, count: u64) {
    let factor = found["factor"].as_f64().unwrap();
    assert!((factor - FACTOR).abs() < 1e-3, "{found}");
    assert_eq!((&found["observations"], &found["agreeing"]), (&count.into(), &count.into()), "{found}");
}

#[test]
fn a_tape_measure_gives_a_factor_that_run_and_infer_read_from_the_calibration() {
    let (bench, depth_m) = bench_with_images();
    let (images, file) = (bench.arg("images"), bench.arg("front.yaml"));
    let before = std::fs::read_to_string(&file).unwrap();
    // Straight to a pixel 300 columns right of the center, at the depth of the network times the factor.
    let distance = (FACTOR * depth_m * (1.0 + (300.0_f64 / 500.0).powi(2)).sqrt()).to_string();
    let found = calibrate(
        &bench,
        &["--source", &images, "--distance", &distance, "--at", "619,239", "--calibration", &file],
    );
    assert_factor(&found, 3);
    let after = std::fs::read_to_string(&file).unwrap();
    assert!(after.starts_with(&before) && after.contains("nunet_scale:\n  factor: 0.5"), "{after}");

    let (model, image, out) = (bench.arg("model.onnx"), bench.arg("images/a.png"), bench.arg("out"));
    run_well(nunetd(&["-q", "infer", &image, "--out", &out, "--model", &model, "--calibration", &file]));
    let stats: Value = serde_json::from_slice(&std::fs::read(bench.path("out/stats.json")).unwrap()).unwrap();
    assert_eq!(stats["scale_source"], "calibrated", "it is of this model: {stats}");
    assert!((bench.depth("out")[0] - (FACTOR * depth_m) as f32).abs() < 0.01);
}

#[test]
fn a_file_that_cannot_be_written_is_refused_before_anything_is_measured() {
    let (bench, _) = bench_with_images();
    let (images, lens) = (bench.arg("images"), bench.arg("front.yaml"));
    let rest = ["--source", &images, "--distance", "2", "--calibration", &lens, "--model", "none.onnx"];
    let out = bench.arg("none/new.yaml");
    snapshot!(outcome(&bench, nunetd(&[&["-q", "calibrate", "--out", &out], &rest[..]].concat())));
}

#[test]
fn a_point_outside_the_image_is_named_with_its_line() {
    let (bench, _) = bench_with_images();
    let table = bench.path("pairs.csv");
    std::fs::write(table, "image,u,v,distance\nimages/a.png,1,1,2\nimages/a.png,9999,1,2\n").unwrap();
    let in_table = refused(&bench, &["--pairs", &bench.arg("pairs.csv")]);
    let at = ["--source", &bench.arg("images"), "--distance", "2", "--at", "-1,5"];
    snapshot!([in_table, refused(&bench, &at)].join("\n\n"));
}

#[test]
fn a_factor_is_for_the_aspect_mode_that_it_was_measured_with() {
    let (bench, depth_m) = bench_with_images();
    let wide = (2 * SIZE.0, SIZE.1);
    std::fs::create_dir(bench.path("wide")).unwrap();
    let image = image::RgbImage::from_pixel(wide.0, wide.1, image::Rgb([90, 120, 60]));
    image.save(bench.path("wide/a.png")).unwrap();
    let lens = calibration(wide, [500.0, 500.0, 639.5, 239.5], "plumb_bob", &[0.0; 5]);
    std::fs::write(bench.path("wide.yaml"), lens).unwrap();
    let (images, file) = (bench.arg("wide"), bench.arg("wide.yaml"));
    let distance = (FACTOR * depth_m).to_string();
    calibrate(&bench, &["--source", &images, "--distance", &distance, "--calibration", &file]);
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(written.contains("\n  aspect: crop\n"), "{written}");

    let (model, image, out) = (bench.arg("model.onnx"), bench.arg("wide/a.png"), bench.arg("out"));
    let warnings = |aspect: &str| {
        let arguments = ["infer", &image, "--out", &out, "--model", &model, "--calibration", &file];
        let stderr = text(&run_well(nunetd(&[&arguments[..], &["--aspect", aspect]].concat())).stderr);
        let is_about_factor = |line: &&str| line.contains("WARN") && line.contains("scale factor");
        stderr.lines().filter(is_about_factor).map(str::to_owned).collect::<Vec<_>>()
    };
    let of_stretch = warnings("stretch");
    assert!(of_stretch.len() == 1 && of_stretch[0].contains("`crop`"), "{of_stretch:?}");
    assert_eq!(warnings("crop"), Vec::<String>::new());
}

#[test]
fn readings_give_a_factor_and_contradicting_ones_are_refused_by_line() {
    let (bench, depth_m) = bench_with_images();
    let table = |distances: [f64; 3]| {
        let mut text = "image,u,v,distance\n".to_owned();
        for (name, distance) in ["a", "b", "c"].iter().zip(distances) {
            text += &format!("images/{name}.png,319.5,239.5,{distance}\n");
        }
        std::fs::write(bench.path("pairs.csv"), text).unwrap();
    };
    let (pairs, out) = (bench.arg("pairs.csv"), bench.arg("new.yaml"));
    table([FACTOR * depth_m; 3]);
    let found =
        calibrate(&bench, &["--pairs", &pairs, "--intrinsics", "500,500,319.5,239.5@640x480", "--out", &out]);
    assert_factor(&found, 3);
    let written = std::fs::read_to_string(&out).unwrap();
    assert!(written.contains("data: [500, 0, 319.5, 0, 500, 239.5, 0, 0, 1]"), "{written}");
    table([FACTOR * depth_m, 1000.0 * depth_m, 5.0 * depth_m]);
    let contradicting = refused(&bench, &["--pairs", &pairs]);
    std::fs::rename(bench.path("images/c.png"), bench.path("images/d.png")).unwrap();
    let missing = refused(&bench, &["--pairs", &pairs]);
    std::fs::write(bench.path("images/c.png"), "no image").unwrap();
    let unreadable = refused(&bench, &["--pairs", &pairs]);
    table([f64::NAN; 3]);
    let not_a_number = refused(&bench, &["--pairs", &pairs]);
    snapshot!([contradicting, missing, unreadable, not_a_number].join("\n\n"));
}

#[test]
fn readings_that_the_network_does_not_see_are_skipped_with_a_warning() {
    let (bench, depth_m) = bench_with_images();
    // Its sides are cropped, because the network has another aspect ratio.
    let wide = image::RgbImage::from_pixel(2 * SIZE.0, SIZE.1, image::Rgb([90, 120, 60]));
    wide.save(bench.path("images/wide.png")).unwrap();
    let mut table = "image,u,v,distance\n".to_owned();
    for (name, column) in [("a", 319.5), ("b", 319.5), ("wide", 1.0), ("c", 319.5), ("wide", 1278.0)] {
        table += &format!("images/{name}.png,{column},239.5,{}\n", FACTOR * depth_m);
    }
    std::fs::write(bench.path("pairs.csv"), table).unwrap();
    let (model, pairs) = (bench.arg("model.onnx"), bench.arg("pairs.csv"));
    let output = run_well(nunetd(&["calibrate", "--model", &model, "--json", "--pairs", &pairs]));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_factor(&found, 3);
    assert_eq!(found["unusable"], 2);
    let stderr = text(&output.stderr);
    // One warning has the count and the line of the first.
    let warned = stderr
        .lines()
        .any(|line| line.contains("WARN") && line.contains(": 2, ") && line.ends_with("line 4"));
    assert!(warned, "{stderr}");
}

/// A dataset `truth` of the three images, each with true depth, and a calibration.
fn bench_with_truth() -> Bench {
    let (bench, depth_m) = bench_with_images();
    let folder = bench.path("truth");
    std::fs::create_dir_all(folder.join("depth")).unwrap();
    std::fs::rename(bench.path("images"), folder.join("rgb")).unwrap();
    let millimeters = (FACTOR * depth_m * 1000.0).round() as u16;
    for name in ["a.png", "b.png", "c.png"] {
        let depth = image::ImageBuffer::from_pixel(SIZE.0, SIZE.1, image::Luma([millimeters]));
        depth.save(folder.join("depth").join(name)).unwrap();
    }
    bench
}

#[test]
fn a_reference_without_a_single_observation_says_what_to_check() {
    let bench = bench_with_truth();
    for name in ["a.png", "b.png", "c.png"] {
        let depth = image::ImageBuffer::from_pixel(SIZE.0, SIZE.1, image::Luma([0_u16]));
        depth.save(bench.path("truth/depth").join(name)).unwrap();
    }
    std::fs::write(bench.path("pairs.csv"), "image,u,v,distance\n").unwrap();
    let no_depth = refused(&bench, &["--truth", &bench.arg("truth")]);
    snapshot!([no_depth, refused(&bench, &["--pairs", &bench.arg("pairs.csv")])].join("\n\n"));
}

/// `eval` counts and exits the same way.
#[test]
fn images_with_true_depth_that_are_skipped_are_counted_and_lost() {
    let bench = bench_with_truth();
    let (model, truth) = (bench.arg("model.onnx"), bench.arg("truth"));
    std::fs::copy(bench.path("truth/rgb/a.png"), bench.path("truth/rgb/d.png")).unwrap();
    let arguments = ["-q", "calibrate", "--model", &model, "--json", "--truth", &truth];
    let output = run(nunetd(&arguments));
    assert_factor(&serde_json::from_slice(&output.stdout).unwrap(), 3);
    let one_skipped = seen(&bench, &output);
    std::fs::remove_dir_all(bench.path("truth/depth")).unwrap();
    std::fs::create_dir(bench.path("truth/depth")).unwrap();
    snapshot!([one_skipped, seen(&bench, &run(nunetd(&arguments)))].join("\n\n"));
}

#[test]
fn true_depth_gives_a_factor() {
    let bench = bench_with_truth();
    assert_factor(&calibrate(&bench, &["--truth", &bench.arg("truth")]), 3);
    assert!(!Path::new("nunet.yaml").exists(), "nothing is written that was not asked for");
    let (truth, file) = (bench.arg("truth"), bench.arg("front.yaml"));
    assert_factor(&calibrate(&bench, &["--truth", &truth, "--calibration", &file]), 3);
    assert!(std::fs::read_to_string(&file).unwrap().contains("nunet_scale:\n  factor: 0.5"));
}

#[test]
fn true_depth_is_compared_up_to_the_cap() {
    let (bench, depth_m) = bench_with_images();
    let far = (FACTOR * depth_m) as f32;
    let frames = [1, 2, 3].map(|seconds| (seconds, Some([90, 120, 60]), far));
    bench.add_recording("far.mcap", &frames, SIZE);
    let truth = bench.arg("far.mcap");
    assert_factor(&calibrate(&bench, &["--truth", &truth, "--depth-cap", &(far + 0.1).to_string()]), 3);
    snapshot!(refused(&bench, &["--truth", &truth, "--depth-cap", &(far - 0.1).to_string()]));
}

#[test]
fn true_depth_in_meters_has_no_other_unit_and_is_no_millimeters() {
    let (bench, depth_m) = bench_with_images();
    let recording = |name: &str, depth: f64| {
        let frames = [1, 2, 3].map(|seconds| (seconds, Some([90, 120, 60]), depth as f32));
        bench.add_recording(name, &frames, SIZE);
        bench.arg(name)
    };
    let meters = recording("meters.mcap", FACTOR * depth_m);
    assert_factor(&calibrate(&bench, &["--truth", &meters]), 3);
    let other_unit = refused(&bench, &["--truth", &meters, "--depth-scale", "0.002"]);
    let millimeters = refused(&bench, &["--truth", &recording("mm.mcap", 1000.0 * FACTOR * depth_m)]);
    let far = refused(&bench, &["--truth", &recording("far.mcap", 70.0)]);
    snapshot!([other_unit, millimeters, far].join("\n\n"));
}

#[test]
fn what_cannot_give_a_factor_is_refused() {
    let (bench, _) = bench_with_images();
    let (images, out) = (bench.arg("images"), bench.arg("new.yaml"));
    let cases: [&[&str]; 20] = [
        &["--distance", "2"],
        &["--source", &images],
        &["--source", &images, "--distance", "0"],
        &["--source", &images, "--distance", "2", "--at", "640,10"],
        &["--source", &images, "--distance", "2", "--at", "10"],
        &["--source", &images, "--distance", "2000"],
        &["--source", &images, "--mount", "0,0,0.5,0,0,0"],
        &["--source", &images, "--mount", "0,0,-1,0,0,0"],
        &["--pairs", "none.csv"],
        &["--pairs", "/dev/zero"],
        &["--truth", "none"],
        &["--pairs", "none.csv", "--depth-scale", "0.001"],
        &["--pairs", "none.csv", "--frames", "3"],
        &["--pairs", "none.csv", "--topic", "/a"],
        &["--truth", "none", "--loop"],
        &["--source", &images, "--distance", "2", "--depth-cap", "20"],
        &["--source", &images, "--mount", "0,0,0.5,0,0,0", "--depth-offset", "1"],
        &["--truth", &images, "--topic", "/a"],
        &["--truth", "none", "--depth-cap", "0"],
        &["--source", &images, "--distance", "2", "--out", &out],
    ];
    snapshot!(cases.map(|rest| refused(&bench, rest)).join("\n\n"));
}

#[test]
fn flags_of_another_reference_are_refused() {
    let bench = Bench::new();
    let distance = ["--distance", "2", "--source", "demo"];
    let mount = ["--mount", "0,0,0.5,0,0,0", "--source", "demo"];
    let (pairs, truth) = (["--pairs", "none.csv"], ["--truth", "none"]);
    let (at, ids) = (["--at", "1,1"], ["--ids", "ids.txt"]);
    let (topic, window) = (["--depth-topic", "/depth"], ["--window", "1,1,2,2"]);
    let cases: [(&[&str], &[&str]); 12] = [
        (&pairs, &at),
        (&truth, &at),
        (&mount, &at),
        (&pairs, &ids),
        (&distance, &ids),
        (&mount, &ids),
        (&pairs, &topic),
        (&distance, &topic),
        (&mount, &topic),
        (&pairs, &window),
        (&distance, &window),
        (&mount, &window),
    ];
    snapshot!(cases.map(|(reference, flag)| refused(&bench, &[reference, flag].concat())).join("\n\n"));
}

#[test]
fn a_calibration_that_is_stopped_says_after_how_many_frames() {
    /// More than the pipe and its reader hold, so that the first ones have been compared once all are
    /// written.
    const WRITTEN: usize = 12;
    let (bench, _) = bench_with_images();
    let (reader, mut writer) = std::io::pipe().unwrap();
    let model = bench.arg("model.onnx");
    let mut command = nunetd(&["-q", "calibrate", "--model", &model, "--source", "-", "--size", "640x480"]);
    command.args(["--format", "rgb8", "--distance", "2", "--frames", "1000"]);
    command.stdin(reader).stderr(File::create(bench.path("log")).unwrap());
    let mut calibrate = Guarded::start(command);
    let frame = vec![100; 3 * (SIZE.0 * SIZE.1) as usize];
    (0..WRITTEN).for_each(|_| writer.write_all(&frame).unwrap());
    signal(calibrate.pid(), "INT");
    assert_eq!(calibrate.wait(), Some(1));
    let log = std::fs::read_to_string(bench.path("log")).unwrap();
    let mut numbers = log.split(|letter: char| !letter.is_ascii_digit()).filter_map(|word| word.parse().ok());
    let count: usize = numbers.next().unwrap_or_else(|| panic!("{log}"));
    assert!((1..=WRITTEN).contains(&count), "{log}");
    snapshot!(log.replace("frames", "frame").replace(&count.to_string(), "[COUNT]"));
}

#[test]
fn unknown_intrinsics_for_a_file_are_an_error_at_the_first_frame() {
    let bench = Bench::new();
    let (reader, mut writer) = std::io::pipe().unwrap();
    let (model, out) = (bench.arg("model.onnx"), bench.arg("new.yaml"));
    let mut command = nunetd(&["-q", "calibrate", "--model", &model, "--source", "-", "--size", "640x480"]);
    command.args(["--format", "rgb8", "--distance", "2", "--frames", "1000", "--out", &out]);
    command.stdin(reader).stderr(File::create(bench.path("log")).unwrap());
    let mut calibrate = Guarded::start(command);
    let frame = vec![100; 3 * (SIZE.0 * SIZE.1) as usize];
    // The second one never comes.
    writer.write_all(&frame).unwrap();
    assert_eq!(calibrate.wait(), Some(2));
    snapshot!(std::fs::read_to_string(bench.path("log")).unwrap());
    assert!(!bench.path("new.yaml").exists());
}

#[test]
fn a_broken_factor_in_the_named_calibration_says_how_to_get_another_one() {
    let (bench, _) = bench_with_images();
    let (images, file) = (bench.arg("images"), bench.arg("front.yaml"));
    let broken = std::fs::read_to_string(&file).unwrap() + "nunet_scale: {factor: -1}\n";
    std::fs::write(&file, broken).unwrap();
    snapshot!(refused(&bench, &["--source", &images, "--distance", "2", "--calibration", &file]));
}

#[test]
fn errors_have_the_hints_and_exit_codes_of_other_subcommands() {
    let (bench, _) = bench_with_images();
    let (images, model) = (bench.arg("images"), bench.arg("model.onnx"));
    let of =
        |arguments: &[&str]| outcome(&bench, nunetd(&[&["-q"], arguments, &["--model", &model]].concat()));
    let no_truth = of(&["calibrate", "--truth", "none"]);
    assert_eq!(no_truth, of(&["eval", "none"]));
    let wide = ["--intrinsics", "500,500,319.5,119.5@640x240"];
    let image = bench.arg("images/a.png");
    let distance = ["calibrate", "--source", &images, "--distance", "2"];
    let no_fit = of(&[&distance[..], &wide].concat());
    assert_eq!(no_fit, of(&[&["infer", &image, "--out", &bench.arg("out")], &wide[..]].concat()));
    snapshot!([no_truth, no_fit].join("\n\n"));
}

#[test]
fn no_file_is_overwritten_but_the_named_calibration() {
    let (bench, depth_m) = bench_with_images();
    let (images, distance) = (bench.arg("images"), (FACTOR * depth_m).to_string());
    let (pairs, lens) = (bench.arg("pairs.csv"), bench.arg("front.yaml"));
    std::fs::write(bench.path("pairs.csv"), "image,u,v,distance\nimages/a.png,1,1,2\n").unwrap();
    std::fs::copy(bench.path("front.yaml"), bench.path("rear.yaml")).unwrap();
    std::fs::hard_link(bench.path("images/a.png"), bench.path("linked.yaml")).unwrap();
    let (model, image) = (bench.arg("model.onnx"), bench.arg("images/a.png"));
    let (rear, linked) = (bench.arg("rear.yaml"), bench.arg("linked.yaml"));
    let frames = ["--source", &images, "--distance", &distance, "--calibration", &lens];
    let readings = ["--pairs", &pairs, "--calibration", &lens];
    let cases = [
        (&readings[..], &pairs),
        (&readings, &image),
        (&readings, &linked),
        (&frames, &image),
        (&frames, &linked),
        (&frames, &model),
        (&frames, &rear),
    ];
    let refusals = cases.map(|(evidence, out)| {
        let before = std::fs::read(out).unwrap();
        let arguments = [evidence, &["--out", out]].concat();
        if *out != rear {
            let forced = outcome_of(&bench, &[&arguments[..], &["--force"]].concat());
            assert_eq!(forced, outcome_of(&bench, &arguments), "{out}");
        }
        let refusal = refused(&bench, &arguments);
        assert_eq!(std::fs::read(out).unwrap(), before, "{out}");
        refusal
    });
    snapshot!(refusals.join("\n\n"));
    assert_factor(&calibrate(&bench, &[&frames[..], &["--out", &rear, "--force"]].concat()), 3);
    assert_factor(&calibrate(&bench, &[&frames[..], &["--out", &lens]].concat()), 3);
    assert_eq!(std::fs::read(&rear).unwrap(), std::fs::read(&lens).unwrap());
}

#[test]
fn a_calibration_of_opencv_stays_one() {
    let (bench, depth_m) = bench_with_images();
    let (images, file, distance) =
        (bench.arg("images"), bench.arg("cv.yaml"), (FACTOR * depth_m).to_string());
    let before = "\u{feff}%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   \
                  rows: 3\n   cols: 3\n   dt: d\n   data: [ 500., 0., 319.5, 0., 500., 239.5, 0., 0., 1. ]\n\
                  distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ 0., 0., 0., \
                  0., 0. ]\n";
    std::fs::write(&file, format!("{before}...\n")).unwrap();
    let again = ["--source", &images, "--distance", &distance, "--calibration", &file];
    for _ in 0..2 {
        assert_factor(&calibrate(&bench, &again), 3);
        let after = std::fs::read_to_string(&file).unwrap();
        assert!(
            after.starts_with(&format!("{before}nunet_scale:\n")) && after.ends_with("\"\n...\n"),
            "{after}"
        );
    }
    let broken = "{image_width: 640, image_height: 480, distortion_model: plumb_bob, camera_matrix: {rows: 3, cols: 3, \
                  data: [500, 0, 319.5, 0, 500, 239.5, 0, 0, 1]}, distortion_coefficients: {rows: 1, cols: 1, data: [0]}}\n";
    std::fs::write(&file, broken).unwrap();
    snapshot!(refused(&bench, &again));
    assert_eq!(std::fs::read_to_string(&file).unwrap(), broken, "it is not touched");
}
