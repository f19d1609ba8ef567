//! `nunetd eval`: metrics against true depth, and errors of a dataset.

use std::path::Path;

use image::{ImageBuffer, Luma};
use nunet_testkit::models;
use serde_json::Value;

use crate::support::{Bench, SIZE, camera, nunetd, run, run_well, seen, snapshot, text};

/// The test network's own answers for two images of the demo scene as truth, off by `error_mm`.
fn dataset(error_mm: u16) -> Bench {
    let bench = Bench::new();
    for folder in ["data/depth", "data/labels"] {
        std::fs::create_dir_all(bench.path(folder)).unwrap();
    }
    for (name, frame) in [("a", 1), ("b", 40)] {
        bench.add_image(&format!("data/rgb/{name}.png"), frame);
        // Dark, since the test network says up to 24 m of a bright one, and 10 m is the cap of all protocols.
        let mut rgb = image::open(bench.path(&format!("data/rgb/{name}.png"))).unwrap().into_rgb8();
        rgb.iter_mut().for_each(|value| *value /= 4);
        rgb.save(bench.path(&format!("data/rgb/{name}.png"))).unwrap();
        let millimeters =
            |pixel: &image::Rgb<u8>| (models::connected_depth(pixel.0) * 1000.0).round() as u16 + error_mm;
        let depth = rgb.pixels().map(millimeters).collect();
        let depth: ImageBuffer<Luma<u16>, Vec<u16>> = ImageBuffer::from_raw(SIZE.0, SIZE.1, depth).unwrap();
        depth.save(bench.path(&format!("data/depth/{name}.png"))).unwrap();
        let labels = rgb.pixels().map(|pixel| models::label(pixel.0)).collect();
        let labels = image::GrayImage::from_raw(SIZE.0, SIZE.1, labels).unwrap();
        labels.save(bench.path(&format!("data/labels/{name}.png"))).unwrap();
    }
    bench
}

fn eval<'a>(data: &'a str, model: &'a str, rest: &[&'a str]) -> Vec<&'a str> {
    [&["-q", "eval", data, "--model", model, "--focal", "off"], rest].concat()
}

fn report(bench: &Bench, rest: &[&str]) -> Value {
    report_of("data", bench, rest)
}

