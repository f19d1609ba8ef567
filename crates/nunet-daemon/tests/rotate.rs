//! `--rotate`: a camera that is mounted turned gives the results of one that is mounted upright.

use image::imageops::{rotate90, rotate180, rotate270};
use image::{ImageBuffer, Luma, Pixel};
use nunet_ipc::{CameraName, FrameSet, Reader, Topic};
use nunet_testkit::models;
use serde_json::Value;

use crate::support::{Bench, Guarded, SIZE, TIMEOUT, camera, nunetd, outcome, run_well, snapshot, wait_for};

const MOUNT: &str = "0.1,0,0.5,0,0.1,0";

/// The camera of the upright image of 640x480 pixels, and that of the images as each turned camera stores
/// them: an image that is rotated clockwise by the angle is upright.
const UPRIGHT: &str = "518,520,330.5,250.25@640x480";
const STORED: [(&str, &str); 3] = [
    ("90", "520,518,250.25,308.5@480x640"),
    ("180", "518,520,308.5,228.75@640x480"),
    ("270", "520,518,228.75,330.5@480x640"),
];

/// An upright image as a camera that is turned by the angle stores it.
fn stored<P: Pixel + 'static>(
    angle: &str,
    upright: &ImageBuffer<P, Vec<P::Subpixel>>,
) -> ImageBuffer<P, Vec<P::Subpixel>> {
    match angle {
        "90" => rotate270(upright),
        "180" => rotate180(upright),
        "270" => rotate90(upright),
        _ => upright.clone(),
    }
}

/// An upright image, and the same as the three cameras store it, in a folder each.
fn add_images(bench: &Bench) {
    bench.add_image("upright/a.png", 7);
    let upright = image::open(bench.path("upright/a.png")).unwrap().into_rgb8();
    for (angle, _) in STORED {
        std::fs::create_dir(bench.path(angle)).unwrap();
        stored(angle, &upright).save(bench.path(angle).join("a.png")).unwrap();
    }
}

/// Three upright images with true depth and labels, and the same as the three cameras store them, in a folder
/// each. The truth is wrong on the left and at the bottom, so that a rotated error is another one.
fn add_datasets(bench: &Bench) {
    for (name, frame) in [("a", 1), ("b", 20), ("c", 40)] {
        bench.add_image("image.png", frame);
        let mut rgb = image::open(bench.path("image.png")).unwrap().into_rgb8();
        rgb.iter_mut().for_each(|value| *value /= 4);
        let error = |x: u32, y: u32| if x < SIZE.0 / 5 || y > SIZE.1 / 2 { 1.25 } else { 1.0 };
        let depth = ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| {
            let depth_m = models::connected_depth(rgb.get_pixel(x, y).0) * error(x, y);
            Luma([(1000.0 * depth_m).round() as u16])
        });
        let labels = image::GrayImage::from_fn(SIZE.0, SIZE.1, |x, y| {
            Luma([if x < 100 { 1 } else { models::label(rgb.get_pixel(x, y).0) }])
        });
        for angle in ["upright", "90", "180", "270"] {
            let file = |folder: &str| {
                let folder = bench.path(angle).join(folder);
                std::fs::create_dir_all(&folder).unwrap();
                folder.join(format!("{name}.png"))
            };
            stored(angle, &rgb).save(file("rgb")).unwrap();
            stored(angle, &depth).save(file("depth")).unwrap();
            stored(angle, &labels).save(file("labels")).unwrap();
        }
    }
}

/// The JSON that a subcommand prints, without the name of the dataset.
fn json_of(bench: &Bench, arguments: &[&str]) -> Value {
    let mut command = nunetd(&["-q"]);
    command.args(arguments).args(["--json", "--model", &bench.arg("model.onnx")]);
    let mut printed: Value = serde_json::from_slice(&run_well(command).stdout).unwrap();
    printed.as_object_mut().unwrap().remove("dataset");
    printed
}

fn hash_of_replay(bench: &Bench, recording: &str, how: &[&str]) -> (Value, Value) {
    let (input, output) = (bench.arg(recording), bench.arg("replayed.mcap"));
    let model = bench.arg("model.onnx");
    let mut command = nunetd(&["-q", "replay", &input, &output, "--json", "--force", "--model", &model]);
    command.args(["--provider", "cpu", "--threads", "1"]).args(how);
    let replayed: Value = serde_json::from_slice(&run_well(command).stdout).unwrap();
    (replayed["frames"].clone(), replayed["depth_and_labels_sha256"].clone())
}

#[test]
fn depth_cloud_and_obstacles_are_those_of_a_camera_that_is_mounted_upright() {
    let bench = Bench::new();
    add_images(&bench);
    let infer = |folder: &str, how: &[&str]| {
        let (image, out) = (bench.arg(&format!("{folder}/a.png")), bench.arg(&format!("out_{folder}")));
        let mut command = nunetd(&["-q", "infer", &image, "--out", &out, "--obstacles", "--mount", MOUNT]);
        command.args(["--model", &bench.arg("model.onnx")]).args(how);
        run_well(command);
        ["depth.npy", "labels.png", "cloud.ply", "obstacles.json"]
            .map(|file| std::fs::read(bench.path(&format!("out_{folder}")).join(file)).unwrap())
    };
    let expected = infer("upright", &["--intrinsics", UPRIGHT]);
    for (angle, intrinsics) in STORED {
        assert!(infer(angle, &["--rotate", angle, "--intrinsics", intrinsics]) == expected, "{angle}");
        let stats = std::fs::read(bench.path(&format!("out_{angle}/stats.json"))).unwrap();
        let stats: Value = serde_json::from_slice(&stats).unwrap();
        assert_eq!(stats["bytes_copied_per_frame"], f64::from(3 * SIZE.0 * SIZE.1), "{angle}");
    }
}

