//! Signals, sudden deaths, and what they leave behind.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use nunet_ipc::{CameraName, Limits, Publisher, Reader, Topic, TopicPlan};

use crate::support::{Bench, Guarded, TIMEOUT, camera, ipc_root, nunetd, run, signal, text, wait_for};

fn demo_daemon(bench: &Bench, name: &str) -> Guarded {
    let model = bench.arg("model.onnx");
    let mut command =
        nunetd(&["-q", "--model", &model, "--source", "demo", "--rate", "30", "--camera", name]);
    command.stderr(Stdio::null());
    Guarded::start(command)
}

/// Waits for a frame in shared memory.
fn await_frame(name: &str) -> Reader {
    let reader = Reader::open(&CameraName::new(name).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    let start = Instant::now();
    while start.elapsed() < TIMEOUT {
        reader.wait(Duration::from_millis(50)).unwrap();
        if reader.latest(Topic::Depth).unwrap().is_some() {
            return reader;
        }
    }
    panic!("no frame of `{name}` within {TIMEOUT:?}")
}

/// The same command with a signal treated as `env` says, whatever the tests were started with.
fn under_env(how: &str, command: &Command) -> Command {
    let mut wrapped = Command::new("env");
    wrapped.arg(how).arg(command.get_program()).args(command.get_args()).stdin(Stdio::null());
    for (name, value) in command.get_envs() {
        wrapped.env(name, value.unwrap());
    }
    wrapped
}

#[test]
fn sigterm_sigint_and_sighup_end_a_run_cleanly_with_its_stats() {
    for name in ["TERM", "INT", "HUP"] {
        let bench = Bench::new();
        let (model, stats, camera) = (bench.arg("model.onnx"), bench.arg("stats.json"), camera("ended"));
        let command = nunetd(&[
            "-q",
            "--model",
            &model,
            "--source",
            "demo",
            "--camera",
            &camera,
            "--stats-json",
            &stats,
        ]);
        let mut daemon = Guarded::start(under_env(&format!("--default-signal={name}"), &command));
        drop(await_frame(&camera));
        signal(daemon.pid(), name);
        assert_eq!(daemon.wait(), Some(0), "SIG{name}");
        let stats: serde_json::Value =
            serde_json::from_slice(&std::fs::read(bench.path("stats.json")).unwrap()).unwrap();
        assert_eq!(stats["frames"]["in_flight"], 0);
        assert!(stats["frames"]["published"].as_u64().unwrap() > 0);
    }
}

#[test]
fn a_program_of_a_source_ends_with_a_daemon_that_is_killed() {
    let bench = Bench::new();
    let (model, file, name) = (bench.arg("model.onnx"), bench.arg("pid"), camera("orphan"));
    // The pause is for its guard, which is started after it.
    let source = format!("exec:sleep 0.5; echo $$ > {file}; exec sleep 1000");
    let mut command = nunetd(&["-q", "--model", &model, "--source", &source, "--camera", &name]);
    command.stderr(Stdio::null());
    let mut daemon = Guarded::start(command);
    let pid: u32 = wait_for("the program", || std::fs::read_to_string(&file).ok()?.trim_end().parse().ok());
    let stat = format!("/proc/{pid}/stat");
    let is_alive = || std::fs::read_to_string(&stat).is_ok_and(|stat| !stat.contains(") Z "));
    assert!(is_alive());
    signal(daemon.pid(), "KILL");
    assert_eq!(daemon.wait(), None);
    wait_for("the end of the program", || (!is_alive()).then_some(()));
}

#[test]
fn a_daemon_started_with_nohup_survives_its_terminal() {
    let bench = Bench::new();
    let (model, name) = (bench.arg("model.onnx"), camera("nohup"));
    let command = nunetd(&["-q", "--model", &model, "--source", "demo", "--rate", "30", "--camera", &name]);
    let mut daemon = Guarded::start(under_env("--ignore-signal=HUP", &command));
    let reader = await_frame(&name);
    signal(daemon.pid(), "HUP");
    let newest = || reader.latest(Topic::Depth).unwrap().map(|frame| frame.header().sequence);
    let (mut first, start) = (None, Instant::now());
    while newest().is_none_or(|now| now < *first.get_or_insert(now) + 20) {
        assert!(start.elapsed() < TIMEOUT, "it does not go on");
        reader.wait(Duration::from_millis(50)).unwrap();
    }
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(0));
}

