//! What nunet-core promises: the journey runs one way, and nothing but computing happens on it.

use crate::assert_none;
use crate::repository;
use crate::rust_source::{is_test_file, paths, without_tests};

/// The folder of the crate.
const CORE: &str = "crates/nunet-core/src/";

/// The modules in the order of the journey. One may import those before it, never one after it.
const JOURNEY: [&str; 9] =
    ["clock", "frame", "camera", "preprocess", "model", "graph", "depth", "cloud", "pipeline"];

/// Who may look ahead all the same: importer, imported, reason.
const AHEAD: [(&str, &str, &str); 1] = [(
    "model",
    "depth",
    "a model's description says encoding and range of its depth; these types live with the code that decodes them",
)];

/// What a pure pipeline has no use for, and why.
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

/// Starts nothing and waits for nothing: a default for how many threads ONNX Runtime is to use.
const ALLOWED: [&[&str]; 1] = [&["std", "thread", "available_parallelism"]];

const PRINTING: [&str; 5] = ["println", "eprintln", "print", "eprint", "dbg"];

/// The module of the journey that a file belongs to; `None` for lib.rs.
fn module(path: &str) -> Option<&str> {
    let name = path.strip_prefix(CORE)?.split('/').next()?;
    let name = name.strip_suffix(".rs").unwrap_or(name);
    (name != "lib").then_some(name)
}

/// A path as seen from the crate's root, if it is one of this crate.
fn from_root(file: &str, segments: &[String]) -> Option<Vec<String>> {
    match segments.first()?.as_str() {
        "crate" => Some(segments[1..].to_vec()),
        "super" => {
            let inner = file.strip_prefix(CORE)?.trim_end_matches(".rs").trim_end_matches("/mod");
            let mut place: Vec<String> = inner.split('/').map(str::to_owned).collect();
            let ups = segments.iter().take_while(|segment| *segment == "super").count();
            place.truncate(place.len().checked_sub(ups)?);
            place.extend_from_slice(&segments[ups..]);
            Some(place)
        }
        _ => None,
    }
}

fn turning_back(path: &str, text: &str) -> Vec<String> {
    let Some(own) = module(path) else {
        return Vec::new();
    };
    let Some(own_place) = JOURNEY.iter().position(|name| *name == own) else {
        return vec![format!("{path}: give module `{own}` its place in JOURNEY")];
    };
    let mut problems = Vec::new();
    for named in paths(without_tests(text)) {
        let Some(target) = from_root(path, &named.segments).and_then(|target| target.into_iter().next())
        else {
            continue;
        };
        match JOURNEY.iter().position(|name| *name == target) {
            Some(place) if place <= own_place => {}
            Some(_) if AHEAD.iter().any(|(from, to, _)| (*from, *to) == (own, target.as_str())) => {}
            Some(_) => {
                problems
                    .push(format!("{path}:{}: `{own}` comes before `{target}`, not after it", named.line));
            }
            None => {
                let line = named.line;
                problems.push(format!(
                    "{path}:{line}: name `{target}` by its module, so that order can be checked"
                ));
            }
        }
    }
    problems
}

fn impure(path: &str, text: &str) -> Vec<String> {
    let mut problems = Vec::new();
    for named in paths(without_tests(text)) {
        let segments: Vec<&str> = named.segments.iter().map(String::as_str).collect();
        let impure = IMPURE.iter().find(|(prefix, _)| segments.starts_with(prefix));
        if let Some((_, why)) = impure.filter(|_| !ALLOWED.contains(&segments.as_slice())) {
            problems.push(format!("{path}:{}: `{}`: {why}", named.line, segments.join("::")));
        }
        if let [macro_name] = segments.as_slice()
            && PRINTING.contains(macro_name)
        {
            problems.push(format!("{path}:{}: `{macro_name}`: core prints nothing", named.line));
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
fn in_core_no_module_imports_a_later_one() {
    let problems: Vec<String> =
        core_sources().iter().flat_map(|(path, text)| turning_back(path, text)).collect();
    assert_none(&problems);
}

#[test]
fn an_import_of_a_later_stage_is_found_however_it_is_written() {
    let frame = "crates/nunet-core/src/frame.rs";
    for text in [
        "use crate::graph::Wiring;",
        "use crate::{clock, cloud::CloudPoint};",
        "use super::pipeline::Pipeline;",
    ] {
        assert_eq!(turning_back(frame, text).len(), 1, "{text}");
    }
    let nested = "crates/nunet-core/src/depth/decode.rs";
    assert_eq!(turning_back(nested, "fn f(x: super::super::cloud::CloudPoint) {}").len(), 1);
    assert!(turning_back(nested, "use super::scale::Units;\nuse crate::frame::ImageView;").is_empty());
    assert!(turning_back(frame, "fn f() {}\n#[cfg(test)]\nmod tests { use crate::graph::X; }").is_empty());
}

#[test]
fn a_module_without_a_place_and_a_path_around_the_order_are_found() {
    assert_eq!(turning_back("crates/nunet-core/src/obstacles/mod.rs", "").len(), 1);
    assert_eq!(turning_back("crates/nunet-core/src/frame.rs", "use crate::Pipeline;").len(), 1);
}

#[test]
fn core_has_no_threads_sockets_command_line_printing_clock_or_environment() {
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
        "println!(\"x\");",
        "dbg!(x);",
    ] {
        assert_eq!(impure("crates/nunet-core/src/frame.rs", text).len(), 1, "{text}");
    }
    assert!(impure("x.rs", "std::thread::available_parallelism()").is_empty());
    assert!(impure("x.rs", "use std::fmt; // std::thread\nlet print_width = 1;").is_empty());
}