#[test]
fn a_recording_holds_rotated_images_and_one_of_turned_images_is_rotated_in_a_replay() {
    let bench = Bench::new();
    add_images(&bench);
    let record = |folder: &str, how: &[&str]| {
        let (source, file) = (bench.arg(folder), bench.arg(&format!("{folder}.mcap")));
        let mut command = nunetd(&["-q", "--source", &source, "--camera", &camera("rotate"), "--force"]);
        command.args(["--model", &bench.arg("model.onnx"), "--record", &file]).args(how);
        run_well(command);
    };
    record("upright", &["--intrinsics", UPRIGHT]);
    let expected = hash_of_replay(&bench, "upright.mcap", &[]);
    for (angle, intrinsics) in STORED {
        record(angle, &["--rotate", angle, "--intrinsics", intrinsics]);
        assert_eq!(hash_of_replay(&bench, &format!("{angle}.mcap"), &[]), expected, "{angle}");
        // As the camera stored them, with the camera in the recording.
        record(angle, &["--intrinsics", intrinsics]);
        let how = ["--rotate", angle];
        assert_eq!(hash_of_replay(&bench, &format!("{angle}.mcap"), &how), expected, "{angle}");
    }
}

#[test]
fn eval_and_calibrate_measure_the_same_as_with_a_camera_that_is_mounted_upright() {
    let bench = Bench::new();
    add_datasets(&bench);
    // Pixels of readings and of a tape measure are those of the upright image.
    let table = |folder: &str| {
        // The distances agree with the depth of an untrained network, up to one factor.
        let rows = [("a", 100, 50, 2.5), ("b", 400, 300, 2.37), ("c", 600, 100, 3.21)]
            .map(|(name, u, v, distance)| format!("{folder}/rgb/{name}.png,{u},{v},{distance}\n"));
        let file = bench.path(&format!("{folder}.csv"));
        std::fs::write(&file, format!("image,u,v,distance\n{}", rows.concat())).unwrap();
        file.to_str().unwrap().to_owned()
    };
    let measure = |folder: &str, how: &[&str]| {
        let (data, rgb, table) = (bench.arg(folder), bench.arg(&format!("{folder}/rgb")), table(folder));
        let distance = ["calibrate", "--source", &rgb, "--distance", "2.5", "--at", "500,100"];
        [
            &["eval", &data, "--depth-cap", "20"][..],
            &["calibrate", "--truth", &data, "--depth-cap", "20"],
            &["calibrate", "--pairs", &table],
            &distance,
        ]
        .map(|subcommand| json_of(&bench, &[subcommand, how].concat()))
    };
    let expected = measure("upright", &["--intrinsics", UPRIGHT]);
    assert!(expected[0]["metrics"]["abs_rel"].as_f64().unwrap() > 0.01, "{}", expected[0]);
    for (angle, intrinsics) in STORED {
        let found = measure(angle, &["--rotate", angle, "--intrinsics", intrinsics]);
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!(found, expected, "{angle}");
        }
    }
    let unrotated =
        json_of(&bench, &["eval", &bench.arg("180"), "--depth-cap", "20", "--intrinsics", STORED[1].1]);
    assert_ne!(unrotated, expected[0], "the network sees other images");
}

fn next_set(name: &str) -> FrameSet {
    let mut reader = Reader::open(&CameraName::new(name).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    wait_for("a frame", || {
        reader.wait(std::time::Duration::from_millis(100)).unwrap();
        reader.next_set().unwrap()
    })
}

#[test]
fn images_in_shared_memory_are_rotated_with_their_camera_and_count_as_copied() {
    let bench = Bench::new();
    add_images(&bench);
    let (model, images) = (bench.arg("model.onnx"), bench.arg("90"));
    let (front, depth) = (camera("turned"), camera("turned_depth"));
    let mut feed = nunetd(&["-q", "feed", &images, "--camera", &front, "--loop", "--rate", "20"]);
    feed.args(["--intrinsics", STORED[0].1]);
    let _feeder = Guarded::start(feed);
    let source = format!("shm:{front}");
    let mut run = nunetd(&["-q", "--model", &model, "--source", &source, "--camera", &depth]);
    run.args(["--rotate", "90"]);
    let _daemon = Guarded::start(run);
    let set = next_set(&depth);
    let header = set.get(Topic::Depth).unwrap().header();
    assert_eq!(header.bytes_copied, u64::from(3 * SIZE.0 * SIZE.1));
    assert_eq!([header.fx, header.fy, header.cx, header.cy], [518.0, 520.0, 330.5, 250.25]);
}

#[test]
fn another_angle_is_refused_with_the_ones_that_exist() {
    let bench = Bench::new();
    std::fs::write(bench.path("nunet.toml"), "source = \"demo\"\nrotate = 45\n").unwrap();
    let file = bench.arg("nunet.toml");
    let outcomes = [&["run", "--source", "demo", "--rotate", "45"][..], &["run", "--config", &file]]
        .map(|arguments| outcome(&bench, nunetd(arguments)));
    snapshot!(outcomes.join("\n\n"));
}
