//! Where libraries may be used: one folder uses ONNX Runtime, one crate iceoryx2, one the MCAP libraries, and
//! the Python package uses the daemon's crate for the command `nunetd` only.

use std::collections::BTreeSet;

use crate::assert_none;
use crate::crates::{differences, locked, short, text};
use crate::repository;
use crate::rust_source::paths;

/// A crate's name in code, and the only folders whose files may use it.
const HOMES: [(&str, &[&str]); 8] = [
    ("ort", &["crates/nunet-core/src/graph/onnx"]),
    ("iceoryx2", &["crates/nunet-ipc/"]),
    ("mcap", &["crates/nunet-mcap/"]),
    ("foxglove", &["crates/nunet-mcap/", "crates/nunet-foxglove/"]),
    ("dust_dds", &["crates/nunet-ros2-link/src/dds/"]),
    ("zenoh", &["crates/nunet-ros2-link/src/zenoh/"]),
    ("zenoh_ext", &["crates/nunet-ros2-link/src/zenoh/"]),
    (
        "nunet_daemon",
        &[
            "crates/nunet-daemon/",
            "crates/nunet-py/src/command.rs",
            "examples/manual.rs",
            "fuzz/src/daemon.rs",
        ],
    ),
];

/// A library, and the only crates that depend on it, their tests included. Their names are without `nunet-`.
const LIBRARIES: [(&str, &str); 16] = [
    ("anyhow", "daemon py ros2 sink xtask"),
    ("axum", "view"),
    ("clap", "daemon"),
    ("dust_dds", "ros2-link"),
    ("foxglove", "foxglove mcap"),
    ("iceoryx2", "ipc"),
    ("mavlink", "mavlink"),
    ("mcap", "mcap"),
    ("ort", "core"),
    ("pyo3", "py"),
    ("rustix", "daemon engine files foxglove ipc mavlink source"),
    ("serde", "core daemon engine eval files mcap ros2 ros2-link source telemetry view xtask"),
    ("serde_json", "core daemon engine eval files foxglove mcap sink source telemetry view xtask"),
    ("tracing", "daemon engine foxglove ros2 ros2-link sink source telemetry view"),
    ("zenoh", "ros2-link"),
    ("zenoh-ext", "ros2-link"),
];

fn forbidden_paths(path: &str, text: &str) -> Vec<String> {
    let mut problems = Vec::new();
    for (name, homes) in HOMES {
        if homes.iter().any(|home| path.starts_with(home)) {
            continue;
        }
        // A lone word may be a variable; a path or a `use` that begins with it is the crate.
        let named =
            paths(text).into_iter().filter(|named| named.segments.len() > 1 && named.segments[0] == name);
        problems.extend(
            named.map(|named| format!("{path}:{}: only {} names `{name}`", named.line, homes.join(" and "))),
        );
    }
    problems
}

#[test]
fn each_restricted_crate_is_used_in_one_place() {
    let problems: Vec<String> =
        repository::rust().iter().flat_map(|(path, text)| forbidden_paths(path, text)).collect();
    assert_none(&problems);
}

#[test]
fn a_use_of_ort_elsewhere_is_found() {
    let text = "use ort::Session;\nfn f() { ort::init() }\n// ort::init\nlet s = \"ort::init\"; let ort = 1;";
    let found = forbidden_paths("crates/nunet-core/src/pipeline.rs", text);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(forbidden_paths("crates/nunet-core/src/graph/onnx/session.rs", text).is_empty());
}

#[test]
fn in_the_python_package_only_the_command_uses_the_daemon() {
    let text = "use nunet_daemon::{embed, source::Rotation};\nfn f() { nunet_daemon::exit_code([]) }";
    let found = forbidden_paths("crates/nunet-py/src/image.rs", text);
    assert_eq!(found.len(), 3, "{found:?}");
    assert!(forbidden_paths("crates/nunet-py/src/command.rs", text).is_empty());
}

#[test]
fn each_restricted_library_is_a_dependency_of_the_listed_crates_alone() {
    let lock = text("Cargo.lock");
    let locked = locked(&lock);
    let problems = LIBRARIES.iter().flat_map(|(library, listed)| {
        let users = locked.iter().filter(|(_, uses)| uses.contains(library)).map(|(name, _)| short(name));
        let what = format!("crates that use `{library}`");
        differences(&what, &users.collect(), &listed.split_whitespace().collect())
    });
    assert_none(&problems.collect::<Vec<_>>());
    assert_eq!(locked["nunet-types"], BTreeSet::from(["bytemuck"]));
}
