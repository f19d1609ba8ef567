use std::path::Path;

use nunet_types::{ImageSize, PixelFormat};

use super::*;
use crate::SourceName;

/// Bounds every loop: fills that wait take a tenth of a second.
const MAX_FILLS: usize = 600;

fn open(name: &str) -> Box<dyn Source> {
    let options = OpenOptions {
        size: Some(ImageSize::new(2, 2)),
        format: Some(PixelFormat::Mono8),
        ..OpenOptions::default()
    };
    SourceName::parse(name).open(options).unwrap()
}

/// A shell command that writes raw images of 2x2 gray pixels.
fn gray_images(command: &str) -> Running {
    let arguments = ["/bin/sh", "-c", command].map(str::to_owned);
    let options = OpenOptions {
        size: Some(ImageSize::new(2, 2)),
        format: Some(PixelFormat::Mono8),
        ..OpenOptions::default()
    };
    Running::start(&arguments, &options).unwrap()
}

fn ended(running: Running) -> Ended {
    running.end().wait(Duration::from_secs(60)).ok().expect("it ends")
}

/// The next fill that is more than nothing.
fn next(source: &mut dyn Source, frame: &mut Frame) -> Fill {
    let fills = (0..MAX_FILLS).map(|_| source.fill(frame));
    fills.into_iter().find(|fill| !matches!(fill, Fill::Nothing)).expect("nothing comes")
}

#[test]
fn a_network_camera_needs_a_host_and_a_port_that_can_exist() {
    let check = |name: &str| SourceName::parse(name).check(&OpenOptions::default());
    for name in [
        "rtsp://10.0.0.4",
        "rtsp://camera.local/front",
        "rtsps://10.0.0.4:8554/front?channel=1",
        "rtsp://[fe80::1]/front",
        "rtsp://[fe80::1]:554/front",
        "rtsp://admin:s3cret@10.0.0.4:554/front",
        "rtsp://admin:a/b#c?d@10.0.0.4/front",
        "rtsp://10.0.0.4/user@home/front",
    ] {
        check(name).unwrap();
    }
    for name in [
        "rtsp://",
        "rtsp:///front",
        "rtsp://:554/front",
        "rtsp://10.0.0.4:0/front",
        "rtsp://10.0.0.4:99999/front",
        "rtsp://10.0.0.4:front/front",
        "rtsp://no such host/front",
        "rtsp://[zz]/front",
        "rtsp://admin:s3cret@/front",
    ] {
        let error = check(name).unwrap_err();
        assert_eq!(error.kind(), SourceErrorKind::Argument, "{name}");
        assert!(!error.to_string().contains("s3cret"), "{error}");
    }
}

#[test]
fn images_of_a_command_arrive_and_it_is_started_again() {
    let mut source = open("exec:printf aaaabbbb");
    let mut frame = Frame::default();
    assert!(source.is_live() && source.is_waiting());
    for (sequence, segment, gray) in [(0, 1, b'a'), (1, 1, b'b'), (2, 2, b'a'), (3, 2, b'b')] {
        let fill = next(source.as_mut(), &mut frame);
        assert!(matches!(fill, Fill::Frame), "{fill:?}");
        assert_eq!((frame.sequence, frame.segment), (sequence, segment));
        assert_eq!(frame.view().unwrap().bytes(), [gray; 4]);
        assert_eq!(frame.capture.clock, Clock::Monotonic);
        assert!(!source.is_waiting());
    }
}

#[test]
fn a_command_that_does_not_exist_is_an_error_that_names_it() {
    let mut source = open("exec:/nonexistent/program --fast");
    let Fill::Broken(error) = next(source.as_mut(), &mut Frame::default()) else { panic!("it is broken") };
    assert_eq!(error.kind(), SourceErrorKind::Unavailable);
    // The rest is what the shell says.
    let text = error.to_string();
    let (what, _) = text.split_once("`: ").unwrap_or_else(|| panic!("{text}"));
    insta::assert_snapshot!(what, @"cannot run command `/nonexistent/program --fast");
    assert!(matches!(source.fill(&mut Frame::default()), Fill::End));
    let missing = Running::start(&["/nonexistent/program".into()], &OpenOptions::default()).err().unwrap();
    assert_eq!(missing.kind(), SourceErrorKind::Unavailable);
    insta::assert_snapshot!(missing, @"cannot start `/nonexistent/program`");
}

#[test]
fn a_command_without_text_is_refused() {
    let error = SourceName::parse("exec: ").open(OpenOptions::default()).err().unwrap();
    assert_eq!(error.kind(), SourceErrorKind::Argument);
}

