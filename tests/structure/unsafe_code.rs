//! Unsafe code: denied by the workspace, opted into with a reason a file, explained block by block. The compiler's
//! lints check most of it; these tests check that the lints are on, and what no lint knows.

use crate::assert_none;
use crate::repository;
use crate::rust_source::{code_only, is_test_file};

/// Lints without which the rules of the house are only words.
const LINTS: [&str; 7] = [
    "unsafe_code = \"deny\"",
    "unsafe_op_in_unsafe_fn = \"deny\"",
    "missing_docs = \"warn\"",
    "undocumented_unsafe_blocks = \"warn\"",
    "allow_attributes_without_reason = \"warn\"",
    "unwrap_used = \"warn\"",
    "too_many_lines = \"warn\"",
];

/// How far above the word `unsafe` its reason may begin.
const SAFETY_LINES: usize = 10;

fn unexplained(path: &str, text: &str) -> Vec<String> {
    let code = code_only(text);
    let lines: Vec<&str> = text.lines().collect();
    let mut problems = Vec::new();
    let mut uses = false;
    for (index, line) in code.lines().enumerate() {
        let mut words =
            line.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty());
        if !words.any(|word| word == "unsafe") || line.contains("#[unsafe(") {
            continue;
        }
        uses = true;
        let declares =
            line.contains("unsafe fn") || line.contains("unsafe trait") || line.contains("unsafe extern");
        let near = &lines[index.saturating_sub(SAFETY_LINES)..=index];
        let explained = near.iter().any(|line| line.contains("SAFETY:") || line.contains("# Safety"));
        if !declares && !explained {
            problems.push(format!("{path}:{}: unsafe without a `SAFETY:` line", index + 1));
        }
    }
    let opted_in = text.split("expect(").skip(1).any(|rest| {
        let Some(end) = rest.find(")]") else { return false };
        rest[..end].contains("unsafe_code") && rest[..end].contains("reason = \"")
    });
    if uses && !opted_in {
        problems.push(format!("{path}: uses unsafe without `#![expect(unsafe_code, reason = \"...\")]`"));
    }
    problems
}

fn missing_lints(manifest: &str) -> Vec<String> {
    let lines: Vec<&str> = manifest.lines().map(str::trim).collect();
    let missing = LINTS.iter().filter(|lint| !lines.contains(lint));
    missing.map(|lint| format!("Cargo.toml: the lint `{lint}` is gone")).collect()
}

#[test]
fn every_use_of_unsafe_is_opted_into_and_explained() {
    let mut sources = repository::rust();
    sources.retain(|(path, _)| !is_test_file(path));
    let problems: Vec<String> = sources.iter().flat_map(|(path, text)| unexplained(path, text)).collect();
    assert_none(&problems);
}

#[test]
fn unsafe_without_reason_or_without_opting_in_is_found() {
    let opt_in = "#![expect(unsafe_code, reason = \"shared memory\")]\n";
    let bare = "fn f() { unsafe { g() } }\n";
    assert_eq!(unexplained("a.rs", bare).len(), 2);
    assert_eq!(unexplained("a.rs", &format!("{opt_in}{bare}")).len(), 1);
    assert_eq!(unexplained("a.rs", &format!("{opt_in}// SAFETY: g is fine\n{bare}")).len(), 0);
    assert_eq!(
        unexplained("a.rs", "#![expect(unsafe_code)]\n// SAFETY: x\nunsafe impl Send for X {}\n").len(),
        1
    );
    assert_eq!(unexplained("a.rs", "// unsafe\nlet s = \"unsafe\";\n").len(), 0);
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
fn a_lint_that_was_switched_off_is_found() {
    assert_eq!(missing_lints("[workspace.lints.rust]\nunsafe_code = \"warn\"").len(), LINTS.len());
}
