//! The password of a network camera: only in the arguments of ffmpeg.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Stdio;

use crate::support::{Bench, Guarded, camera, nunetd, run, text, wait_for};

const URL: &str = "rtsp://admin:s3cret@127.0.0.1/front";

/// The same with characters that a URL would have to escape, in the address's parameters, and in a command.
const OTHERS: [&str; 5] = [
    "rtsp://admin:12#s3cret@127.0.0.1/front",
    "rtsp://admin:s3cret it@127.0.0.1/front",
    "rtsp://127.0.0.1/front?user=admin&password=s3cret",
    "rtsp://127.0.0.1/user=admin_password=s3cret_channel=1.sdp",
    "exec:ffmpeg -u admin:s3cret http://127.0.0.1/front",
];

/// Stands for ffmpeg: repeats its arguments on standard error, as ffmpeg does in errors, and sends images.
const FFMPEG: &str = "#!/bin/sh
echo \"cannot open $@\" >&2
printf 'YUV4MPEG2 W4 H2 F25:1 Cmono\\n'
for i in 1 2 3 4 5; do printf 'FRAME\\n12345678'; sleep 0.05; done
exit 1
";

fn metrics(port: u16) -> Option<String> {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
    stream.write_all(b"GET /metrics HTTP/1.0\r\n\r\n").ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    answer.contains("nunet_").then_some(answer)
}

#[test]
fn the_password_of_a_network_camera_is_in_no_log_and_in_no_output() {
    let bench = Bench::new();
    std::fs::write(bench.path("ffmpeg"), FFMPEG).unwrap();
    std::fs::set_permissions(bench.path("ffmpeg"), std::fs::Permissions::from_mode(0o755)).unwrap();
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let (model, recording, stats) = (bench.arg("model.onnx"), bench.arg("a.mcap"), bench.arg("stats.json"));
    let (name, address) = (camera("password"), format!("127.0.0.1:{port}"));
    let mut command = nunetd(&["-vv", "--source", URL, "--camera", &name, "--model", &model]);
    command.args(["--record", &recording, "--stats-json", &stats, "--metrics", &address]);
    let path = std::env::var("PATH").unwrap_or_default();
    command.env("PATH", format!("{}:{path}", bench.arg("")));
    let (log, printed) = (bench.path("log"), bench.path("printed"));
    command.stderr(File::create(&log).unwrap()).stdout(File::create(&printed).unwrap());
    let mut daemon = Guarded::start(command);
    let read = |path: &Path| text(&std::fs::read(path).unwrap_or_default());
    let metrics = wait_for("the metrics", || metrics(port));
    // It is logged with what the program said last.
    wait_for("the end of the program", || read(&log).contains("exit code 1").then_some(()));
    assert_eq!(daemon.stop(), Some(0));
    let shown = read(&log);
    assert!(shown.contains("rtsp://***@127.0.0.1/front") && shown.contains("cannot open"), "{shown}");
    let [recording, stats] = [&recording, &stats].map(|path| read(Path::new(path)));
    assert!(recording.len() > 1000 && stats.len() > 100);
    let outputs = [shown, metrics, read(&printed), recording, stats];
    for (what, content) in ["log", "metrics", "stdout", "recording", "stats"].iter().zip(&outputs) {
        assert!(!content.contains("s3cret") && !content.contains("admin"), "{what}: {content}");
    }
}

#[test]
fn a_password_of_any_form_is_neither_logged_nor_printed_as_configuration() {
    let bench = Bench::new();
    std::fs::write(bench.path("ffmpeg"), FFMPEG).unwrap();
    std::fs::set_permissions(bench.path("ffmpeg"), std::fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", bench.arg(""), std::env::var("PATH").unwrap_or_default());
    let model = bench.arg("model.onnx");
    for source in OTHERS {
        let name = camera("form");
        let mut config = nunetd(&["config", "--source", source, "--camera", &name, "--model", &model]);
        config.env("PATH", &path);
        let output = run(config);
        let printed = text(&output.stdout);
        assert!(printed.contains("***") && printed.contains("# without its password"), "{printed}");
        let mut command = nunetd(&["-vv", "--source", source, "--camera", &name, "--model", &model]);
        let log = bench.path("log");
        command.env("PATH", &path).stdout(Stdio::null()).stderr(File::create(&log).unwrap());
        let mut daemon = Guarded::start(command);
        let read = || text(&std::fs::read(&log).unwrap_or_default());
        wait_for("the end of the program", || read().contains("exit code 1").then_some(()));
        assert_eq!(daemon.stop(), Some(0));
        let shown = read();
        assert!(shown.contains("cannot open"), "{shown}");
        for content in [shown, printed, text(&output.stderr)] {
            assert!(!content.contains("s3cret"), "{source}: {content}");
        }
    }
}

#[test]
fn a_source_in_the_wrong_place_is_named_without_its_password() {
    for arguments in [&[URL][..], &["--source", "demo", URL], &["config", URL]] {
        let output = run(nunetd(arguments));
        let shown = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{shown}");
        assert!(shown.contains("rtsp://***@127.0.0.1/front") && !shown.contains("s3cret"), "{shown}");
    }
}