fn report_of(data: &str, bench: &Bench, rest: &[&str]) -> Value {
    let (data, model) = (bench.arg(data), bench.arg("model.onnx"));
    let output = run_well(nunetd(&eval(&data, &model, &[rest, &["--json"]].concat())));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Exit code and stderr of a dataset with something wrong.
fn outcome(bench: &Bench, rest: &[&str]) -> String {
    outcome_of("data", bench, rest)
}

fn outcome_of(data: &str, bench: &Bench, rest: &[&str]) -> String {
    let (data, model) = (bench.arg(data), bench.arg("model.onnx"));
    seen(bench, &run(nunetd(&eval(&data, &model, rest))))
}

#[track_caller]
fn assert_near(value: &Value, expected: f64, tolerance: f64) {
    let value = value.as_f64().unwrap();
    assert!((value - expected).abs() <= tolerance, "{value} instead of {expected}");
}

#[test]
fn an_exact_network_has_only_the_error_of_whole_millimeters() {
    let found = report(&dataset(0), &[]);
    assert_near(&found["metrics"]["rmse"], 0.0, 0.0005);
    assert_near(&found["metrics"]["delta1"], 1.0, 0.0);
    assert_near(&found["labels"]["miou"], 1.0, 0.0);
    assert_eq!((&found["pictures"], &found["skipped"]), (&2.into(), &0.into()));
    assert_eq!((&found["contract"], &found["units"]), (&1.into(), &"metre".into()));
    assert!(
        found["baseline"]["metrics"]["rmse"].as_f64().unwrap() > 0.01,
        "the mean image is wrong: {found}"
    );
}

#[test]
fn obstacles_of_a_network_that_is_right_are_those_of_the_truth() {
    let how = ["--obstacles", "--mount", "0,0,0.5,0,0.1,0"];
    let found = report(&dataset(0), &how);
    let all = found["obstacles"]["by_distance"].as_array().unwrap();
    let sectors: u64 = all.iter().map(|group| group["sectors"].as_u64().unwrap()).sum();
    assert!(sectors > 20, "{found}");
    for group in all.iter().filter(|group| group["sectors"] != 0) {
        assert_near(&group["found"], 1.0, 0.02);
        assert_near(&group["range_error"], 0.0, 0.01);
    }
    let plain = report(&dataset(0), &[]);
    assert!(plain.get("obstacles").is_none(), "they were not asked for");
}

#[test]
fn each_image_may_have_its_own_camera() {
    let bench = dataset(0);
    // The network of these images was made for a camera of another focal length, so meters scale with that of
    // each image.
    let scaled = |cameras: &[(&str, f64)]| {
        let row = |(id, fx): &(&str, f64)| format!("{id},{fx},{fx},320,240,640,480\n");
        let rows: String = cameras.iter().map(row).collect();
        let rows = format!("id,fx,fy,cx,cy,width,height\n{rows}");
        std::fs::write(bench.path("data/intrinsics.csv"), rows).unwrap();
        let (data, model) = (bench.arg("data"), bench.arg("model.onnx"));
        let output = run_well(nunetd(&["-q", "eval", &data, "--model", &model, "--json"]));
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        (found["metrics"]["rmse"].as_f64().unwrap(), found["scale_source"].as_str().unwrap().to_owned())
    };
    let pairs = [(500.0, 500.0), (500.0, 600.0), (600.0, 600.0)];
    let [both, one, none] = pairs.map(|(fx_a, fx_b)| {
        let (rmse, source) = scaled(&[("a", fx_a), ("b", fx_b)]);
        assert_eq!(source, "focal_scaled");
        rmse
    });
    assert!(both != one && one != none && both != none, "{both} {one} {none}");
    assert_eq!(scaled(&[("a", 500.0)]).1, "mixed", "the camera of b is assumed");
}

#[test]
fn obstacles_are_compared_with_a_mount_for_all_images_or_for_each() {
    let bench = dataset(0);
    let none = outcome(&bench, &["--obstacles"]);
    let below = outcome(&bench, &["--obstacles", "--mount", "0,0,-1,0,0,0"]);
    let rows = "id,x,y,z,roll,pitch,yaw\na,0,0,0.5,0,0.1,0\n";
    std::fs::write(bench.path("data/mounts.csv"), rows).unwrap();
    snapshot!([none, below, outcome(&bench, &["--obstacles"])].join("\n\n"));
}

#[test]
fn a_constant_error_is_the_root_mean_square_and_none_of_stretched_depth() {
    let found = report(&dataset(100), &[]);
    assert_near(&found["metrics"]["rmse"], 0.1, 0.0005);
    assert_near(&found["minmax"]["rmse"], 0.0, 0.001);
}

/// Cameras write them so.
#[test]
fn file_extensions_may_have_capitals() {
    let bench = dataset(100);
    for folder in ["rgb", "depth", "labels"] {
        let path = |ending: &str| bench.path(&format!("data/{folder}/b.{ending}"));
        std::fs::rename(path("png"), path("PNG")).unwrap();
    }
    let found = report(&bench, &[]);
    assert_eq!((&found["pictures"], &found["skipped"]), (&2.into(), &0.into()));
    assert_near(&found["metrics"]["rmse"], 0.1, 0.0005);
}

#[test]
fn report_table_and_sheet_are_written() {
    let bench = dataset(100);
    let (data, model, out) = (bench.arg("data"), bench.arg("model.onnx"), bench.arg("out"));
    let output = run_well(nunetd(&eval(&data, &model, &["--out", &out])));
    let table = text(&output.stdout);
    assert!(table.starts_with("model.onnx (wnet_c) on data: 2 images, 0 skipped, protocol full"), "{table}");
    assert!(table.contains("\nrmse              0.1000"), "{table}");
    assert!(table.contains("--baseline-ids"), "{table}");
    assert_eq!(std::fs::read_to_string(bench.path("out/images.csv")).unwrap().lines().count(), 3);
    let sheet = image::open(bench.path("out/contact_sheet.png")).unwrap();
    assert!(sheet.height() > 2 * 240 && sheet.height() < 3 * 280, "two images, once each");
}

/// That of the measured images beats networks that have not seen them.
#[test]
fn the_report_states_what_the_mean_image_was_computed_from() {
    let bench = dataset(100);
    for (name, id) in [("one.txt", "a"), ("other.txt", "b")] {
        std::fs::write(bench.path(name), id).unwrap();
    }
    let (one, other) = (bench.arg("one.txt"), bench.arg("other.txt"));
    assert_eq!(report(&bench, &["--ids", &one])["baseline"]["of"], "measured images");
    let named = report(&bench, &["--ids", &one, "--baseline-ids", &other]);
    assert_eq!(named["baseline"]["of"], "baseline-ids");
    let (data, model) = (bench.arg("data"), bench.arg("model.onnx"));
    let arguments = eval(&data, &model, &["--ids", &one, "--baseline-ids", &other]);
    let table = text(&run_well(nunetd(&arguments)).stdout);
    assert!(table.contains("rmse") && !table.contains("--baseline-ids"), "{table}");
}

#[test]
fn images_that_cannot_be_measured_are_named_and_counted() {
    let bench = dataset(0);
    std::fs::remove_file(bench.path("data/depth/b.png")).unwrap();
    std::fs::write(bench.path("data/depth/only_depth.png"), "no image").unwrap();
    let one_measured = outcome(&bench, &[]);
    std::fs::remove_file(bench.path("data/rgb/a.png")).unwrap();
    snapshot!([one_measured, outcome(&bench, &[])].join("\n\n"));
}

#[test]
fn sizes_and_units_that_do_not_fit_are_refused() {
    let bench = dataset(0);
    image::GrayImage::new(SIZE.0, SIZE.1).save(bench.path("data/depth/a.png")).unwrap();
    image::GrayImage::new(8, 4).save(bench.path("data/labels/b.png")).unwrap();
    let units = outcome(&bench, &[]);
    ImageBuffer::<Luma<u16>, _>::new(32, 24).save(bench.path("data/depth/b.png")).unwrap();
    snapshot!([units, outcome(&bench, &[])].join("\n\n"));
}

#[test]
fn labels_outside_the_classes_are_named() {
    let bench = dataset(0);
    let path = bench.path("data/labels/b.png");
    let mut labels = image::open(&path).unwrap().into_luma8();
    labels.put_pixel(3, 3, Luma([20]));
    labels.save(&path).unwrap();
    snapshot!(outcome(&bench, &[]));
}

#[test]
fn much_truth_beyond_the_cap_is_reported_and_counted() {
    let bench = dataset(0);
    let mut depth = image::open(bench.path("data/depth/a.png")).unwrap().into_luma16();
    depth.pixels_mut().for_each(|pixel| pixel.0[0] = 11_000);
    depth.save(bench.path("data/depth/a.png")).unwrap();
    let (data, model) = (bench.arg("data"), bench.arg("model.onnx"));
    let arguments = ["eval", &data, "--model", &model, "--focal", "off", "--json"];
    let output = run_well(nunetd(&arguments));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let pixels = u64::from(SIZE.0 * SIZE.1);
    assert_eq!((&found["pixels"], &found["pixels_beyond"]), (&pixels.into(), &pixels.into()));
    assert_eq!(found["labels"]["pixels"], 2 * pixels);
    let stderr = text(&output.stderr);
    let warned =
        stderr.lines().any(|line| line.contains("WARN") && line.contains("50 %") && line.contains("10 m"));
    assert!(warned, "{stderr}");
}

#[test]
fn truth_entirely_beyond_the_cap_hints_at_a_wrong_scale() {
    let bench = dataset(0);
    for (name, millimeters) in [("a", 2000_u16), ("b", 3000)] {
        let depth = ImageBuffer::from_pixel(SIZE.0, SIZE.1, Luma([millimeters]));
        depth.save(bench.path(&format!("data/depth/{name}.png"))).unwrap();
    }
    snapshot!(outcome(&bench, &["--depth-scale", "1"]));
}

#[test]
fn nunetds_own_depth_is_no_truth_unless_it_is_requested() {
    let bench = Bench::new();
    let (model, own, camera) = (bench.arg("model.onnx"), bench.arg("own.mcap"), camera("own"));
    for frame in 0..3 {
        bench.add_image(&format!("images/{frame}.png"), frame);
    }
    let images = bench.arg("images");
    let record = ["-q", "--model", &model, "--source", &images, "--camera", &camera];
    run_well(nunetd(&[&record[..], &["--record", &own]].concat()));
    let refused = outcome_of("own.mcap", &bench, &[]);
    let topic = format!("/{camera}/depth/image_raw");
    let output = run_well(nunetd(&eval(&own, &model, &["--depth-topic", &topic, "--json"])));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["pictures"], 3, "{found}");

    let calibrate = ["-q", "calibrate", "--truth", &own, "--model", &model, "--json"];
    assert_eq!(seen(&bench, &run(nunetd(&calibrate))), refused, "as `eval` says");
    snapshot!(refused);
    let output = run_well(nunetd(&[&calibrate[..], &["--depth-topic", &topic]].concat()));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!((found["factor"].as_f64().unwrap() - 1.0).abs() < 1e-3, "{found}");
}

