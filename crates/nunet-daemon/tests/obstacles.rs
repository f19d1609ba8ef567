//! Obstacles through the whole daemon: shared memory, recordings, files, and what is asked for wrongly.

use std::time::{Duration, Instant};

use nunet_ipc::{
    AttitudePublisher, CONTRACT_VERSION, CameraName, Clock, FrameSet, Reader, Topic, Units, monotonic_nanos,
};
use serde_json::Value;

use crate::support::{
    Bench, Guarded, SIZE, TIMEOUT, camera, nunetd, outcome, repository, run, run_well, snapshot, text,
    wait_for,
};

#[path = "../../../examples/stop_before_wall.rs"]
#[expect(dead_code, reason = "its `main` is that of the example")]
mod stop_before_wall;

const MOUNT: &str = "0.1,0,0.5,0,0.1,0";

/// The next frame with all topics.
fn next_set(reader: &mut Reader) -> FrameSet {
    let start = Instant::now();
    while start.elapsed() < TIMEOUT {
        if let Some(set) = reader.next_set().unwrap() {
            return set;
        }
        reader.wait(Duration::from_millis(100)).unwrap();
    }
    panic!("no frame with obstacles came")
}

#[test]
fn a_reader_receives_obstacles_and_without_one_none_are_computed() {
    let bench = Bench::new();
    let (model, stats_file, name) = (bench.arg("model.onnx"), bench.arg("stats.json"), camera("obstacles"));
    let arguments = ["-q", "--model", &model, "--source", "demo", "--camera", &name, "--mount", MOUNT];
    let stages = |stats: &str| -> Value {
        let stats: Value = serde_json::from_str(stats).unwrap();
        stats["latency_ms"]["stages"]["obstacles"].clone()
    };
    let mut unread = nunetd(&arguments);
    run_well({
        unread.args(["--frames", "20", "--stats-json", &stats_file]);
        unread
    });
    let found = stages(&std::fs::read_to_string(bench.path("stats.json")).unwrap());
    assert_eq!(found["max"], 0.0, "nobody read them: {found}");

    let mut command = nunetd(&arguments);
    command.args(["--loop", "--rate", "20", "--sectors", "36", "--max-range", "4"]);
    let _daemon = Guarded::start(command);
    let camera_name = CameraName::new(&name).unwrap();
    let mut reader = Reader::open(&camera_name, &[Topic::Depth, Topic::Obstacles], TIMEOUT).unwrap();
    let set = next_set(&mut reader);
    let frame = set.get(Topic::Obstacles).unwrap();
    let record = frame.obstacles().unwrap();
    assert_eq!((record.contract_version, record.sectors().len()), (CONTRACT_VERSION, 36));
    assert_eq!((record.max_range_m, record.used_labels), (4.0, 0), "the network has no class for floor");
    assert!(record.angle_step_rad > 0.0 && record.points().len() <= 5000);
    assert!(record.sectors().iter().all(|sector| (0.0..=4.1).contains(&sector.range_m)));
    let header = frame.header();
    assert_eq!((header.frame_id().as_ref(), header.units()), ("base_link", Ok(Units::Metre)));
    let depth = set.get(Topic::Depth).unwrap().header();
    assert_eq!((header.sequence, header.capture_nanos), (depth.sequence, depth.capture_nanos));
    assert!(depth.scale_factor > 0.0);
}

#[test]
fn a_recording_has_obstacles_as_points_and_as_a_scan() {
    let bench = Bench::new();
    let (model, file, name) = (bench.arg("model.onnx"), bench.arg("drive.mcap"), camera("scan"));
    let mut command = nunetd(&["-q", "--model", &model, "--source", "demo", "--camera", &name]);
    command.args(["--mount", MOUNT, "--frames", "5", "--record", &file]);
    run_well(command);
    let bytes = std::fs::read(bench.path("drive.mcap")).unwrap();
    let has = |word: &str| bytes.windows(word.len()).any(|window| window == word.as_bytes());
    for word in [&format!("/{name}/scan"), &format!("/{name}/obstacles/points"), "sensor_msgs/msg/LaserScan"]
    {
        assert!(has(word), "{word}");
    }
}