#[test]
fn a_stop_before_the_first_frame_is_noticed_while_it_waits_for_another_publisher() {
    let bench = Bench::new();
    let (model, name, record) = (bench.arg("model.onnx"), camera("early"), bench.arg("early.mcap"));
    let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: 64 };
    let other = CameraName::new(&camera("other")).unwrap();
    let _owner = Publisher::create(&other, &[plan], &Limits::default()).unwrap();
    // What an owner holds while it creates its services.
    let folder = std::fs::File::open(ipc_root()).unwrap();
    folder.lock().unwrap();
    let mut command =
        nunetd(&["--model", &model, "--source", "demo", "--camera", &name, "--record", &record]);
    command.stderr(std::fs::File::create(bench.path("log")).unwrap());
    let mut daemon = Guarded::start(command);
    let log = || std::fs::read_to_string(bench.path("log")).unwrap();
    wait_for("the self-test in the log", || log().contains("self-test").then_some(()));
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(0), "{}", log());
    drop(folder);
    assert!(log().contains("stopped before the first frame"), "{}", log());
    assert!(!bench.path("early.mcap").exists(), "{}", log());
}

#[test]
fn a_daemon_that_waits_for_its_camera_stops_too() {
    let bench = Bench::new();
    let (model, source, name) =
        (bench.arg("model.onnx"), format!("shm:{}", camera("nobody")), camera("waiting"));
    let mut daemon =
        Guarded::start(nunetd(&["-q", "--model", &model, "--source", &source, "--camera", &name]));
    let reader = Reader::open(&CameraName::new(&name).unwrap(), &[Topic::Depth], TIMEOUT);
    assert!(reader.is_ok(), "its own services are there while it waits");
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(0));
}

#[test]
fn a_signal_during_a_wait_loses_no_frame() {
    let bench = Bench::new();
    let (model, silent, name) = (bench.arg("model.onnx"), camera("silent"), camera("interrupted"));
    let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: 640 * 480 * 3 };
    let publisher =
        Publisher::create(&CameraName::new(&silent).unwrap(), &[plan], &Limits::default()).unwrap();
    let (source, stats) = (format!("shm:{silent}"), bench.arg("stats.json"));
    let mut daemon = Guarded::start(nunetd(&[
        "-q",
        "--model",
        &model,
        "--source",
        &source,
        "--camera",
        &name,
        "--stats-json",
        &stats,
    ]));
    Reader::open(&CameraName::new(&name).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    // It waits for a frame now, or will at once: both must end well.
    wait_for("the daemon among the readers", || publisher.has_readers(Topic::Rgb).then_some(()));
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(0));
    let stats: serde_json::Value =
        serde_json::from_slice(&std::fs::read(bench.path("stats.json")).unwrap()).unwrap();
    assert_eq!(stats["frames"]["captured"], 0);
}

#[test]
fn results_on_a_hanging_disk_delay_neither_a_stop_nor_the_stats() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("out")).unwrap();
    // Opening it for writing never returns, as on a dead network mount, because no process reads it.
    let pipe = Command::new("mkfifo").arg(bench.path("out/depth.npy")).status().unwrap();
    assert!(pipe.success());
    let (model, out, stats, name) =
        (bench.arg("model.onnx"), bench.arg("out"), bench.arg("stats.json"), camera("unwritten"));
    let mut command =
        nunetd(&["-q", "--model", &model, "--source", "demo", "--rate", "30", "--camera", &name]);
    command.args(["--out", &out, "--stats-json", &stats]);
    command.stderr(std::fs::File::create(bench.path("log")).unwrap());
    let mut daemon = Guarded::start(command);
    drop(await_frame(&name));
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(1));
    let log = std::fs::read_to_string(bench.path("log")).unwrap();
    assert!(log.contains(&format!("`{out}`: ")) && log.contains("5 s"), "{log}");
    assert!(log.contains("\nhint: "), "{log}");
    let stats: serde_json::Value =
        serde_json::from_slice(&std::fs::read(bench.path("stats.json")).unwrap()).unwrap();
    assert_eq!(stats["frames"]["in_flight"], 0);
}

