//! The project's lints are on in every crate.

use crate::assert_none;
use crate::repository;

/// Lints that enforce the project's rules.
const LINTS: [&str; 10] = [
    "unsafe_code = \"deny\"",
    "unsafe_op_in_unsafe_fn = \"deny\"",
    "missing_docs = \"warn\"",
    "undocumented_unsafe_blocks = \"warn\"",
    "allow_attributes_without_reason = \"warn\"",
    "unwrap_used = \"warn\"",
    "too_many_lines = \"warn\"",
    "print_stdout = \"warn\"",
    "print_stderr = \"warn\"",
    "dbg_macro = \"warn\"",
];

fn missing_lints(manifest: &str) -> Vec<String> {
    let lines: Vec<&str> = manifest.lines().map(str::trim).collect();
    let missing = LINTS.iter().filter(|lint| !lines.contains(lint));
    missing.map(|lint| format!("Cargo.toml: the lint `{lint}` is gone")).collect()
}

#[test]
fn the_lints_are_on_in_every_crate() {
    let manifests = repository::texts(|path| path.ends_with("Cargo.toml") && path != "Cargo.toml");
    let (_, workspace) = repository::texts(|path| path == "Cargo.toml").remove(0);
    let mut problems = missing_lints(&workspace);
    for (path, text) in manifests.iter().filter(|(path, _)| !path.starts_with("fuzz/")) {
        if !text.contains("[lints]\nworkspace = true") {
            problems.push(format!("{path}: no `[lints] workspace = true`"));
        }
    }
    assert_none(&problems);
}

#[test]
fn a_disabled_lint_is_found() {
    assert_eq!(missing_lints("[workspace.lints.rust]\nunsafe_code = \"warn\"").len(), LINTS.len());
}
