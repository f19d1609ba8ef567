//! Several cameras in one daemon: one network, and nothing else in common.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::process::Output;
use std::time::{Duration, Instant};

use nunet_ipc::{CameraName, Reader, Topic};
use nunet_testkit::models;
use nunet_testkit::onnx::OnnxElement;
use serde_json::Value;

use crate::support::{
    Bench, Guarded, SIZE, TIMEOUT, camera, nunetd, outcome, run, run_well, signal, snapshot, text, wait_for,
};

impl Bench {
    /// Writes a configuration with this model and these lines.
    fn configure(&self, lines: &str) -> String {
        let text = format!("model = \"{}\"\n{lines}", self.arg("model.onnx"));
        std::fs::write(self.path("nunetd.toml"), text).unwrap();
        self.arg("nunetd.toml")
    }

    /// Writes the results of one image to the folder `out`.
    fn infer(&self, image: &str, out: &str, rest: &[&str]) {
        let (image, model) = (self.arg(image), self.arg("model.onnx"));
        let mut command = nunetd(&["-q", "infer", &image, "--model", &model, "--out", &self.arg(out)]);
        command.args(rest);
        run_well(command);
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&std::fs::read(self.path(name)).unwrap()).unwrap()
    }
}

fn section(name: &str, source: &str, rest: &str) -> String {
    format!("[[camera]]\nname = \"{name}\"\nsource = \"{source}\"\n{rest}\n")
}

/// What a user sees of a daemon with this configuration.
fn refused(bench: &Bench, lines: &str) -> String {
    outcome(bench, nunetd(&["-q", "--config", &bench.configure(lines)]))
}

fn first_frame(name: &str) -> Reader {
    let reader = Reader::open(&CameraName::new(name).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    let start = Instant::now();
    while reader.latest(Topic::Depth).unwrap().is_none() {
        assert!(start.elapsed() < TIMEOUT, "no frame of `{name}` came");
        reader.wait(Duration::from_millis(50)).unwrap();
    }
    reader
}

fn is_gone(name: &str) -> bool {
    Reader::open(&CameraName::new(name).unwrap(), &[Topic::Depth], Duration::ZERO).is_err()
}

#[test]
fn each_camera_has_its_own_results_settings_and_counts_and_the_stats_have_all() {
    let bench = Bench::new();
    bench.add_image("left/0.png", 0);
    bench.add_image("right/0.png", 40);
    let (front, rear) = (camera("front"), camera("rear"));
    let config = bench.configure(&format!(
        "stats-json = \"{}\"\nrecord = \"{}\"\n{}{}",
        bench.arg("stats.json"),
        bench.arg("left"),
        section(&front, &bench.arg("left/*.png"), &format!("out = \"{}\"", bench.arg("front"))),
        section(
            &rear,
            &bench.arg("right"),
            &format!("loop = true\nframes = 40\nfilter = [\"decimation\"]\nout = \"{}\"", bench.arg("rear")),
        ),
    ));
    run_well(nunetd(&["-q", "--config", &config]));

    // The same images alone.
    bench.infer("left/0.png", "alone/front", &[]);
    bench.infer("right/0.png", "alone/rear", &["--filter", "decimation"]);
    let file = |name: &str| std::fs::read(bench.path(name)).unwrap();
    for name in ["depth.npy", "labels.png", "cloud.ply"] {
        assert_eq!(file(&format!("front/{name}")), file(&format!("alone/front/{name}")), "{name}");
        assert_eq!(file(&format!("rear/{name}")), file(&format!("alone/rear/{name}")), "{name}");
        assert_ne!(file(&format!("front/{name}")), file(&format!("rear/{name}")), "{name}");
    }

    let stats = bench.json("stats.json");
    let names: Vec<_> = stats["cameras"].as_array().unwrap().iter().map(|camera| &camera["camera"]).collect();
    assert_eq!(names, [front.as_str(), rear.as_str()]);
    let published = |stats: &Value| stats["frames"]["published"].as_u64().unwrap();
    assert_eq!([&stats["cameras"][0], &stats["cameras"][1], &stats].map(published), [1, 40, 41]);
    assert_eq!((&stats["contract"], &stats["frames"]["in_flight"]), (&1.into(), &0.into()));
    assert_eq!(stats["camera"], format!("{front}, {rear}"));
    assert!(stats["latency_ms"]["total"]["p50"].as_f64().unwrap() > 0.0);
    let stages =
        |stats: &Value| stats["latency_ms"]["stages"].as_object().unwrap().contains_key("decimation");
    assert_eq!([&stats["cameras"][0], &stats["cameras"][1], &stats].map(stages), [false, true, true]);
    assert_eq!(stats["cameras"][1]["allocations_per_frame"], 0.0, "{stats}");
    let recordings = std::fs::read_dir(bench.path("left")).unwrap().map(|entry| entry.unwrap().file_name());
    let recordings: Vec<_> = recordings.map(|name| name.into_string().unwrap()).collect();
    for name in [&front, &rear] {
        let own = |file: &&String| file.starts_with(name.as_str()) && file.ends_with(".mcap");
        assert_eq!(recordings.iter().filter(own).count(), 1, "{recordings:?}");
    }
}

#[test]
fn one_camera_in_a_section_is_the_same_as_without() {
    let bench = Bench::new();
    let name = camera("single");
    let config = bench.configure(&section(&name, "demo", "frames = 3"));
    let stats = bench.arg("stats.json");
    let output = run_well(nunetd(&["--config", &config, "--stats-json", &stats]));
    let stats = bench.json("stats.json");
    assert_eq!((&stats["camera"], &stats["frames"]["published"]), (&name.into(), &3.into()));
    assert!(stats.get("cameras").is_none(), "{stats}");
    assert!(!text(&output.stderr).contains("camera{"), "log lines need no camera: {}", text(&output.stderr));
}

#[test]
fn a_slow_camera_is_not_starved_by_one_that_never_waits() {
    let bench = Bench::new();
    let (fast, slow) = (camera("fast"), camera("slow"));
    let config = bench.configure(&format!(
        "stats-json = \"{}\"\n{}{}",
        bench.arg("stats.json"),
        section(&fast, "demo", ""),
        section(&slow, "demo", "rate = 20"),
    ));
    let mut daemon = Guarded::start(nunetd(&["-q", "--config", &config]));
    for name in [&slow, &fast] {
        let reader = first_frame(name);
        let start = Instant::now();
        while reader.latest(Topic::Depth).unwrap().is_none_or(|frame| frame.header().sequence < 10) {
            assert!(start.elapsed() < TIMEOUT, "`{name}` does not go on");
            reader.wait(Duration::from_millis(50)).unwrap();
        }
    }
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(0));
    let stats = bench.json("stats.json");
    for camera in [0, 1] {
        let frames = &stats["cameras"][camera]["frames"];
        let count = |key: &str| frames[key].as_u64().unwrap();
        assert!(count("published") >= 2 && count("failed") == 0, "{stats}");
        assert_eq!(count("captured"), count("published") + count("superseded"), "{stats}");
    }
}