#[test]
fn a_stop_of_infer_leaves_complete_folders_and_logs_what_is_missing() {
    let bench = Bench::new();
    bench.add_image("images/0.png", 0);
    for number in 1..400 {
        std::fs::copy(bench.path("images/0.png"), bench.path(&format!("images/{number}.png"))).unwrap();
    }
    let (model, images, out) = (bench.arg("model.onnx"), bench.arg("images"), bench.arg("out"));
    let mut command = nunetd(&["-q", "infer", &images, "--out", &out, "--model", &model]);
    command.stderr(std::fs::File::create(bench.path("log")).unwrap());
    let mut infer = Guarded::start(command);
    wait_for("the second result", || bench.path("out/1").is_dir().then_some(()));
    signal(infer.pid(), "INT");
    assert_eq!(infer.wait(), Some(3));
    let log = std::fs::read_to_string(bench.path("log")).unwrap();
    assert!(log.contains(" of 400 images"), "{log}");
    let files = |folder: std::fs::DirEntry| std::fs::read_dir(folder.path()).unwrap().count();
    let folders = std::fs::read_dir(&out).unwrap().map(|folder| files(folder.unwrap()));
    assert!(folders.inspect(|files| assert_eq!(*files, 6)).count() >= 1);
}

#[test]
fn two_signals_within_a_second_count_as_one() {
    let bench = Bench::new();
    let name = camera("twice_interrupted");
    let mut daemon = demo_daemon(&bench, &name);
    drop(await_frame(&name));
    // All are pending when the process goes on.
    for name in ["STOP", "INT", "TERM", "CONT"] {
        signal(daemon.pid(), name);
    }
    assert_eq!(daemon.wait(), Some(0));
}

#[test]
fn a_second_signal_after_a_second_ends_the_process_at_once_with_exit_code_130() {
    let bench = Bench::new();
    let name = camera("interrupted_again");
    // Files that are never written: the stop takes until the drain timeout.
    std::fs::create_dir(bench.path("out")).unwrap();
    assert!(Command::new("mkfifo").arg(bench.path("out/depth.npy")).status().unwrap().success());
    let (model, out) = (bench.arg("model.onnx"), bench.arg("out"));
    let mut command = nunetd(&["--model", &model, "--source", "demo", "--camera", &name, "--out", &out]);
    command.stderr(std::fs::File::create(bench.path("log")).unwrap());
    let mut daemon = Guarded::start(command);
    drop(await_frame(&name));
    signal(daemon.pid(), "TERM");
    let log = || std::fs::read_to_string(bench.path("log")).unwrap();
    wait_for("the stop in the log", || log().contains("stopping").then_some(()));
    std::thread::sleep(Duration::from_millis(1100)); // what counts as a second request is a matter of time
    signal(daemon.pid(), "INT");
    assert_eq!(daemon.wait(), Some(130), "{}", log());
}

#[test]
fn a_killed_daemon_does_not_block_the_next_one() {
    let bench = Bench::new();
    let name = camera("killed");
    for _ in 0..5 {
        let mut daemon = demo_daemon(&bench, &name);
        drop(await_frame(&name));
        signal(daemon.pid(), "KILL");
        assert_eq!(daemon.wait(), None);
    }
    let mut daemon = demo_daemon(&bench, &name);
    drop(await_frame(&name));
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(0));
    let output = run(nunetd(&["watch", &name, "--json", "--timeout", "0.2"]));
    assert_eq!(output.status.code(), Some(1), "nothing is left of the camera");
    assert!(text(&output.stderr).contains("error: "), "{}", text(&output.stderr));
}

#[test]
fn readers_stay_when_the_daemon_dies_and_get_the_frames_of_the_next_one() {
    let bench = Bench::new();
    let name = camera("reborn");
    let mut first = demo_daemon(&bench, &name);
    let reader = await_frame(&name);
    signal(first.pid(), "KILL");
    first.wait();
    while reader.latest(Topic::Depth).unwrap().is_some() {}
    let _second = demo_daemon(&bench, &name);
    let start = Instant::now();
    while reader.latest(Topic::Depth).unwrap().is_none() {
        assert!(start.elapsed() < TIMEOUT, "the reader of a killed daemon never saw the next one");
        reader.wait(Duration::from_millis(50)).unwrap();
    }
}