#[test]
fn obstacles_follow_the_attitude_of_the_robot_and_a_stale_one_is_reported() {
    let bench = Bench::new();
    let (model, name, log) = (bench.arg("model.onnx"), camera("attitude"), bench.path("log"));
    let arguments = ["--model", &model, "--source", "demo", "--camera", &name, "--mount", MOUNT];
    let mut command = nunetd(&[&arguments[..], &["--loop", "--rate", "20", "--attitude", "shm"]].concat());
    command.stderr(std::fs::File::create(&log).unwrap());
    let _daemon = Guarded::start(command);
    let is_logged = |text: &str| std::fs::read_to_string(&log).unwrap().contains(text).then_some(());
    let camera_name = CameraName::new(&name).unwrap();
    let mut reader = Reader::open(&camera_name, &[Topic::Depth, Topic::Obstacles], TIMEOUT).unwrap();
    // The field of view depends on the roll of the camera.
    let mut seen = || {
        let set = next_set(&mut reader);
        let message = set.get(Topic::Obstacles).unwrap();
        assert_eq!(message.header().frame_id(), "base_footprint", "obstacles are level, `base_link` is not");
        let record = message.obstacles().unwrap();
        (record.used_attitude, record.angle_min_rad)
    };
    let level = seen();
    assert_eq!(level.0, 0);
    wait_for("a warning", || is_logged("no process publishes it"));

    let mut publisher = AttitudePublisher::create(&camera_name, Clock::Monotonic).unwrap();
    let rolled = wait_for("a frame of the rolled robot", || {
        publisher.publish(monotonic_nanos(), 0.3, 0.0).unwrap();
        Some(seen()).filter(|(used, _)| *used == 1)
    });
    assert!((rolled.1 - level.1).abs() > 0.01, "{rolled:?} {level:?}");
    wait_for("a frame of the level robot", || (seen() == level).then_some(()));
    wait_for("a warning", || is_logged("the nearest sample is"));
}

#[test]
fn a_recording_holds_the_attitude_and_a_replay_finds_the_same_obstacles() {
    let bench = Bench::new();
    let (model, file, name) = (bench.arg("model.onnx"), bench.arg("tilt.mcap"), camera("tilt"));
    let of_last_frame = |out: &str| std::fs::read_to_string(bench.path(out).join("obstacles.json")).unwrap();
    let command = |out: &str, rest: &[&str]| {
        let mut command = nunetd(&["-q", "--model", &model, "--camera", &name, "--mount", MOUNT]);
        command.args(["--out", &bench.arg(out)]).args(rest);
        command
    };
    let mut publisher =
        AttitudePublisher::create(&CameraName::new(&name).unwrap(), Clock::Monotonic).unwrap();
    let mut live = command("live", &["--source", "demo", "--rate", "20", "--frames", "10"]);
    live.args(["--attitude", "shm", "--record", &file, "--record-lossless"]);
    let mut daemon = Guarded::start(live);
    wait_for("the obstacles of the last frame", || {
        publisher.publish(monotonic_nanos(), 0.3, -0.1).unwrap();
        bench.path("live/obstacles.json").is_file().then_some(())
    });
    assert_eq!(daemon.wait(), Some(0));
    let played = ["--source", &file];
    run_well(command("tilted", &[&played[..], &["--attitude", "recording"]].concat()));
    run_well(command("level", &played));
    assert_eq!(of_last_frame("tilted"), of_last_frame("live"));
    assert_ne!(of_last_frame("level"), of_last_frame("live"), "the attitude changes nothing");
}

#[test]
fn a_recording_without_an_attitude_is_reported_without_an_empty_hint() {
    let bench = Bench::new();
    let (model, file, name) = (bench.arg("model.onnx"), bench.arg("level.mcap"), camera("level"));
    let command = |rest: &[&str]| {
        let mut command = nunetd(&["--model", &model, "--camera", &name, "--mount", MOUNT]);
        command.args(rest);
        command
    };
    run_well(command(&["--source", "demo", "--frames", "1", "--record", &file]));
    let log = text(&run_well(command(&["--source", &file, "--attitude", "recording"])).stderr);
    let warned = log.lines().any(|line| line.contains("WARN") && line.contains("1 of 1 frame"));
    assert!(warned && !log.contains("hint=\"\""), "{log}");
}