/// It would count for the network and not for the mean image.
#[test]
fn an_image_of_another_size_than_the_mean_image_is_not_compared() {
    let bench = dataset(100);
    std::fs::write(bench.path("b.txt"), "b").unwrap();
    for folder in ["rgb", "depth", "labels"] {
        let path = bench.path(&format!("data/{folder}/a.png"));
        image::open(&path).unwrap().crop_imm(0, 0, 64, 48).save(&path).unwrap();
    }
    let (data, model, list) = (bench.arg("data"), bench.arg("model.onnx"), bench.arg("b.txt"));
    let output = run(nunetd(&eval(&data, &model, &["--baseline-ids", &list, "--json"])));
    assert_eq!(output.status.code(), Some(3));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&found["pictures"], &found["skipped"]), (&1.into(), &1.into()));
    assert_eq!(found["pixels"], SIZE.0 * SIZE.1, "those of the other alone");
    assert_eq!(found["metrics"], found["image_mean"], "of one image");
}

#[test]
fn bad_arguments_are_reported_before_the_work() {
    let bench = dataset(0);
    std::fs::write(bench.path("twice.txt"), "a\na\n").unwrap();
    let twice = bench.arg("twice.txt");
    let arguments = [["--ids", &twice], ["--window", "8,8,4"], ["--ids", "/dev/zero"]];
    let mut refusals = Vec::from(arguments.map(|rest| outcome(&bench, &rest)));
    std::fs::remove_dir_all(bench.path("data/depth")).unwrap();
    refusals.push(outcome(&bench, &[]));
    snapshot!(refusals.join("\n\n"));
    assert!(!Path::new(&bench.path("out")).exists());
}