#[test]
fn a_source_that_cannot_be_opened_leaves_the_others_and_is_a_loss() {
    let bench = Bench::new();
    std::fs::write(bench.path("torn.mcap"), "no recording").unwrap();
    std::fs::write(bench.path("gone.mcap"), "none either").unwrap();
    let (good, bad) = (camera("good"), camera("bad"));
    let lines = |bad_source: &str| {
        format!(
            "stats-json = \"{}\"\n{}{}",
            bench.arg("stats.json"),
            section(&bad, bad_source, ""),
            section(&good, "demo", "frames = 20"),
        )
    };
    let one = refused(&bench, &lines(&bench.arg("torn.mcap")));
    let stats = bench.json("stats.json");
    assert_eq!(stats["cameras"][1]["frames"]["published"], 20);
    assert!(stats["cameras"][0]["error"].as_str().unwrap().contains("torn.mcap"), "{stats}");
    assert!(stats["cameras"][1].get("error").is_none());

    // Where no camera can begin, that is the failure.
    let both = format!(
        "{}{}",
        section(&bad, &bench.arg("gone.mcap"), ""),
        section(&good, &bench.arg("torn.mcap"), "")
    );
    let both = refused(&bench, &both);
    snapshot!(format!("{one}\n\n{both}").replace(&bad, "[BAD]").replace(&good, "[GOOD]"));
}