#[test]
fn frames_without_an_attitude_are_counted() {
    let bench = Bench::new();
    let (model, stats, name) = (bench.arg("model.onnx"), bench.arg("stats.json"), camera("no-attitude"));
    let mut command = nunetd(&["-q", "--model", &model, "--source", "demo", "--camera", &name]);
    command.args(["--mount", MOUNT, "--attitude", "shm", "--frames", "5", "--stats-json", &stats]);
    run_well(command);
    let stats: Value = serde_json::from_slice(&std::fs::read(bench.path("stats.json")).unwrap()).unwrap();
    assert_eq!(stats["frames_without_attitude"], 5, "{stats}");
}

#[test]
fn an_attitude_without_a_mount_is_refused_with_a_hint() {
    let outcomes = [
        &["--source", "demo", "--attitude", "shm"][..],
        &["--mount", MOUNT, "--attitude", "imu"],
        &["--source", "demo", "--mount", MOUNT, "--attitude", "recording"],
    ]
    .map(|arguments| outcome(&Bench::new(), nunetd(arguments)));
    snapshot!(outcomes.join("\n\n"));
}

/// The speed of the example for one image of the rendered drive, with the default network.
fn speed_at(image: &str) -> f32 {
    let models = repository().join("models");
    let (model, image) = (models.join("wnet_c.onnx"), models.join("drive/rgb").join(image));
    let name = camera("robot");
    let mut command = nunetd(&["-q", "--camera", &name, "--loop", "--rate", "5"]);
    command.args(["--mount", "0,0,0.25,0,-0.07,0", "--intrinsics", "262,262,160.3,119.2@320x240"]);
    command.arg("--model").arg(model).arg("--source").arg(image);
    let _daemon = Guarded::start(command);
    let camera_name = CameraName::new(&name).unwrap();
    let mut reader = Reader::open(&camera_name, &[Topic::Obstacles], TIMEOUT).unwrap();
    let set = next_set(&mut reader);
    stop_before_wall::speed(set.get(Topic::Obstacles).unwrap().obstacles().unwrap())
}

#[test]
fn the_example_drives_where_2_m_are_free_and_all_but_stops_half_a_meter_before_a_chair() {
    let [free, near, nearest] = ["0220.jpg", "0230.jpg", "0235.jpg"].map(speed_at);
    assert_eq!(free, 0.6, "m/s");
    assert!(nearest < 0.15 && nearest < near && near < free, "{free} {near} {nearest} m/s");
}

#[test]
fn a_run_leaves_the_obstacles_of_its_last_frame_beside_depth_and_without_a_mount_none() {
    let bench = Bench::new();
    let (model, out, name) = (bench.arg("model.onnx"), bench.arg("out"), camera("last"));
    let arguments = ["-q", "--model", &model, "--source", "demo", "--frames", "3", "--camera", &name];
    for (mount, expected) in [(&[][..], false), (&["--mount", MOUNT], true)] {
        run_well(nunetd(&[&arguments[..], &["--out", &out], mount].concat()));
        for file in ["obstacles.json", "obstacles.png"] {
            assert_eq!(bench.path("out").join(file).is_file(), expected, "{file} {mount:?}");
        }
    }
    let text = std::fs::read_to_string(bench.path("out/obstacles.json")).unwrap();
    let found: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(found["sectors"].as_array().map(Vec::len), Some(72));
}

#[test]
fn infer_writes_obstacles_as_numbers_and_images() {
    let bench = Bench::new();
    let (model, out, image) = (bench.arg("model.onnx"), bench.arg("out"), bench.arg("room.png"));
    bench.add_image("room.png", 7);
    let mut command = nunetd(&["-q", "infer", &image, "--out", &out, "--model", &model]);
    command.args(["--obstacles", "--mount", MOUNT, "--sectors", "12"]);
    run_well(command);
    let text = std::fs::read_to_string(bench.path("out/obstacles.json")).unwrap();
    let found: Value = serde_json::from_str(&text).unwrap();
    assert_eq!((found["contract"].as_u64(), found["sectors"].as_array().map(Vec::len)), (Some(1), Some(12)));
    assert!(
        ["occupied", "free", "unknown", "drop"].contains(&found["sectors"][0]["state"].as_str().unwrap())
    );
    for image in ["obstacles.png", "obstacles_overlay.png"] {
        assert!(image::open(bench.path("out").join(image)).is_ok(), "{image}");
    }
}