/// Depth of 32FC1 has no largest value, unlike 16-bit millimeters (65.535 m).
#[test]
fn all_depth_of_a_recording_is_compared_up_to_the_cap() {
    let bench = Bench::new();
    let color = [90, 120, 60];
    let frames = [70.0, 30.0, 20.0].map(|depth_m| (depth_m as i64, Some(color), depth_m));
    bench.add_recording("far.mcap", &frames, SIZE);
    let found = report_of("far.mcap", &bench, &["--depth-cap", "100"]);
    assert_eq!((&found["pictures"], &found["skipped"]), (&3.into(), &0.into()));
    assert_eq!((&found["pixels"], &found["pixels_beyond"]), (&(3 * SIZE.0 * SIZE.1).into(), &0.into()));
    let predicted = f64::from(models::connected_depth(color));
    let squares: f64 = frames.iter().map(|frame| (f64::from(frame.2) - predicted).powi(2)).sum();
    assert_near(&found["metrics"]["rmse"], (squares / 3.0).sqrt(), 0.02);
    let capped = report_of("far.mcap", &bench, &["--depth-cap", "50"]);
    assert_eq!(capped["pixels_beyond"], SIZE.0 * SIZE.1);
}

#[test]
fn millimeters_where_meters_are_stated_are_refused_and_so_is_another_unit() {
    let bench = Bench::new();
    let frames = [5000.0, 6000.0, 7000.0].map(|depth| (depth as i64, Some([90, 120, 60]), depth));
    bench.add_recording("mm.mcap", &frames, SIZE);
    let arguments: [&[&str]; 3] = [&[], &["--depth-scale", "0.001"], &["--depth-offset", "5"]];
    snapshot!(arguments.map(|rest| outcome_of("mm.mcap", &bench, rest)).join("\n\n"));
}