#[test]
fn stats_are_written_even_if_all_cameras_fail() {
    let bench = Bench::new();
    std::fs::write(bench.path("torn.mcap"), "no recording").unwrap();
    std::fs::write(bench.path("stdin"), "no images either").unwrap();
    let (torn, piped) = (camera("torn"), camera("piped"));
    let config = bench.configure(&format!(
        "stats-json = \"{}\"\n{}{}",
        bench.arg("stats.json"),
        section(&torn, &bench.arg("torn.mcap"), ""),
        section(&piped, "-", ""),
    ));
    let mut command = nunetd(&["--config", &config]);
    command.stdin(std::fs::File::open(bench.path("stdin")).unwrap());
    let Output { status, stderr, .. } = run(command);
    let stderr = text(&stderr);
    assert_eq!(status.code(), Some(1), "{stderr}");
    assert_eq!(stderr.matches("0 frames captured: 0 published").count(), 2, "{stderr}");
    let errors: Vec<_> =
        stderr.lines().filter(|line| line.contains("ERROR") || line.starts_with("error: ")).collect();
    snapshot!(bench.redact(&errors.join("\n")).replace(&torn, "[TORN]").replace(&piped, "[PIPED]"));
    let stats = bench.json("stats.json");
    let error = |camera: usize| stats["cameras"][camera]["error"].as_str().unwrap();
    assert!(error(0).contains("torn.mcap") && error(1).contains("Y4M"), "{stats}");
}

/// The value of a sample of the metrics.
fn sample(address: SocketAddr, name: &str) -> Option<f64> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.write_all(b"GET /metrics HTTP/1.1\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer.lines().find_map(|line| line.strip_prefix(name)?.trim().parse().ok())
}

/// A daemon whose metrics are at a port that the system chose, and its log.
fn with_metrics(bench: &Bench, sections: &str) -> (Guarded, SocketAddr) {
    let config = bench.configure(&format!("metrics = \"127.0.0.1:0\"\n{sections}"));
    let mut command = nunetd(&["--config", &config]);
    command.stderr(std::fs::File::create(bench.path("log")).unwrap());
    let daemon = Guarded::start(command);
    let address = wait_for("the metrics' address", || {
        let log = std::fs::read_to_string(bench.path("log")).unwrap();
        log.split_once("metrics on http://")?.1.split_once("/metrics")?.0.parse().ok()
    });
    (daemon, address)
}

#[test]
fn a_camera_that_is_not_plugged_in_is_waited_for_and_its_health_says_so() {
    let bench = Bench::new();
    let (there, away) = (camera("there"), camera("away"));
    let sections =
        [section(&there, "demo", "rate = 20"), section(&away, "/dev/video-of-nobody", "")].concat();
    let (mut daemon, address) = with_metrics(&bench, &sections);
    drop(first_frame(&there));
    let up = |name: &str| sample(address, &format!("nunet_camera_up{{camera=\"{name}\"}}"));
    wait_for("word of the camera that is away", || (up(&away)? == 0.0).then_some(()));
    assert_eq!(up(&there), Some(1.0));
    assert!(!is_gone(&away), "its readers can wait for it");
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(0));
    let log = std::fs::read_to_string(bench.path("log")).unwrap();
    let waiting = format!("camera{{name={away}}}: waiting for camera `/dev/video-of-nobody`: ");
    assert_eq!(log.matches(&waiting).count(), 1, "{log}");
}

#[test]
fn early_failures_are_reported_at_once_and_a_camera_that_has_ended_is_down() {
    let bench = Bench::new();
    bench.add_image("good/0.png", 0);
    // The last one is good: a round without one would end the source.
    bench.add_image("bad/zz.png", 0);
    for number in 0..400 {
        std::fs::write(bench.path(&format!("bad/{number:03}.png")), "no image").unwrap();
    }
    let (bad, over) = (camera("bad"), camera("over"));
    let sections = [
        section(&bad, &bench.arg("bad"), "loop = true\nrate = 20"),
        section(&over, &bench.arg("good"), "loop = true\nframes = 30"),
    ];
    let (mut daemon, address) = with_metrics(&bench, &sections.concat());
    let reader = Reader::open(&CameraName::new(&bad).unwrap(), &[Topic::Stats], TIMEOUT).unwrap();
    let reported = |least: u64| {
        wait_for("the count of failed frames", || {
            let frame = reader.latest(Topic::Stats).unwrap()?;
            Some(frame.stats().unwrap().failed).filter(|failed| *failed >= least)
        })
    };
    let first = reported(1);
    reported(first + 1);
    let metric = |name: &str, labels: &str| sample(address, &format!("nunet_{name}{{camera={labels}}}"));
    let failed = || metric("frames_ended_total", &format!("\"{bad}\",end=\"failed\""));
    let first = wait_for("failed frames in the metrics", || failed().filter(|count| *count > 0.0));
    wait_for("more failed frames in the metrics", || failed().filter(|count| *count > first));

    let up = |name: &str| metric("camera_up", &format!("\"{name}\""));
    wait_for("the end of the other camera", || (up(&over)? == 0.0).then_some(()));
    assert_eq!(metric("frames_ended_total", &format!("\"{over}\",end=\"published\"")), Some(30.0));
    assert_eq!(metric("frames_in_flight", &format!("\"{over}\"")), Some(0.0));
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(3), "frames were lost");
}

