//! Frames through the whole daemon, seen from other processes.

use std::io::Write as _;
use std::time::{Duration, Instant};

use nunet_ipc::{
    CameraName, Clock, Encoding, Limits, Publisher, Reader, StatsRecord, Topic, TopicPlan, monotonic_nanos,
    unix_nanos,
};
use nunet_testkit::models;
use serde_json::Value;

use crate::support::{Bench, Guarded, TIMEOUT, camera, nunetd, repository, run, run_well, text};

fn json_lines(bytes: &[u8]) -> Vec<Value> {
    text(bytes).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn stats(bench: &Bench, name: &str) -> Value {
    serde_json::from_slice(&std::fs::read(bench.path(name)).unwrap()).unwrap()
}

#[test]
fn a_run_of_the_demo_scene_writes_files_and_its_counts_balance() {
    let bench = Bench::new();
    let (model, out, stats_file) = (bench.arg("model.onnx"), bench.arg("out"), bench.arg("out/stats.json"));
    let name = camera("demo_run");
    run_well(nunetd(&[
        "-q",
        "--model",
        &model,
        "--source",
        "demo",
        "--frames",
        "30",
        "--out",
        &out,
        "--stats-json",
        &stats_file,
        "--camera",
        &name,
    ]));
    for file in ["depth.npy", "depth_mm.png", "depth.png", "labels.png", "cloud.ply"] {
        assert!(bench.path("out").join(file).is_file(), "{file} is missing");
    }
    let stats = stats(&bench, "out/stats.json");
    let frames = &stats["frames"];
    assert_eq!(frames["captured"], 30);
    assert_eq!(frames["published"], 30, "files and scenes at full speed lose nothing");
    assert_eq!(frames["in_flight"], 0);
    assert_eq!(stats["contract"], 1);
    assert_eq!(stats["camera"], name.as_str());
    assert_eq!(stats["model"]["name"], "model.onnx");
    assert!(stats["latency_ms"]["total"]["p50"].as_f64().unwrap() > 0.0);
    assert!(stats["latency_ms"]["stages"]["decode"]["p99"].is_number());
    let cloud_ms = stats["latency_ms"]["stages"]["cloud"]["p50"].as_f64().unwrap();
    assert!(cloud_ms > 0.0, "`--out` reads the cloud, so it is computed");
}

/// The stats of 60 frames of the network's size.
fn steady(bench: &Bench, how: &[&str]) -> Value {
    let (model, images, stats_file) = (bench.arg("model.onnx"), bench.arg("images"), bench.arg("stats.json"));
    let name = camera("steady");
    let source = ["-q", "--model", &model, "--source", &images, "--loop", "--frames", "60"];
    run_well(nunetd(&[&source[..], &["--camera", &name, "--stats-json", &stats_file], how].concat()));
    stats(bench, "stats.json")
}

#[test]
fn the_steady_frame_path_copies_nothing_and_allocates_nothing() {
    let bench = Bench::new();
    (0..3).for_each(|frame| bench.add_image(&format!("images/{frame}.png"), frame));
    let record = bench.arg("a.mcap");
    for how in [
        &["--out", &bench.arg("out")][..],
        &["--publish", "depth"],
        &["--record", &record, "--publish", "depth"],
    ] {
        let stats = steady(&bench, how);
        assert_eq!(stats["bytes_copied_per_frame"], 0.0, "{how:?}");
        assert_eq!(stats["allocations_per_frame"], 0.0, "{how:?}");
    }
}

#[test]
fn watch_follows_a_running_daemon_and_its_counts_balance() {
    let bench = Bench::new();
    let (model, name) = (bench.arg("model.onnx"), camera("watched"));
    let _daemon = Guarded::start(nunetd(&[
        "-q", "--model", &model, "--source", "demo", "--rate", "20", "--camera", &name,
    ]));
    let seen = json_lines(&run_well(nunetd(&["watch", &name, "--json", "--frames", "10"])).stdout);
    assert_eq!(seen.len(), 10);
    for (earlier, later) in seen.iter().zip(&seen[1..]) {
        assert!(later["sequence"].as_u64() > earlier["sequence"].as_u64());
    }
    assert!(!seen[0]["stages"].as_object().unwrap().is_empty(), "{}", seen[0]);
    assert!(seen[0]["frames"]["captured"].as_u64().unwrap() > 0, "{}", seen[0]);
    let last = &seen[9];
    assert_eq!(last["contract"], 1);
    assert_eq!(last["quality"], "full");
    assert!(last["depth_center_m"].as_f64().unwrap() >= 0.5, "the network's depth starts at 0.5 m");
    assert!(last["stages"].as_object().unwrap().contains_key("preprocess"));
    // No cloud takes no microsecond; a thread that loses its processor between two looks at the clock makes
    // one.
    let without = seen.iter().any(|frame| frame["stages"]["cloud"] == 0);
    assert!(without, "nobody reads the cloud, so it is not computed: {last}");
    let count = |key: &str| last["frames"][key].as_u64().unwrap();
    assert_eq!(
        count("captured"),
        count("published") + count("superseded") + count("failed") + count("in_flight")
    );
}

/// What `watch` prints of a depth map that was taken at that time.
fn watched(clock: Clock, capture_nanos: i64, capture_unix_nanos: i64, arguments: &[&str]) -> String {
    let name = camera("aged");
    let plan = |topic, payload_bytes| TopicPlan { topic, payload_bytes };
    let plans = [plan(Topic::Depth, 4), plan(Topic::Stats, size_of::<StatsRecord>())];
    let owner = Publisher::create(&CameraName::new(&name).unwrap(), &plans, &Limits::default()).unwrap();
    let mut loan = owner.loan(Topic::Depth).unwrap();
    let header = loan.header_mut();
    (header.width, header.height) = (1, 1);
    (header.capture_nanos, header.capture_unix_nanos) = (capture_nanos, capture_unix_nanos);
    header.set_capture_clock(clock);
    header.set_encoding(Encoding::DepthF32);
    loan.publish(monotonic_nanos()).unwrap();
    let command = nunetd(&[&["watch", &name, "--frames", "1", "--timeout", "30"], arguments].concat());
    let watch = std::thread::spawn(move || run_well(command));
    while !watch.is_finished() {
        owner.refresh().unwrap(); // for the late joiner
        std::thread::sleep(Duration::from_millis(20));
    }
    text(&watch.join().unwrap().stdout)
}

#[test]
fn watch_prints_the_age_by_the_cameras_clock_and_none_for_an_unknown_time() {
    let age_ms = |clock, nanos, unix_nanos| {
        let printed = watched(clock, nanos, unix_nanos, &["--json"]);
        json_lines(printed.as_bytes())[0]["age_ms"].clone()
    };
    let minute = 60_000_000_000;
    let old = age_ms(Clock::Monotonic, monotonic_nanos() - minute, 1).as_f64().unwrap();
    assert!((60_000.0..3_600_000.0).contains(&old), "{old}");
    let old = age_ms(Clock::Media, 5, unix_nanos() - minute).as_f64().unwrap();
    assert!((60_000.0..3_600_000.0).contains(&old), "{old}");
    assert!(age_ms(Clock::Media, 5, 0).is_null());
    let hostile = age_ms(Clock::Unix, 0, i64::MIN);
    assert_eq!(hostile.as_f64(), Some(i64::MAX as f64 / 1e6));
    let line = watched(Clock::Media, 5, 0, &[]);
    assert!(line.starts_with("frame 0 age unknown center "), "{line}");
}

#[test]
fn a_stage_that_runs_each_third_frame_is_stamped_on_the_frames_that_reuse_it() {
    let model = repository().join("models/tiny/tiny_wnet_c.toml");
    let name = camera("every");
    let _daemon = Guarded::start(nunetd(&[
        "-q",
        "--model",
        model.to_str().unwrap(),
        "--source",
        "demo",
        "--rate",
        "10", // slow enough for a reader on a busy machine: one that skips frames sees another share
        "--camera",
        &name,
        "--every",
        "segmentation=3",
    ]));
    let seen = json_lines(&run_well(nunetd(&["watch", &name, "--json", "--frames", "12"])).stdout);
    let reused = seen.iter().filter(|frame| frame["quality"] == "reused_labels");
    assert!(reused.clone().all(|frame| frame["stages"]["segmentation"] == 0));
    assert!((4..=10).contains(&reused.count()), "about two of three frames: {seen:?}");
    assert!(seen.iter().any(|frame| frame["quality"] == "full"));
}

#[test]
fn a_feeder_a_daemon_and_a_reader_are_three_processes_and_nothing_is_copied() {
    let bench = Bench::new();
    for frame in 0..3 {
        bench.add_image(&format!("images/{frame}.png"), frame);
    }
    let (model, images) = (bench.arg("model.onnx"), bench.arg("images"));
    let (front, depth) = (camera("front"), camera("front_depth"));
    let _feeder =
        Guarded::start(nunetd(&["-q", "feed", &images, "--camera", &front, "--loop", "--rate", "30"]));
    let source = format!("shm:{front}");
    let _daemon = Guarded::start(nunetd(&["-q", "--model", &model, "--source", &source, "--camera", &depth]));
    let seen = json_lines(&run_well(nunetd(&["watch", &depth, "--json", "--frames", "20"])).stdout);
    assert!(seen.iter().all(|frame| frame["bytes_copied"] == 0), "{seen:?}");
    assert!(seen.iter().all(|frame| frame["scale_source"] == "assumed_camera"), "{seen:?}");
}

#[test]
fn the_feeders_own_camera_name_can_carry_the_depth_as_well() {
    let bench = Bench::new();
    bench.add_image("images/0.png", 0);
    let (model, images, front) = (bench.arg("model.onnx"), bench.arg("images"), camera("same"));
    let _feeder = Guarded::start(nunetd(&[
        "-q",
        "feed",
        &images,
        "--camera",
        &front,
        "--loop",
        "--rate",
        "30",
        "--intrinsics",
        "1050,1050,319.5,239.5",
    ]));
    let source = format!("shm:{front}");
    let _daemon = Guarded::start(nunetd(&["-q", "--model", &model, "--source", &source, "--camera", &front]));
    let seen = json_lines(&run_well(nunetd(&["watch", &front, "--json", "--frames", "3"])).stdout);
    assert_eq!(seen[2]["scale_source"], "focal_scaled", "the feeder's intrinsics travel with the frames");
}

#[test]
fn a_late_subscriber_gets_the_last_frame_of_a_paused_source() {
    let bench = Bench::new();
    bench.add_image("images/0.png", 0);
    let (model, images) = (bench.arg("model.onnx"), bench.arg("images"));
    let (front, depth) = (camera("still"), camera("still_depth"));
    let source = format!("shm:{front}");
    let _daemon = Guarded::start(nunetd(&["-q", "--model", &model, "--source", &source, "--camera", &depth]));
    // The feeder runs until a depth map was seen, however long the daemon takes to start. Then the source is
    // paused.
    let mut feeder =
        Guarded::start(nunetd(&["-q", "feed", &images, "--camera", &front, "--loop", "--rate", "20"]));
    let early = run_well(nunetd(&["watch", &depth, "--json", "--frames", "1", "--timeout", "50"]));
    assert_eq!(json_lines(&early.stdout).len(), 1);
    assert_eq!(feeder.stop(), Some(0));
    let late = run(nunetd(&["watch", &depth, "--json", "--frames", "1"]));
    assert_eq!(json_lines(&late.stdout).len(), 1, "{}", text(&late.stderr));
}

#[test]
fn a_late_subscriber_gets_the_last_image_of_a_waiting_feeder() {
    let bench = Bench::new();
    bench.add_image("still.png", 0);
    let (model, still) = (bench.arg("model.onnx"), bench.arg("still.png"));
    let (slow, piped) = (camera("slow"), camera("paused"));
    let _slow =
        Guarded::start(nunetd(&["-q", "feed", &still, "--camera", &slow, "--rate", "0.01", "--loop"]));
    let (stdin, mut pipe) = std::io::pipe().unwrap();
    let mut feed = nunetd(&["-q", "feed", "-", "--camera", &piped, "--size", "64x48", "--format", "mono8"]);
    feed.stdin(stdin);
    let _piped = Guarded::start(feed);
    pipe.write_all(&[100; 64 * 48]).unwrap();
    for front in [&slow, &piped] {
        // After this reader received the image, every new reader is a late subscriber.
        let early = Reader::open(&front.parse().unwrap(), &[Topic::Rgb], TIMEOUT).unwrap();
        let start = Instant::now();
        while early.latest(Topic::Rgb).unwrap().is_none() {
            assert!(start.elapsed() < TIMEOUT, "no image of `{front}`");
            early.wait(Duration::from_millis(50)).unwrap();
        }
        let (source, depth) = (format!("shm:{front}"), camera("late_depth"));
        let how = ["-q", "--model", &model, "--source", &source, "--frames", "1", "--camera", &depth];
        run_well(nunetd(&how));
    }
}

/// A depth frame of a camera, and the reader that it came to.
fn first_depth(name: &str) -> (Reader, u64) {
    let reader = Reader::open(&name.parse().unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    let start = Instant::now();
    loop {
        if let Some(frame) = reader.latest(Topic::Depth).unwrap() {
            let sequence = frame.header().sequence;
            return (reader, sequence);
        }
        assert!(start.elapsed() < TIMEOUT, "no depth of `{name}`");
        reader.wait(Duration::from_millis(50)).unwrap();
    }
}

#[test]
fn labels_and_cloud_of_the_last_frame_are_computed_for_late_subscribers_of_a_paused_source() {
    let bench = Bench::new();
    bench.add_image("still.png", 0);
    let (model, still, name) = (bench.arg("model.onnx"), bench.arg("still.png"), camera("made_late"));
    let _daemon = Guarded::start(nunetd(&[
        "-q", "--model", &model, "--source", &still, "--rate", "0.01", "--loop", "--camera", &name,
    ]));
    let (early, sequence) = first_depth(&name);
    for topics in
        [&[Topic::Depth, Topic::Labels][..], &[Topic::Cloud], &[Topic::Depth, Topic::Labels, Topic::Cloud]]
    {
        let mut late = Reader::open(&name.parse().unwrap(), topics, TIMEOUT).unwrap();
        let start = Instant::now();
        let set = loop {
            if let Some(set) = late.next_set().unwrap() {
                break set;
            }
            assert!(start.elapsed() < TIMEOUT, "nothing for a reader of {topics:?}");
            late.wait(Duration::from_millis(50)).unwrap();
        };
        for &topic in topics {
            assert_eq!(set.get(topic).unwrap().header().sequence, sequence, "{topic}");
        }
        if let Some(labels) = set.get(Topic::Labels) {
            let image = image::open(&still).unwrap().into_rgb8();
            let expected: Vec<_> = image.pixels().map(|pixel| models::label(pixel.0)).collect();
            assert!(labels.labels().unwrap() == expected);
        }
        if let Some(cloud) = set.get(Topic::Cloud) {
            assert!(cloud.points().unwrap().iter().any(|point| point.z > 0.0));
        }
    }
    assert!(
        early.latest(Topic::Depth).unwrap().is_none(),
        "a reader that has the depth does not receive it again"
    );
    let seen = json_lines(&run_well(nunetd(&["watch", &name, "--json", "--frames", "1"])).stdout);
    assert_eq!((&seen[0]["frames"]["captured"], &seen[0]["frames"]["published"]), (&1.into(), &1.into()));
}

#[test]
fn a_frame_that_is_sent_again_does_not_update_state_twice() {
    let bench = Bench::new();
    bench.add_image("still.png", 0);
    let (model, still, name) = (bench.arg("model.onnx"), bench.arg("still.png"), camera("temporal"));
    let how = ["-q", "--model", &model, "--source", &still, "--rate", "0.01", "--loop", "--camera", &name];
    let _daemon = Guarded::start(nunetd(&[&how[..], &["--filter", "temporal"]].concat()));
    first_depth(&name);
    let late = Reader::open(&name.parse().unwrap(), &[Topic::Cloud], TIMEOUT).unwrap();
    // Twice as long as a reader waits who is served.
    let start = Instant::now();
    while start.elapsed() < Duration::from_millis(800) {
        late.wait(Duration::from_millis(50)).unwrap();
        assert!(late.latest(Topic::Cloud).unwrap().is_none());
    }
}
