//! Allowed dependencies between the crates of the workspace: each crate has a row, and ARCHITECTURE.md states
//! the same.
//!
//! A rename in a manifest cannot hide a dependency, because Cargo.lock has the real names. It does not say
//! which ones are for tests alone; the manifests do.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use crate::assert_none;
use crate::repository;

/// A crate of the workspace, and the other crates of the workspace that it depends on, in all features. Their
/// names are without `nunet-`.
struct Row {
    name: &'static str,
    uses: &'static str,
    /// Those that only its tests depend on.
    tests_use: &'static str,
}

const fn row(name: &'static str, uses: &'static str, tests_use: &'static str) -> Row {
    Row { name, uses, tests_use }
}

/// All crates, each after those that it depends on. A new dependency needs a change here and in
/// ARCHITECTURE.md.
const ROWS: [Row; 20] = [
    row("nunet-telemetry", "", ""),
    row("nunet-types", "", ""),
    row("nunet-core", "types", "testkit"),
    row("nunet-engine", "core types", ""),
    row("nunet-files", "types", ""),
    row("nunet-ipc", "types", "testkit"),
    row("nunet-c", "ipc types", ""),
    row("nunet-mavlink", "types", ""),
    row("nunet-mcap", "types", "testkit"),
    row("nunet-ros2-link", "mcap types", "testkit"),
    row("nunet-source", "core ipc mcap ros2-link types", "testkit"),
    row("nunet-eval", "core engine files mcap source types", ""),
    row("nunet-testkit", "types", ""),
    row("nunet-view", "files telemetry types", "testkit"),
    row("nunet-sink", "core files ipc mavlink mcap source telemetry types view", ""),
    row("nunet-ros2", "core mcap ros2-link sink source telemetry types", "testkit"),
    row("nunet-foxglove", "core mcap ros2 ros2-link sink telemetry types", "source"),
    row(
        "nunet-daemon",
        "core engine eval files foxglove ipc mavlink mcap ros2 sink source telemetry types view",
        "ros2-link testkit",
    ),
    row("nunet-py", "core daemon engine files ipc source types", ""),
    row("xtask", "", ""),
];

/// The head of the table in ARCHITECTURE.md.
const TABLE_HEAD: &str = "| crate | depends on | and through these on |";

/// A line of a manifest that names a dependency.
#[derive(Debug, PartialEq)]
struct Dependency<'a> {
    name: &'a str,
    is_for_tests: bool,
}

/// The normal, build and development dependencies of a manifest.
fn dependencies(manifest: &str) -> Vec<Dependency<'_>> {
    let mut found = Vec::new();
    let (mut inside, mut is_for_tests) = (false, false);
    for line in manifest.lines().map(str::trim) {
        if let Some(section) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
            let (table, name) = section.rsplit_once("dependencies").unwrap_or((section, ""));
            inside = section.ends_with("dependencies");
            is_for_tests = table.ends_with("dev-");
            if !inside && section.contains("dependencies.") && !table.contains("workspace") {
                found.push(Dependency { name: name.trim_start_matches('.'), is_for_tests });
            }
        } else if inside && !line.starts_with('#') {
            let name = line.split(['=', '.', ' ']).next().unwrap_or_default();
            found.extend((!name.is_empty()).then_some(Dependency { name, is_for_tests }));
        }
    }
    found
}

/// The crates of the workspace, and all that each of them depends on, of Cargo.lock.
pub(crate) fn locked(lock: &str) -> BTreeMap<&str, BTreeSet<&str>> {
    let mut crates = BTreeMap::new();
    // A package of this workspace has no source.
    for package in lock.split("[[package]]").skip(1).filter(|package| !package.contains("\nsource = ")) {
        let name = package.split('"').nth(1).expect("a package begins with its name");
        let list = package.split_once("dependencies = [").map_or("", |(_, list)| list);
        let names = list.split('"').skip(1).step_by(2).filter_map(|entry| entry.split(' ').next());
        crates.insert(name, names.collect());
    }
    crates
}

/// The name of a crate of this workspace without `nunet-`.
pub(crate) fn short(name: &str) -> &str {
    name.strip_prefix("nunet-").unwrap_or(name)
}