#[test]
fn a_second_daemon_of_the_same_camera_is_refused_and_the_first_continues() {
    let bench = Bench::new();
    let name = camera("twice");
    let first = demo_daemon(&bench, &name);
    let reader = await_frame(&name);
    let model = bench.arg("model.onnx");
    let second = run(nunetd(&["-q", "--model", &model, "--source", "demo", "--camera", &name]));
    assert_eq!(second.status.code(), Some(1));
    let (stderr, owner) = (text(&second.stderr), format!("process {}", first.pid()));
    assert!(stderr.contains(&format!("`{name}`")) && stderr.contains(&owner), "{stderr}");
    // Frames from before the second daemon do not count.
    while reader.latest(Topic::Depth).unwrap().is_some() {}
    wait_for("a new frame of the first daemon", || {
        reader.wait(Duration::from_millis(50)).unwrap();
        reader.latest(Topic::Depth).unwrap()
    });
}

const CLOUD_OF: &str = "NUNET_TEST_READS_THE_CLOUD_OF";

/// Not a test: another process that reads a cloud until it is killed.
#[test]
fn peer_that_reads_the_cloud() {
    let Ok(name) = std::env::var(CLOUD_OF) else { return };
    ipc_root();
    let reader = Reader::open(&CameraName::new(&name).unwrap(), &[Topic::Cloud], TIMEOUT).unwrap();
    let start = Instant::now();
    while start.elapsed() < TIMEOUT {
        reader.wait(Duration::from_millis(50)).unwrap();
        drop(reader.latest(Topic::Cloud).unwrap());
    }
}

#[test]
fn the_cloud_is_computed_while_it_is_read_and_no_longer_when_its_reader_was_killed() {
    let bench = Bench::new();
    let name = camera("cloudy");
    let _daemon = demo_daemon(&bench, &name);
    let reader = await_frame(&name);
    let mut peer = Command::new(std::env::current_exe().unwrap());
    peer.args(["--exact", "processes::peer_that_reads_the_cloud"]).env(CLOUD_OF, &name).stdout(Stdio::null());
    let mut peer = Guarded::start(peer);
    await_cloud(&reader, true);
    signal(peer.pid(), "KILL");
    peer.wait();
    await_cloud(&reader, false);
}

/// Waits for a frame that was made with or without a cloud: its time is the last of the header's stages.
fn await_cloud(reader: &Reader, computed: bool) {
    let start = Instant::now();
    while start.elapsed() < TIMEOUT {
        reader.wait(Duration::from_millis(50)).unwrap();
        let frame = reader.latest(Topic::Depth).unwrap();
        let cloud_micros = frame.as_ref().and_then(|frame| frame.header().stages().last().copied());
        if cloud_micros.is_some_and(|micros| (micros > 0) == computed) {
            return;
        }
    }
    panic!("no frame with computed = {computed} within {TIMEOUT:?}")
}

#[test]
fn readers_that_hold_frames_or_sleep_do_not_slow_the_daemon() {
    let bench = Bench::new();
    let name = camera("held");
    let _daemon = demo_daemon(&bench, &name);
    let reader = await_frame(&name);
    let _sleeper =
        Reader::open(&CameraName::new(&name).unwrap(), &[Topic::Depth, Topic::Cloud], TIMEOUT).unwrap();
    let mut held = Vec::new();
    let start = Instant::now();
    while held.len() < 2 && start.elapsed() < TIMEOUT {
        reader.wait(Duration::from_millis(50)).unwrap();
        held.extend(reader.latest(Topic::Depth).unwrap());
    }
    assert_eq!(held.len(), 2);
    let before: Vec<Vec<f32>> = held.iter().map(|frame| frame.depth().unwrap().to_vec()).collect();
    let seen = run(nunetd(&["watch", &name, "--json", "--frames", "30"]));
    assert_eq!(seen.status.code(), Some(0), "{}", text(&seen.stderr));
    let is_unchanged = held.iter().zip(&before).all(|(frame, before)| frame.depth().unwrap() == before);
    assert!(is_unchanged, "a held frame was overwritten");
}