#[test]
fn output_that_is_no_image_is_an_error() {
    let mut source = SourceName::parse("exec:echo hello; sleep 5").open(OpenOptions::default()).unwrap();
    let Fill::Broken(error) = next(source.as_mut(), &mut Frame::default()) else { panic!("it is broken") };
    assert_eq!(error.kind(), SourceErrorKind::Unavailable);
    insta::assert_snapshot!(
        format!("{error:#}"),
        @"cannot read command `echo hello; sleep 5`: the program's output is not Y4M: it does not begin with `YUV4MPEG2`"
    );
}

/// The program fails too, because its output is closed: that is not the reason.
#[test]
fn output_that_is_no_image_any_more_is_the_reason_and_not_how_the_program_ends() {
    let header = "printf 'YUV4MPEG2 W2 H1 F25:1 Cmono\\n'";
    let name = format!("exec:{header}; while echo no image; do :; done");
    let mut source = SourceName::parse(&name).open(OpenOptions::default()).unwrap();
    let Fill::Broken(error) = next(source.as_mut(), &mut Frame::default()) else { panic!("it is broken") };
    assert_eq!(error.kind(), SourceErrorKind::Unavailable);
    insta::assert_snapshot!(
        std::error::Error::source(&error).unwrap().to_string(),
        @"image 1 of the program's output cannot be read: it does not begin with a line `FRAME`"
    );
}

/// A network camera may be switched on later.
#[test]
fn a_command_that_fails_is_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let camera = folder.path().join("camera");
    let mut source = open(&format!("exec:echo no camera >&2; cat {}", camera.display()));
    let mut frame = Frame::default();
    for _ in 0..10 {
        assert!(matches!(source.fill(&mut frame), Fill::Nothing) && source.is_waiting());
    }
    std::fs::write(camera, b"cccc").unwrap();
    assert!(matches!(next(source.as_mut(), &mut frame), Fill::Frame));
    assert!(!source.is_waiting());
}

#[test]
fn the_reason_of_an_end_is_the_exit_code_and_the_last_line() {
    let reason = |command: &str| {
        let arguments = ["/bin/sh", "-c", command].map(str::to_owned);
        let mut running = Running::start(&arguments, &OpenOptions::default()).unwrap();
        let over = (0..MAX_FILLS).map(|_| running.images.fill(&mut Frame::default()));
        assert!(over.into_iter().any(|fill| matches!(fill, Fill::Broken(_))));
        ended(running).reason()
    };
    assert_eq!(
        reason("echo one >&2; echo 'no such camera' >&2; exit 3"),
        "it ended with exit code 3: no such camera"
    );
    assert_eq!(reason("printf 'frame=1\\rframe=2\\r\\n' >&2"), "it ended with exit code 0: frame=2");
    assert_eq!(reason("kill -9 $$"), "signal 9 ended it");
}

/// Raw output of another size would otherwise look as if nothing were wrong with it.
#[test]
fn output_that_is_too_short_is_part_of_the_reason() {
    let reason_of = |command: &str| {
        let mut running = gray_images(command);
        let fills = (0..MAX_FILLS).map(|_| running.images.fill(&mut Frame::default()));
        let end = fills.into_iter().find_map(|fill| match fill {
            Fill::Cut(error) | Fill::Broken(error) => Some(error),
            _ => None,
        });
        reason(end.as_ref(), &ended(running))
    };
    let short = "the program's output ended after 3 of an image's 4 bytes";
    assert_eq!(reason_of("printf aaa"), format!("it ended with exit code 0; {short}"));
    assert_eq!(reason_of("printf aaaabbb; exit 3"), format!("it ended with exit code 3; {short}"));
    let none = "the program's output ended before its first image";
    assert_eq!(reason_of("echo hello >&2"), format!("it ended with exit code 0: hello; {none}"));
}

#[test]
fn y4m_that_is_declared_as_raw_images_is_an_error() {
    let mut source = open("exec:printf 'YUV4MPEG2 W2 H1 F25:1 Cmono\\nFRAME\\n12'; sleep 1000");
    let fill = next(source.as_mut(), &mut Frame::default());
    assert!(matches!(fill, Fill::Broken(_)), "{fill:?}");
}

#[test]
fn a_password_is_in_no_error_of_any_kind_of_source() {
    let password = "s3cret";
    for name in [
        "rtsp:/admin:12#s3cret@10.0.0.4/a",
        "http://admin:s3cret@10.0.0.4/a",
        "http://10.0.0.4/a?pwd=s3cret",
        "shm:admin:s3cret@10.0.0.4",
        "ros2:admin:s3cret@10.0.0.4",
        "/nonexistent/admin:s3cret@10.0.0.4.mcap",
    ] {
        let name = SourceName::parse(name);
        let error = name.open(OpenOptions::default()).err().unwrap();
        let hint = nunet_types::Hint::hint(&error).unwrap_or_default();
        let shown = format!("{name:?} {} {error:#} {hint}", name.shown());
        assert!(!shown.contains(password), "{shown}");
    }
}