/// What is in one set and not in the other.
pub(crate) fn differences(what: &str, found: &BTreeSet<&str>, listed: &BTreeSet<&str>) -> Vec<String> {
    let new = found.difference(listed).map(|name| format!("{what}: `{name}` is not listed"));
    let old = listed.difference(found).map(|name| format!("{what}: `{name}` is listed, but not there"));
    new.chain(old).collect()
}

/// Where a crate depends on other crates of the workspace than those in its row.
fn beyond(row: &Row, manifest: &str, locked: &BTreeSet<&str>) -> Vec<String> {
    let uses: BTreeSet<&str> = row.uses.split_whitespace().collect();
    let all: BTreeSet<&str> = uses.iter().copied().chain(row.tests_use.split_whitespace()).collect();
    let listed = dependencies(manifest).into_iter().filter(|one| !one.is_for_tests);
    let normal = listed.filter_map(|one| one.name.strip_prefix("nunet-")).collect();
    let with_tests = locked.iter().filter_map(|name| name.strip_prefix("nunet-")).collect();
    let mut problems = differences(&format!("{}, without tests", row.name), &normal, &uses);
    problems.extend(differences(&format!("{}, with tests", row.name), &with_tests, &all));
    problems
}

/// All crates that a crate reaches, without its tests.
fn reached<'a>(rows: &[Row], name: &'a str) -> BTreeSet<&'a str> {
    let mut found = BTreeSet::new();
    let mut waiting = vec![short(name)];
    while let Some(name) = waiting.pop() {
        let own = rows.iter().filter(|row| short(row.name) == name);
        let uses = own.flat_map(|row| row.uses.split_whitespace());
        waiting.extend(uses.filter(|other| found.insert(*other)));
    }
    found
}

/// A row of the table in ARCHITECTURE.md.
fn documented(rows: &[Row], row: &Row) -> String {
    let uses: Vec<&str> = row.uses.split_whitespace().collect();
    let others: Vec<&str> = reached(rows, row.name).into_iter().filter(|name| !uses.contains(name)).collect();
    let listed = |names: &[&str]| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    format!("| `{}` | {} | {} |", row.name, listed(&uses), listed(&others))
}

/// The rows of the table in ARCHITECTURE.md that differ from the code.
fn undocumented(rows: &[Row], document: &str) -> Vec<String> {
    let expected: Vec<String> = rows.iter().map(|row| documented(rows, row)).collect();
    let table = document.lines().skip_while(|line| *line != TABLE_HEAD).skip(2);
    let stated: BTreeSet<&str> = table.take_while(|line| line.starts_with('|')).collect();
    let expected_lines: BTreeSet<&str> = expected.iter().map(String::as_str).collect();
    differences("ARCHITECTURE.md", &expected_lines, &stated)
}