#[test]
fn a_recordings_depth_of_another_size_is_named_by_its_topic() {
    let bench = Bench::new();
    bench.add_recording("small.mcap", &[(1, Some([9, 9, 9]), 2.0), (2, Some([9, 9, 9]), 2.0)], (32, 24));
    // No temporary file is named.
    snapshot!(outcome_of("small.mcap", &bench, &[]));
}

#[test]
fn depth_may_be_recorded_in_any_order() {
    let bench = Bench::new();
    let color = Some([20, 20, 20]);
    // Depth of a later time comes between. Waiting for it would lose the images before.
    let frames = [(1, color, 1.0), (9, None, 9.0), (2, color, 2.0), (3, color, 3.0)];
    bench.add_recording("disorder.mcap", &frames, SIZE);
    let found = report_of("disorder.mcap", &bench, &[]);
    assert_eq!((&found["pictures"], &found["skipped"]), (&3.into(), &0.into()));
    let predicted = f64::from(models::connected_depth([20, 20, 20]));
    let squares: f64 = [1.0, 2.0, 3.0].map(|depth_m: f64| (depth_m - predicted).powi(2)).iter().sum();
    assert_near(&found["metrics"]["rmse"], (squares / 3.0).sqrt(), 0.02);
}

/// As in TUM's sequences, where some images and depth may have equal names by chance.
#[test]
fn names_that_are_times_are_joined_also_beside_equal_names_and_others() {
    let bench = dataset(100);
    let rename = |folder: &str, from: &str, to: &str| {
        let path = |name: &str| bench.path(&format!("data/{folder}/{name}.png"));
        std::fs::rename(path(from), path(to)).unwrap();
    };
    std::fs::remove_dir_all(bench.path("data/labels")).unwrap();
    for (from, image, depth) in [("a", "1.000", "1.000"), ("b", "2.000", "2.015")] {
        rename("rgb", from, image);
        rename("depth", from, depth);
    }
    std::fs::write(bench.path("data/rgb/thumb.png"), "").unwrap();
    let (data, model) = (bench.arg("data"), bench.arg("model.onnx"));
    let output = run_well(nunetd(&["eval", &data, "--model", &model, "--focal", "off", "--json"]));
    let (found, stderr): (Value, _) = (serde_json::from_slice(&output.stdout).unwrap(), text(&output.stderr));
    assert_eq!((&found["pictures"], &found["skipped"]), (&2.into(), &0.into()));
    assert_near(&found["metrics"]["rmse"], 0.1, 0.0005);
    let reported: Vec<_> =
        stderr.lines().filter(|line| line.contains("20 ms") || line.contains("`thumb`")).collect();
    snapshot!(reported.join("\n"));
}