#[test]
fn exclusive_resources_of_two_cameras_are_refused() {
    let bench = Bench::new();
    let pair = |one: (&str, &str, &str), other: (&str, &str, &str)| {
        refused(&bench, &format!("{}{}", section(one.0, one.1, one.2), section(other.0, other.1, other.2)))
    };
    let mut seen = vec![
        pair(("front", "demo", ""), ("front", "demo", "")),
        pair(("a", "-", ""), ("b", "-", "")),
        pair(("a", "/dev/video7", ""), ("b", "/dev/video7", "")),
    ];
    let record = format!("record = \"{}\"", bench.arg("one.mcap"));
    seen.push(pair(("a", "demo", &record), ("b", "demo", &record)));
    let out = format!("out = \"{}\"", bench.arg("out"));
    seen.push(pair(("a", "demo", &out), ("b", "demo", &out)));
    assert!(!bench.path("out").exists(), "the folder was made before the refusal");
    let other = format!("out = \"{}\"", bench.arg("./new/../out"));
    std::fs::create_dir(bench.path("new")).unwrap();
    seen.push(pair(("a", "demo", &out), ("b", "demo", &other)));
    std::os::unix::fs::symlink(bench.path("new"), bench.path("link")).unwrap();
    let [one, other] =
        ["new/one.mcap", "link/./one.mcap"].map(|path| format!("record = \"{}\"", bench.arg(path)));
    seen.push(pair(("a", "demo", &one), ("b", "demo", &other)));
    std::os::unix::fs::symlink("/dev/null", bench.path("by-id")).unwrap();
    seen.push(pair(("a", "/dev/null", ""), ("b", &bench.arg("by-id"), "")));
    seen.push(pair(("a", "demo", ""), ("b/c", "demo", "")));
    let paced = format!("rate = 5\n{}{}", section("a", "demo", &out), section("b", "shm:x", ""));
    seen.push(refused(&bench, &paced));
    assert!(!bench.path("out").exists(), "the folder was made before the refusal");
    for of_second in ["topic = \"/x\"", "calibration = \"missing.yaml\"", "focal = \"of\""] {
        seen.push(pair(("a", "demo", ""), ("b", "demo", of_second)));
    }
    snapshot!(seen.join("\n\n"));
}

#[test]
fn a_file_without_a_source_does_not_publish_the_demo_scene_under_the_cameras_name() {
    let bench = Bench::new();
    let second_without = [section("a", "demo", "").as_str(), "[[camera]]\nname = \"b\""].concat();
    let lines =
        ["[[camera]]\nname = \"a\"", &second_without, "camera = \"front\"\n# source = \"shm:front\"", ""];
    snapshot!(lines.map(|lines| refused(&bench, lines)).join("\n\n"));
    let config = bench.configure(&format!("camera = \"{}\"", camera("named_on_the_line")));
    run_well(nunetd(&["-q", "--config", &config, "--source", "demo", "--frames", "1"]));
}

#[test]
fn config_refuses_what_run_refuses_and_prints_what_it_would_take() {
    let bench = Bench::new();
    let config = |lines: &str, rest: &[&str]| {
        let file = bench.configure(lines);
        nunetd(&[&["-q", "config", "--config", &file][..], rest].concat())
    };
    let (demo, twice) = ("source = \"demo\"", section("a", "demo", "").repeat(2));
    let cases: [(&str, &[&str]); 11] = [
        (&twice, &[]),
        (demo, &["--camera", "a/b"]),
        (demo, &["--size", "640x480"]),
        ("source = \"shm:a\"", &["--rate", "5"]),
        ("source = \"ros2:/a\"", &["--rate", "5"]),
        ("camera = \"a\"", &[]),
        (demo, &["--access-group", "nobody-is-in-it"]),
        ("source = \"demo\"\nevery = [\"x=2\"]", &[]),
        (demo, &["--onnxruntime", "/nope"]),
        // A file that is no model is a failure, not a wrong argument, as `run` has it.
        (demo, &["--model", "/etc/passwd"]),
        (demo, &["--intrinsics", "100,100,50,50@100x100"]),
    ];
    let seen = cases.map(|(lines, rest)| outcome(&bench, config(lines, rest)));
    snapshot!(seen.join("\n\n"));
    let stdout = text(&run_well(config(demo, &[])).stdout);
    for line in ["source = \"demo\"", "camera = \"demo\"  # default"] {
        assert!(stdout.lines().any(|printed| printed == line), "{stdout}");
    }
}

