//! Module order: no module imports one that comes after it.

use crate::assert_none;
use crate::repository;
use crate::rust_source::{is_test_file, paths, without_tests};

/// A crate whose modules have an order.
struct Order {
    /// Its sources.
    folder: &'static str,
    /// The modules in reading order. One may import those before it, never one after it.
    modules: &'static [&'static str],
    /// Exceptions: importer, imported, reason.
    ahead: &'static [(&'static str, &'static str, &'static str)],
}

const CORE: Order = Order {
    folder: "crates/nunet-core/src/",
    modules: &[
        "clock",
        "text",
        "plain_file",
        "error_kind",
        "frame",
        "camera",
        "framing",
        "preprocess",
        "model",
        "graph",
        "depth",
        "filter",
        "cloud",
        "label_roles",
        "obstacle",
        "scale",
        "stability",
        "pipeline",
        "hints",
    ],
    ahead: &[(
        "model",
        "depth",
        "a model's description says encoding and range of its depth; these types live with the code that decodes them",
    )],
};

const DAEMON: Order = Order {
    folder: "crates/nunet-daemon/src/",
    modules: &[
        "version",
        "exit",
        "config",
        "logging",
        "sink",
        "stream",
        "subcommands",
        // Last: the command line makes the configuration that all others take, and only the crate's root
        // calls it.
        "cli",
    ],
    ahead: &[],
};

const ENGINE: Order = Order {
    folder: "crates/nunet-engine/src/",
    modules: &[
        "buffers",
        "text",
        "telemetry",
        "clock",
        "pool",
        "error_kind",
        "error",
        "options",
        "installation",
        "library",
        "models",
        "verdict",
        "model_check",
        "huge_pages",
        "engine",
        "checked_load",
        "model_report",
        "model",
    ],
    ahead: &[],
};

const PYTHON: Order = Order {
    folder: "crates/nunet-py/src/",
    modules: &[
        "error",
        "argument",
        "array",
        "fork_guard",
        "memory",
        "image",
        "camera",
        "cloud",
        "obstacles",
        "colorize",
        "command",
        "installation",
        "image_replay",
        "result",
        "model",
        "replay",
        "stream",
    ],
    ahead: &[],
};

impl Order {
    /// The module that a file belongs to; `None` for the crate's root.
    fn module<'a>(&self, path: &'a str) -> Option<&'a str> {
        let name = path.strip_prefix(self.folder)?.split('/').next()?;
        let name = name.strip_suffix(".rs").unwrap_or(name);
        (!["lib", "main"].contains(&name)).then_some(name)
    }

    /// A path as seen from the crate's root, if it is one of this crate.
    fn seen_from_root(&self, file: &str, segments: &[String]) -> Option<Vec<String>> {
        match segments.first()?.as_str() {
            "crate" => Some(segments[1..].to_vec()),
            "super" => {
                let inner = file.strip_prefix(self.folder)?.trim_end_matches(".rs").trim_end_matches("/mod");
                let mut place: Vec<String> = inner.split('/').map(str::to_owned).collect();
                let ups = segments.iter().take_while(|segment| *segment == "super").count();
                place.truncate(place.len().checked_sub(ups)?);
                place.extend_from_slice(&segments[ups..]);
                Some(place)
            }
            _ => None,
        }
    }

    fn place(&self, module: &str) -> Option<usize> {
        self.modules.iter().position(|name| *name == module)
    }

    fn turning_back(&self, path: &str, text: &str) -> Vec<String> {
        let Some(own) = self.module(path) else {
            return Vec::new();
        };
        let Some(own_place) = self.place(own) else {
            return vec![format!("{path}: give module `{own}` its place in the order")];
        };
        let mut problems = Vec::new();
        for named in paths(&without_tests(text)) {
            let target = self.seen_from_root(path, &named.segments);
            let Some(target) = target.and_then(|target| target.into_iter().next()) else {
                continue;
            };
            let line = named.line;
            match self.place(&target) {
                Some(place) if place <= own_place => {}
                Some(_) if self.ahead.iter().any(|(from, to, _)| (*from, *to) == (own, target.as_str())) => {}
                Some(_) => {
                    problems.push(format!("{path}:{line}: `{own}` comes before `{target}`, not after it"));
                }
                None if self.is_at_the_root(&target) => {}
                None => problems.push(format!(
                    "{path}:{line}: name `{target}` by its module, so that order can be checked"
                )),
            }
        }
        problems
    }

    /// Names in the daemon's root that are not modules of it.
    fn is_at_the_root(&self, name: &str) -> bool {
        self.folder == DAEMON.folder && ["Outcome", "source"].contains(&name)
    }

    fn check(&self) {
        let mut sources = repository::rust();
        sources.retain(|(path, _)| path.starts_with(self.folder) && !is_test_file(path));
        assert!(!sources.is_empty(), "{} has no source", self.folder);
        let problems: Vec<String> =
            sources.iter().flat_map(|(path, text)| self.turning_back(path, text)).collect();
        assert_none(&problems);
    }
}

#[test]
fn in_core_no_module_imports_a_later_one() {
    CORE.check();
}

#[test]
fn in_the_engine_no_module_imports_a_later_one() {
    ENGINE.check();
}

#[test]
fn in_the_daemon_no_module_imports_a_later_one() {
    DAEMON.check();
}

#[test]
fn only_the_command_line_knows_clap() {
    let is_daemon = |path: &str| path.starts_with(DAEMON.folder) && DAEMON.module(path) != Some("cli");
    let sources = repository::rust().into_iter().filter(|(path, _)| is_daemon(path));
    let named = sources.flat_map(|(path, text)| {
        let clap = paths(&text).into_iter().filter(|named| named.segments[0] == "clap");
        clap.map(|named| format!("{path}:{}: take values from `config`, not clap", named.line))
            .collect::<Vec<_>>()
    });
    assert_none(&named.collect::<Vec<_>>());
}

#[test]
fn in_the_python_package_no_module_imports_a_later_one() {
    PYTHON.check();
}

#[test]
fn an_import_of_a_later_stage_is_found_however_it_is_written() {
    let frame = "crates/nunet-core/src/frame.rs";
    for text in [
        "use crate::graph::Wiring;",
        "use crate::{clock, cloud::CloudPoint};",
        "use super::pipeline::Pipeline;",
    ] {
        assert_eq!(CORE.turning_back(frame, text).len(), 1, "{text}");
    }
    let nested = "crates/nunet-core/src/depth/decode.rs";
    assert_eq!(CORE.turning_back(nested, "fn f(x: super::super::cloud::CloudPoint) {}").len(), 1);
    assert!(CORE.turning_back(nested, "use super::scale::Units;\nuse crate::frame::ImageView;").is_empty());
    assert!(
        CORE.turning_back(frame, "fn f() {}\n#[cfg(test)]\nmod tests { use crate::graph::X; }").is_empty()
    );
    let sink = "crates/nunet-daemon/src/sink/shm.rs";
    assert_eq!(DAEMON.turning_back(sink, "use crate::stream::Stop;").len(), 1);
    assert!(DAEMON.turning_back(sink, "use crate::config;").is_empty());
    let run = "crates/nunet-daemon/src/subcommands/run.rs";
    assert_eq!(DAEMON.turning_back(run, "use crate::cli::RunArgs;").len(), 1);
}

#[test]
fn a_module_without_a_place_and_a_path_around_the_order_are_found() {
    assert_eq!(CORE.turning_back("crates/nunet-core/src/planner/mod.rs", "").len(), 1);
    assert_eq!(CORE.turning_back("crates/nunet-core/src/frame.rs", "use crate::Pipeline;").len(), 1);
}