/// A file of the checkout.
pub(crate) fn text(path: &str) -> String {
    fs::read_to_string(repository::root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The folder and the name of each crate of the workspace.
fn members(manifest: &str) -> Vec<(&str, &str)> {
    let list = manifest.lines().find(|line| line.starts_with("members = ["));
    let folders = list.expect("the workspace lists its crates in one line").split('"').skip(1).step_by(2);
    folders.map(|folder| (folder, folder.trim_start_matches("crates/"))).collect()
}

#[test]
fn each_crate_depends_on_the_crates_in_its_row_alone() {
    let (lock, workspace) = (text("Cargo.lock"), text("Cargo.toml"));
    let (locked, members) = (locked(&lock), members(&workspace));
    let names: BTreeSet<&str> = members.iter().map(|(_, name)| *name).collect();
    let rows: BTreeSet<&str> = ROWS.iter().map(|row| row.name).collect();
    assert_none(&differences("crates of ROWS", &names, &rows));
    let found: BTreeSet<&str> = locked.keys().copied().collect();
    assert_none(&differences("crates of Cargo.lock", &found, &rows));
    let problems = members.iter().flat_map(|(folder, name)| {
        let row = ROWS.iter().find(|row| row.name == *name).expect("each crate has a row");
        beyond(row, &text(&format!("{folder}/Cargo.toml")), &locked[name])
    });
    assert_none(&problems.collect::<Vec<_>>());
}

#[test]
fn no_crate_depends_on_a_test_helper_outside_of_its_tests() {
    let problems = ROWS.iter().filter(|row| reached(&ROWS, row.name).contains("testkit"));
    assert_none(&problems.map(|row| row.name.to_owned()).collect::<Vec<_>>());
}

#[test]
fn the_architecture_states_what_each_crate_depends_on() {
    assert_none(&undocumented(&ROWS, &text("ARCHITECTURE.md")));
}

/// A crate that reaches `nunet-b` through `nunet-a`.
const THREE: [Row; 3] = [row("nunet-b", "", ""), row("nunet-a", "b", ""), row("nunet-top", "a", "testkit")];

#[test]
fn a_dependency_that_is_not_listed_is_found() {
    let manifest = "[dependencies]\nnunet-a.workspace = true\nserde = \"1\"\n\
                    [dev-dependencies]\nnunet-testkit = {}\n";
    let top = &THREE[2];
    assert_none(&beyond(top, manifest, &BTreeSet::from(["nunet-a", "nunet-testkit", "serde"])));
    // One more, one that only the tests may use, one that is named differently, and one that is gone.
    let one_more = format!("[dependencies]\nnunet-b = {{}}\n{manifest}");
    let locked = BTreeSet::from(["nunet-a", "nunet-b", "nunet-testkit"]);
    assert_eq!(beyond(top, &one_more, &locked).len(), 2);
    let not_only_tests = format!("[build-dependencies]\nnunet-testkit = {{}}\n{manifest}");
    assert_eq!(beyond(top, &not_only_tests, &BTreeSet::from(["nunet-a", "nunet-testkit"])).len(), 1);
    let renamed = format!("[dependencies]\nb = {{ package = \"nunet-b\" }}\n{manifest}");
    assert_eq!(beyond(top, &renamed, &locked).len(), 1);
    assert_eq!(beyond(top, "", &BTreeSet::new()).len(), 3);
}

#[test]
fn a_dependency_is_found_in_every_spelling() {
    for (manifest, is_for_tests) in [
        ("[dependencies]\nort.workspace = true", false),
        ("[dev-dependencies]\nort = \"2\"", true),
        ("[build-dependencies]\nort = \"2\"", false),
        ("[target.'cfg(unix)'.dependencies]\nort = { version = \"2\" }", false),
        ("[target.'cfg(unix)'.dev-dependencies]\nort = { version = \"2\" }", true),
        ("[dependencies.ort]\nversion = \"2\"", false),
        ("[dev-dependencies.ort]\nversion = \"2\"", true),
    ] {
        assert_eq!(dependencies(manifest), [Dependency { name: "ort", is_for_tests }], "{manifest}");
    }
    let others = "[features]\nort = []\n[workspace.dependencies.ort]\nversion = \"2\"";
    assert!(dependencies(others).is_empty());
}

#[test]
fn only_crates_of_the_workspace_are_read_from_the_lock_file() {
    let lock = "version = 4\n\n[[package]]\nname = \"ort\"\nversion = \"2\"\nsource = \"registry\"\n\n\
                [[package]]\nname = \"nunet-a\"\nversion = \"0\"\ndependencies = [\n \"nunet-b\",\n \
                \"ort 2.0.0\",\n]\n\n[[package]]\nname = \"nunet-b\"\nversion = \"0\"\n";
    let expected = [("nunet-a", BTreeSet::from(["nunet-b", "ort"])), ("nunet-b", BTreeSet::new())];
    assert_eq!(locked(lock), BTreeMap::from(expected));
}

#[test]
fn a_wrong_row_of_the_architecture_is_found() {
    let table = "| `nunet-b` | none | none |\n| `nunet-a` | b | none |\n| `nunet-top` | a | b |\n";
    let document = format!("text\n\n{TABLE_HEAD}\n|---|---|---|\n{table}\ntext\n");
    assert_none(&undocumented(&THREE, &document));
    assert_eq!(undocumented(&THREE, &document.replace("| a | b |", "| a | none |")).len(), 2);
    assert_eq!(undocumented(&THREE, &document.replace("| `nunet-a` | b | none |\n", "")).len(), 1);
    assert_eq!(undocumented(&THREE, "").len(), 3);
    assert_eq!(undocumented(&THREE[..2], &document).len(), 1);
}