#[test]
fn a_start_that_fails_half_way_leaves_no_folders_and_no_recordings() {
    let bench = Bench::new();
    let (first, taken) = (camera("first"), camera("taken"));
    let owner = Guarded::start(nunetd(&[
        "-q",
        "--model",
        &bench.arg("model.onnx"),
        "--source",
        "demo",
        "--rate",
        "5",
        "--camera",
        &taken,
    ]));
    drop(first_frame(&taken));
    let record = |name: &str| format!("record = \"{}\"", bench.arg(name));
    let out = |name: &str| format!("out = \"{}\"", bench.arg(name));
    let of_first = section(&first, "demo", &record("first.mcap"));
    let of_taken =
        section(&taken, "demo", &format!("{}\n{}", record("new/of/taken.mcap"), out("new/of/taken")));
    let stats = format!("stats-json = \"{}\"\n", bench.arg("new/stats.json"));
    let of_both = refused(&bench, &format!("{stats}{of_first}{of_taken}"));
    assert!(!bench.path("first.mcap").exists() && !bench.path("new").exists(), "{of_both}");

    let nowhere = camera("nowhere");
    let of_nowhere = section(&nowhere, "demo", &record("missing/nowhere.mcap"));
    let without_folder = refused(&bench, &format!("{of_first}{of_nowhere}"));
    assert!(!bench.path("first.mcap").exists(), "{without_folder}");
    let seen = format!("{of_both}\n\n{without_folder}").replace(&nowhere, "[NOWHERE]");
    let process = format!("process {}", owner.pid());
    snapshot!(seen.replace(&taken, "[TAKEN]").replace(&process, "process [PID]"));
}

/// Bytes of a process' own memory; shared memory is counted elsewhere.
fn own_memory(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).unwrap();
    1024 * line.trim().trim_end_matches(" kB").parse::<u64>().unwrap()
}

#[test]
fn three_cameras_have_the_weights_in_memory_once() {
    const WEIGHTS: usize = 16 << 20;
    let bench = Bench::new();
    // Depth depends on all weights through an index computed from the image, so none is optimized away.
    let (width, height) = (i64::from(SIZE.0), i64::from(SIZE.1));
    let heavy = models::undescribed_unet(SIZE)
        .constant_f32("heavy", &[WEIGHTS as i64], &vec![1.0; WEIGHTS])
        .constant_i64("one_pixel", &[1], &[1])
        .constant_i64("nowhere", &[1], &[0])
        .node("Slice", &["rgb", "nowhere", "one_pixel", "one_pixel"], &["row"], &[])
        .node("ReduceMax", &["row"], &["brightest"], &[("keepdims", 0.into())])
        .node("Cast", &["brightest"], &["index"], &[("to", 7.into())])
        .node("Gather", &["heavy", "index"], &["weight"], &[])
        .node("Mul", &["depth", "weight"], &["weighed"], &[])
        .output("weighed", OnnxElement::F32, &[1, 1, height, width]);
    let heavy = models::describe(heavy, "heavy", false);
    bench.add_model("model.onnx", &heavy);
    let memory_with = |cameras: usize| {
        let names: Vec<_> = (0..cameras).map(|_| camera("heavy")).collect();
        let sections: String = names.iter().map(|name| section(name, "demo", "rate = 10")).collect();
        let daemon = Guarded::start(nunetd(&["-q", "--config", &bench.configure(&sections)]));
        names.iter().for_each(|name| drop(first_frame(name)));
        own_memory(daemon.pid())
    };
    let (one, three) = (memory_with(1), memory_with(3));
    let weights = (WEIGHTS * size_of::<f32>()) as u64;
    assert!(one > weights, "{one} bytes do not hold the weights: nothing is measured");
    assert!(three < one + weights, "two more cameras took {} MB", (three - one) >> 20);
}
