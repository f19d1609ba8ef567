//! A count of 1 has a noun in the singular.

use crate::assert_none;
use crate::repository;
use crate::rust_source::{is_test_file, without_tests};

/// Nouns of counts that are 1 in practice.
const NOUNS: [&str; 7] = ["cameras", "files", "frames", "images", "messages", "readers", "threads"];

/// The places where a value is followed by a noun in the plural. A rate such as `30.0 frames/s` has no
/// singular.
fn plurals(path: &str, text: &str) -> Vec<String> {
    let mut problems = Vec::new();
    for (index, line) in without_tests(text).lines().enumerate() {
        for noun in NOUNS {
            let mark = format!("}} {noun}");
            let mut rests = line.match_indices(mark.as_str()).map(|(at, _)| &line[at + mark.len()..]);
            if rests.any(|rest| !rest.starts_with(|c: char| c == '/' || c.is_alphanumeric())) {
                problems.push(format!("{path}:{}: a count of {noun}; write it with `counted`", index + 1));
            }
        }
    }
    problems
}

#[test]
fn counts_in_messages_have_a_singular() {
    let sources =
        repository::texts(|path| path.starts_with("crates/") && path.ends_with(".rs") && !is_test_file(path));
    assert_none(&sources.iter().flat_map(|(path, text)| plurals(path, text)).collect::<Vec<_>>());
}

#[test]
fn a_plural_after_a_value_is_found() {
    for text in ["info!(\"{count} frames\");", "bail!(\"1 of {} images failed\");", "\"{a} files: {b}\""] {
        assert_eq!(plurals("a.rs", text).len(), 1, "{text}");
    }
    let test = "#[cfg(test)]\nmod tests {\n    const A: &str = \"{count} frames\";\n}\n";
    for text in ["\"{:.1} frames/s\"", "\"topics: {topics}\"", "counted(count, \"frame\")", test] {
        assert_none(&plurals("a.rs", text));
    }
}
