//! Tests of the repository's structure: allowed dependencies, rules of core, lengths of files, and that
//! links in documents are valid. Run by `cargo xtask check`.
//!
//! Each rule is a function from text to problems, and is tested with a counter-example beside it, because a
//! check that cannot fail is useless.

mod core_rules;
mod counts;
mod crates;
mod cycles;
mod dependencies;
mod documents;
mod functions;
mod hints;
mod identifiers;
mod lints;
mod order;
mod packaging;
mod python_source;
mod repository;
mod rust_source;
mod sizes;
mod vocabulary;
mod words;

/// Fail with all problems, not the first.
#[track_caller]
fn assert_none(problems: &[String]) {
    assert!(problems.is_empty(), "{} problems:\n{}", problems.len(), problems.join("\n"));
}
