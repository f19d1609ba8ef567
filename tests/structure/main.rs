//! What the tree promises, held by tests: who may name whom, what core may not do, how long a file may be, and that
//! what the documents point at exists. Run by `cargo xtask check`.
//!
//! Each rule is a function from text to problems, and is tried on a counter-example beside it: a checker that cannot
//! fail checks nothing.

mod core_rules;
mod cycles;
mod dependencies;
mod documents;
mod functions;
mod hints;
mod lints;
mod order;
mod packaging;
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