#[test]
fn infer_does_not_remember_the_obstacles_of_another_image() {
    let bench = Bench::new();
    let (model, out) = (bench.arg("model.onnx"), bench.arg("out"));
    // The test network sees a surface nearer than any visible floor, and one beyond the range.
    for (name, gray) in [("near.png", 0), ("far.png", 255)] {
        image::RgbImage::from_pixel(SIZE.0, SIZE.1, image::Rgb([gray; 3])).save(bench.path(name)).unwrap();
    }
    let (near, far) = (bench.arg("near.png"), bench.arg("far.png"));
    let mut command = nunetd(&["-q", "infer", &near, &far, "--out", &out, "--model", &model]);
    command.args(["--mount", MOUNT, "--obstacles"]);
    run_well(command);
    for (folder, is_occupied) in [("near", true), ("far", false)] {
        let text = std::fs::read_to_string(bench.path("out").join(folder).join("obstacles.json")).unwrap();
        let found: Value = serde_json::from_str(&text).unwrap();
        let mut sectors = found["sectors"].as_array().unwrap().iter();
        assert_eq!(sectors.any(|sector| sector["state"] == "occupied"), is_occupied, "{folder}: {text}");
    }
}

#[test]
fn a_mount_in_degrees_is_warned_of_at_the_start_whether_or_not_obstacles_are_computed() {
    let bench = Bench::new();
    let model = bench.arg("model.onnx");
    // Below the floor, where obstacles are off.
    for (mount, is_odd) in [("0,0,1,0,0,5", true), ("0,0,-1,0,2,0", true), ("0,0,-1,0,1.5,-3.14", false)] {
        let output = run(nunetd(&["config", "--source", "demo", "--model", &model, "--mount", mount]));
        let log = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{log}");
        assert_eq!(log.matches("radians: 90 degrees").count(), usize::from(is_odd), "{mount}: {log}");
    }
}

#[test]
fn obstacles_without_a_place_or_with_an_impossible_one_are_refused_with_a_hint() {
    let bench = Bench::new();
    let (model, out, image) = (bench.arg("model.onnx"), bench.arg("out"), bench.arg("room.png"));
    bench.add_image("room.png", 7);
    let below = ["--mount", "0,0,-0.2,0,0,0"];
    for (arguments, expected) in [
        (&["run", "--source", "demo", "--clearance", "0.1"][..], "pass --mount"),
        (&["run", "--source", "demo", "--publish", "depth,obstacles"], "pass --mount"),
        (&["run", "--source", "demo", "--publish", "obstacles", below[0], below[1]], "above the floor"),
        (&["run", "--source", "demo", "--sectors", "361", "--mount", MOUNT], "1 to 360"),
        (&["run", "--source", "demo", "--hold=-1", "--mount", MOUNT], "0 or more"),
        (&["run", "--source", "demo", "--hold", "1", "--mount", "0,0,1,0,-1.57,0"], "degrees up"),
        (&["infer", &image, "--out", &out, "--obstacles"], "pass --mount"),
        (&["infer", &image, "--out", &out, "--hold", "1", "--mount", MOUNT], "--hold has no effect"),
        (&["eval", "data", "--obstacles", "--hold", "1", "--mount", MOUNT], "--hold has no effect"),
        (&["eval", "data", "--clip", "--hold", "0", "--mount", MOUNT], "--hold has no effect"),
        (&["replay", "a.mcap", "b.mcap", "--publish", "obstacles", "--mount", MOUNT], "finds no obstacles"),
    ] {
        let mut command = nunetd(arguments);
        command.args(["--model", &model]);
        let output = run(command);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?} {error}");
        assert!(error.contains(expected), "{arguments:?} {error}");
    }
}