fn is_alive(pid: &str) -> bool {
    let stat = std::fs::read_to_string(Path::new("/proc").join(pid).join("stat")).unwrap_or_default();
    !stat.is_empty() && !stat.contains(") Z ")
}

/// Runs a command that writes an image after `{show}`, which states the processes `$$ $!`. Both end with the
/// source.
#[track_caller]
fn assert_all_end(command: &str) {
    let folder = tempfile::tempdir().unwrap();
    let pids = folder.path().join("pids");
    let show = format!("echo $$ $! > {0}.new && mv {0}.new {0}", pids.display());
    let mut source = open(&format!("exec:{}", command.replace("{show}", &show)));
    assert!(matches!(next(source.as_mut(), &mut Frame::default()), Fill::Frame));
    let pids = std::fs::read_to_string(pids).unwrap();
    let pids: Vec<&str> = pids.split_whitespace().collect();
    assert!(pids.len() == 2 && pids.iter().all(|pid| is_alive(pid)), "{pids:?}");
    drop(source);
    let gone = || pids.iter().all(|pid| !is_alive(pid));
    assert!(
        (0..MAX_FILLS).any(|_| gone() || {
            std::thread::sleep(POLL_TIMEOUT / 10);
            false
        }),
        "{pids:?}"
    );
}

#[test]
fn what_was_started_ends_with_the_source_even_if_it_ignores_signals() {
    assert_all_end("trap '' TERM; sleep 1000 & {show}; printf aaaa; while true; do sleep 1000; done");
}

#[test]
fn what_ignores_signals_is_killed_although_the_shell_that_started_it_ends_at_once() {
    assert_all_end("trap '' TERM; sleep 1000 & trap - TERM; {show}; printf aaaa; exec sleep 1000");
}

/// `setsid` takes a process out of the group of the shell.
#[test]
fn what_left_the_group_is_killed_too() {
    let folder = tempfile::tempdir().unwrap();
    let ready = folder.path().join("ready");
    let ready = ready.display();
    let apart = format!("setsid sh -c 'trap \"\" TERM; : > {ready}; exec sleep 1000' &");
    let wait = format!("until [ -e {ready} ]; do sleep 0.01; done");
    assert_all_end(&format!("{apart} {wait}; {{show}}; printf aaaa; while true; do sleep 1000; done"));
}

#[test]
fn addresses_and_times_in_a_message_are_no_other_reason() {
    let ended = "it ended with exit code 1: ";
    let refused = |address: &str| format!("{ended}[tcp @ {address}] Connection to tcp://camera:554 failed");
    assert_eq!(without_numbers(&refused("0x55d0c1a2f3c0")), without_numbers(&refused("0x7f3e2c000b80")));
    assert_ne!(without_numbers(&refused("0x55d0c1a2f3c0")), without_numbers(&format!("{ended}Not found")));
    assert_eq!(without_numbers("12:00:01 frame=   99 lost"), without_numbers("12:00:02 frame=  100 lost"));
}

/// It would hold up the capture thread.
#[test]
fn the_end_of_a_program_that_ignores_signals_is_not_waited_for_at_once() {
    let command = "trap '' TERM; echo ready >&2; printf aaaa; while true; do sleep 1000; done";
    let mut running = gray_images(command);
    let mut fills = (0..MAX_FILLS).map(|_| running.images.fill(&mut Frame::default()));
    assert!(fills.any(|fill| matches!(fill, Fill::Frame)));
    let Err(ending) = running.end().wait(Duration::ZERO) else { panic!("it was waited for") };
    let Ok(ended) = ending.wait(Duration::from_secs(60)) else { panic!("it still runs") };
    assert_eq!(ended.reason(), "it closed its output: ready");
}

#[test]
fn a_password_is_neither_in_the_name_nor_in_what_a_program_said() {
    let command = "echo cannot open rtsp://admin:s3cret@10.0.0.4/a >&2; exit 127";
    let mut source = open(&format!("exec:{command}"));
    let Fill::Broken(error) = next(source.as_mut(), &mut Frame::default()) else { panic!("it is broken") };
    let text = format!("{error:#}");
    assert!(!text.contains("s3cret") && text.matches("rtsp://***@10.0.0.4/a").count() == 2, "{text}");
    let name = SourceName::parse("rtsp://admin:s3cret@10.0.0.4/a");
    let topic = OpenOptions { topic: Some("/a"), ..OpenOptions::default() };
    let error = name.check(&topic).unwrap_err();
    assert!(!format!("{name:?} {error:#}").contains("s3cret"), "{name:?} {error:#}");
}
