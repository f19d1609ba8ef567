//! One term for one thing: replaced names do not come back, in code, comments, documents or tests.

use crate::assert_none;
use crate::repository;

/// A replaced word, in all its forms, and the term to write instead.
const REPLACED: [(&[&str], &str); 14] = [
    (&["picture", "pictures"], "image"),
    (&["verb", "verbs"], "subcommand"),
    (&["optics"], "camera, intrinsics"),
    (&["outlet", "outlets"], "publisher"),
    (&["wish", "wishes", "wished"], "requested mode, option"),
    (&["mend", "mends", "mended", "mending"], "repair, fix"),
    (&["bury", "buries", "buried"], "remove"),
    (&["hush", "hushed"], "silence"),
    (&["patience"], "timeout"),
    (&["vetting", "vetted"], "model check"),
    (&["thrown"], "distort"),
    (&["sibling", "siblings"], "share_sessions"),
    (&["told"], "reported"),
    (&["sweep", "sweeps", "swept"], "remove, feed_damaged"),
];

/// Where a replaced word is right: the beginning of a path, a part of the line (lower case), and why.
const ALLOWED: [(&str, &str, &str); 19] = [
    ("tests/structure/vocabulary.rs", "", "the list itself"),
    ("", "nunet-selftest", "a field of the model file"),
    ("crates/nunet-core/src/model/selftest/", "\"picture\"", "a field of the model file"),
    ("models/", "picture", "a class: a painting on a wall; keys of shipped reports"),
    ("crates/nunet-types/src/classes.rs", "picture", "a class: a painting on a wall"),
    ("crates/nunet-testkit/src/demo/", "picture", "a class: a painting on a wall"),
    ("tests/python/", "[\"pictures\"]", "a key of `eval --json`"),
    ("tests/python/", "pictures.csv", "a file that `eval` writes"),
    ("docs/", "pictures.csv", "a file that `eval` writes"),
    ("docs/", "| class | bed |", "a class: a painting on a wall"),
    ("docs/", "`pictures`", "a key of `eval --json`"),
    ("crates/nunet-core/src/graph/onnx/model.rs", "outlet", "a type of ort"),
    ("crates/nunet-c/include/nunet.hpp", "thrown", "C++ exceptions"),
    ("examples/", "depth_picture", "a name of nunet-daemon"),
    ("crates/nunet-mcap/src/topics.rs", "told apart", "plain English"),
    ("crates/nunet-source/src/recording.rs", "told apart", "plain English"),
    ("", "nunet_sweep", "an environment variable"),
    ("", "picture_mean", "a key of `eval --json` and of the recipe's reports"),
    ("", "per_picture", "a name of the recipe"),
];

/// Folders that do not comply yet. The list may only shrink; the goal is an empty one.
const PENDING: [&str; 3] = ["crates/nunet-daemon/", "crates/nunet-eval/", "models/recipe/"];

/// The words of a line, lower case. Names such as `OldName` and `old_name` are two words.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut after_lower = false;
    for c in line.chars() {
        if !c.is_alphabetic() || (c.is_uppercase() && after_lower) {
            words.push(String::new());
        }
        if c.is_alphabetic() {
            words.last_mut().expect("never empty").extend(c.to_lowercase());
        }
        after_lower = c.is_lowercase();
    }
    words.retain(|word| !word.is_empty());
    words
}

fn replaced(path: &str, text: &str) -> Vec<String> {
    let mut problems = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let lower = line.to_lowercase();
        if ALLOWED.iter().any(|(prefix, part, _)| path.starts_with(prefix) && lower.contains(part)) {
            continue;
        }
        for word in words(line) {
            if let Some((_, term)) = REPLACED.iter().find(|(forms, _)| forms.contains(&word.as_str())) {
                problems.push(format!("{path}:{}: `{word}`; write: {term}", index + 1));
            }
        }
    }
    problems
}

fn is_written_by_us(path: &str) -> bool {
    let endings = [".rs", ".py", ".pyi", ".md", ".toml", ".h", ".hpp", ".c", ".cpp", ".snap", ".sh", ".yml"];
    endings.iter().any(|ending| path.ends_with(ending))
}

#[test]
fn no_replaced_word_is_left_in_code_or_documents() {
    let files = repository::texts(is_written_by_us);
    let ours = files.iter().filter(|(path, _)| !PENDING.iter().any(|folder| path.starts_with(folder)));
    let problems: Vec<String> = ours.flat_map(|(path, text)| replaced(path, text)).collect();
    assert_none(&problems);
}

#[test]
fn a_pending_folder_that_complies_leaves_the_list() {
    let files = repository::texts(is_written_by_us);
    for folder in PENDING {
        let mut own = files.iter().filter(|(path, _)| path.starts_with(folder));
        assert!(own.any(|(path, text)| !replaced(path, text).is_empty()), "{folder}: remove it from PENDING");
    }
}

#[test]
fn a_replaced_word_is_found_in_every_spelling() {
    for line in ["// a picture", "let picture_bytes = 1;", "struct RgbPicture;", "PICTURES", "fn mend() {}"] {
        assert_eq!(replaced("src/a.rs", line).len(), 1, "{line}");
    }
    assert_none(&replaced("src/a.rs", "amend depicture pictured"));
    assert_none(&replaced("tests/python/a.py", "found[\"pictures\"]"));
    assert_eq!(replaced("src/a.py", "found[\"pictures\"]").len(), 1);
}
