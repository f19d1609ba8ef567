//! Allowed dependencies: one folder uses ONNX Runtime, one crate iceoryx2, one the MCAP libraries, nunet-ipc
//! is a leaf, and the Python package uses the daemon's crate for the command `nunetd` only.

use crate::assert_none;
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

/// A crate's manifest, and what it must not depend on.
const NO_DEPENDENCY: [(&str, &[&str]); 18] = [
    (
        "crates/nunet-c/Cargo.toml",
        &["nunet-core", "nunet-daemon", "nunet-mcap", "ort", "iceoryx2", "serde", "anyhow", "rustix"],
    ),
    ("crates/nunet-ipc/Cargo.toml", &["nunet-core", "nunet-daemon", "ort", "serde", "serde_json", "anyhow"]),
    ("crates/nunet-core/Cargo.toml", &["nunet-ipc", "nunet-daemon", "iceoryx2", "clap", "anyhow", "tracing"]),
    ("crates/nunet-daemon/Cargo.toml", &["ort", "iceoryx2", "mcap", "foxglove"]),
    (
        "crates/nunet-engine/Cargo.toml",
        &["ort", "iceoryx2", "mcap", "nunet-ipc", "nunet-mcap", "nunet-daemon", "clap", "anyhow"],
    ),
    (
        "crates/nunet-eval/Cargo.toml",
        &["ort", "iceoryx2", "mcap", "foxglove", "nunet-ipc", "nunet-daemon", "clap", "anyhow", "tracing"],
    ),
    (
        "crates/nunet-files/Cargo.toml",
        &[
            "nunet-core",
            "nunet-ipc",
            "nunet-mcap",
            "nunet-source",
            "nunet-engine",
            "nunet-daemon",
            "clap",
            "anyhow",
            "tracing",
        ],
    ),
    (
        "crates/nunet-foxglove/Cargo.toml",
        &["ort", "iceoryx2", "mcap", "clap", "anyhow", "nunet-ipc", "nunet-engine", "nunet-daemon"],
    ),
    (
        "crates/nunet-mcap/Cargo.toml",
        &["ort", "iceoryx2", "nunet-core", "nunet-ipc", "nunet-daemon", "anyhow"],
    ),
    ("crates/nunet-py/Cargo.toml", &["ort", "iceoryx2", "mcap", "foxglove", "clap", "nunet-mcap"]),
    (
        "crates/nunet-source/Cargo.toml",
        &["ort", "iceoryx2", "mcap", "foxglove", "clap", "anyhow", "nunet-daemon", "nunet-engine"],
    ),
    (
        "crates/nunet-ros2/Cargo.toml",
        &["ort", "iceoryx2", "mcap", "foxglove", "clap", "nunet-engine", "nunet-ipc", "nunet-daemon"],
    ),
    (
        "crates/nunet-ros2-link/Cargo.toml",
        &[
            "ort",
            "iceoryx2",
            "mcap",
            "foxglove",
            "clap",
            "anyhow",
            "nunet-core",
            "nunet-ipc",
            "nunet-source",
            "nunet-daemon",
        ],
    ),
    (
        "crates/nunet-sink/Cargo.toml",
        &["ort", "iceoryx2", "mcap", "foxglove", "clap", "nunet-engine", "nunet-daemon"],
    ),
    (
        "crates/nunet-telemetry/Cargo.toml",
        &["ort", "iceoryx2", "nunet-core", "nunet-ipc", "nunet-source", "nunet-daemon", "clap", "anyhow"],
    ),
    ("crates/nunet-testkit/Cargo.toml", &["ort", "iceoryx2", "nunet-daemon"]),
    (
        "crates/nunet-view/Cargo.toml",
        &[
            "ort",
            "iceoryx2",
            "nunet-core",
            "nunet-ipc",
            "nunet-source",
            "nunet-engine",
            "nunet-daemon",
            "clap",
            "anyhow",
        ],
    ),
    ("xtask/Cargo.toml", &["ort", "iceoryx2", "nunet-core", "nunet-ipc", "nunet-daemon"]),
];

