//! nunet-core only computes: no threads, sockets, clocks or environment.

use crate::assert_none;
use crate::repository;
use crate::rust_source::{is_test_file, paths, without_tests};

/// The folder of the crate.
const CORE: &str = "crates/nunet-core/src/";

/// What the pipeline must not use, and why.
const IMPURE: [(&[&str], &str); 8] = [
    (&["std", "thread"], "threads belong to the daemon"),
    (&["std", "net"], "sockets belong to the daemon"),
    (&["std", "os", "unix", "net"], "sockets belong to the daemon"),
    (&["std", "time"], "time is an argument (`Clock`)"),
    (&["std", "env"], "the environment is read by the daemon"),
    (&["std", "process"], "processes belong to the daemon"),
    (&["clap"], "the command line belongs to the daemon"),
    (&["tracing"], "the daemon logs; core returns reports and errors"),
];

/// Starts no thread: it is the default for the number of ONNX Runtime's threads.
const ALLOWED: [&[&str]; 1] = [&["std", "thread", "available_parallelism"]];

fn impure(path: &str, text: &str) -> Vec<String> {
    let mut problems = Vec::new();
    for named in paths(&without_tests(text)) {
        let segments: Vec<&str> = named.segments.iter().map(String::as_str).collect();
        let impure = IMPURE.iter().find(|(prefix, _)| segments.starts_with(prefix));
        if let Some((_, why)) = impure.filter(|_| !ALLOWED.contains(&segments.as_slice())) {
            problems.push(format!("{path}:{}: `{}`: {why}", named.line, segments.join("::")));
        }
    }
    problems
}

fn core_sources() -> Vec<(String, String)> {
    let mut sources = repository::rust();
    sources.retain(|(path, _)| path.starts_with(CORE) && !is_test_file(path));
    assert!(!sources.is_empty(), "{CORE} has no source");
    sources
}

#[test]
fn core_has_no_threads_sockets_command_line_clock_or_environment() {
    let problems: Vec<String> = core_sources().iter().flat_map(|(path, text)| impure(path, text)).collect();
    assert_none(&problems);
}

#[test]
fn each_impurity_is_found() {
    for text in [
        "std::thread::spawn(f);",
        "use std::{fmt, net::TcpStream};",
        "use std::os::unix::net::UnixStream;",
        "let t = std::time::Instant::now();",
        "use std::env;",
        "std::process::exit(1);",
        "use clap::Parser;",
        "tracing::info!(x);",
    ] {
        assert_eq!(impure("crates/nunet-core/src/frame.rs", text).len(), 1, "{text}");
    }
    assert!(impure("x.rs", "std::thread::available_parallelism()").is_empty());
    assert!(impure("x.rs", "use std::fmt; // std::thread\nlet print_width = 1;").is_empty());
}