/// A crate's manifest, and the only crates of the workspace that it may depend on, its tests included.
const ONLY: [(&str, &[&str]); 5] = [
    ("crates/nunet-types/Cargo.toml", &[]),
    ("crates/nunet-telemetry/Cargo.toml", &[]),
    ("crates/nunet-mavlink/Cargo.toml", &["nunet-types"]),
    ("crates/nunet-ros2-link/Cargo.toml", &["nunet-types", "nunet-mcap", "nunet-testkit"]),
    ("crates/nunet-c/Cargo.toml", &["nunet-types", "nunet-ipc"]),
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

/// Names of the normal, build and development dependencies of a manifest.
fn dependencies(manifest: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut inside = false;
    for line in manifest.lines().map(str::trim) {
        if let Some(section) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
            let (table, name) = section.rsplit_once("dependencies").unwrap_or((section, ""));
            inside = section.ends_with("dependencies");
            if !inside && section.contains("dependencies.") && !table.contains("workspace") {
                names.push(name.trim_start_matches('.').to_owned());
            }
        } else if inside && !line.starts_with('#') {
            let name = line.split(['=', '.', ' ']).next().unwrap_or_default();
            names.extend((!name.is_empty()).then(|| name.to_owned()));
        }
    }
    names
}

fn forbidden(path: &str, manifest: &str, unwanted: &[&str]) -> Vec<String> {
    let depends = dependencies(manifest).into_iter().filter(|name| unwanted.contains(&name.as_str()));
    depends.map(|name| format!("{path}: must not depend on `{name}`")).collect()
}

fn beyond(path: &str, manifest: &str, allowed: &[&str]) -> Vec<String> {
    let own = dependencies(manifest).into_iter().filter(|name| name.starts_with("nunet-"));
    let others = own.filter(|name| !allowed.contains(&name.as_str()));
    others.map(|name| format!("{path}: must not depend on `{name}`, only on {allowed:?}")).collect()
}

/// The manifest of a crate.
fn manifest(path: &str) -> String {
    repository::texts(|found| found == path).remove(0).1
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
fn crates_depend_only_on_what_their_layer_allows() {
    let manifests = repository::texts(|path| path.ends_with("Cargo.toml"));
    let mut problems = Vec::new();
    for (path, unwanted) in NO_DEPENDENCY {
        let manifest = manifests.iter().find(|(found, _)| found == path);
        let (_, text) = manifest.unwrap_or_else(|| panic!("{path} is gone; fix NO_DEPENDENCY"));
        assert!(!dependencies(text).is_empty(), "{path}: no dependency was understood");
        problems.extend(forbidden(path, text, unwanted));
    }
    assert_none(&problems);
}

#[test]
fn leaves_depend_on_the_crates_of_the_workspace_that_are_listed_alone() {
    let problems = ONLY.iter().flat_map(|(path, allowed)| beyond(path, &manifest(path), allowed));
    assert_none(&problems.collect::<Vec<_>>());
    assert_eq!(dependencies(&manifest("crates/nunet-types/Cargo.toml")), ["bytemuck"]);
}

#[test]
fn a_dependency_that_is_not_listed_is_found() {
    let text =
        "[dependencies]\nnunet-types.workspace = true\nserde = \"1\"\n[dev-dependencies]\nnunet-core = {}\n";
    assert_eq!(beyond("Cargo.toml", text, &["nunet-types"]).len(), 1);
    assert_eq!(beyond("Cargo.toml", text, &[]).len(), 2);
    assert_none(&beyond("Cargo.toml", text, &["nunet-types", "nunet-core"]));
}

#[test]
fn a_forbidden_dependency_is_found_in_every_spelling() {
    for manifest in [
        "[dependencies]\nort.workspace = true",
        "[dev-dependencies]\nort = \"2\"",
        "[target.'cfg(unix)'.dependencies]\nort = { version = \"2\" }",
        "[dependencies.ort]\nversion = \"2\"",
    ] {
        assert_eq!(forbidden("Cargo.toml", manifest, &["ort"]).len(), 1, "{manifest}");
    }
    assert!(
        forbidden("Cargo.toml", "[dependencies]\nsort = \"1\"\n[features]\nort = []", &["ort"]).is_empty()
    );
}
