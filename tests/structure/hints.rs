//! Hints are data beside an error (`nunet_types::Hint`), never a part of its text.

use crate::assert_none;
use crate::repository;
use crate::rust_source::{is_test_file, without_tests};

/// How a hint within a text looks. Spelled in two halves: this file is searched too.
const MARKS: [(&str, &str); 2] = [("\\nhi", "nt: "), ("; hi", "nt: ")];

/// Where a text and its hint become one text, because an interface carries one text only.
const JOINED: [(&str, &str); 3] = [
    (
        "crates/nunet-types/src/hint.rs",
        "the one function that joins them, for clap, serde and Python's exceptions",
    ),
    ("crates/nunet-py/python/nunet_py/_export.py", "Python's exceptions; the attribute `hint` has it too"),
    ("models/recipe/nunet_models/errors.py", "the one function that joins them, for the command line"),
];

fn hints_in_texts(path: &str, text: &str) -> Vec<String> {
    let text = if path.ends_with(".rs") { without_tests(text) } else { text.to_owned() };
    let marks = MARKS.map(|(head, tail)| format!("{head}{tail}"));
    // A text that goes on in the next line: Rust's `\n\` and Python's `\n"`.
    let (line_end, tail) = marks[0].split_at(2);
    let goes_on = |line: &str| ["\\", "\""].iter().any(|end| line.ends_with(&format!("{line_end}{end}")));
    let (mut problems, mut before) = (Vec::new(), "");
    for (index, line) in text.lines().enumerate() {
        let is_continued = goes_on(before) && line.trim_start_matches([' ', 'f', '"']).starts_with(tail);
        if is_continued || marks.iter().any(|mark| line.contains(mark.as_str())) {
            problems.push(format!("{path}:{}: a hint within a text; implement `Hint`", index + 1));
        }
        before = line;
    }
    problems
}

/// Types with hints that are in no chain of causes, and what their hints are copied into instead.
const COPIED: [(&str, &str); 8] = [
    ("AddressError", "`BadArguments`: it is an error of a flag"),
    ("AspectMismatch", "a warning of what reads the calibration"),
    ("CameraFault", "`SourceError`"),
    ("DimImages", "a warning of what reads the images"),
    ("FactorDoubt", "a warning of `calibrate`"),
    ("FloorMismatch", "a warning of what knows the mount"),
    ("MountDoubt", "a warning of what reads the mount"),
    ("NoAttitude", "a warning of `AttitudeStage`"),
];

/// The variants of transparent errors in a file that its `Hint` does not name. Only the error inside is
/// shown: it is not in the chain of causes, so that its hint and its kind are lost unless they are passed on.
fn forgotten_variants(path: &str, text: &str) -> Vec<String> {
    let text = without_tests(text);
    let Some((_, hints)) = text.split_once("\nimpl Hint for ") else { return Vec::new() };
    let hints = hints.split("\n}").next().unwrap_or_default();
    let variants = text.split("#[error(transparent)]").skip(1);
    let names = variants.filter_map(|rest| rest.trim_start().split_once('(').map(|(name, _)| name));
    let is_forgotten = |name: &&str| !hints.contains(&format!("Self::{name}("));
    let problem = |name| format!("{path}: the hint of `{name}` is lost; pass it on in `impl Hint`");
    names.filter(is_forgotten).map(problem).collect()
}

#[test]
fn the_hint_of_an_error_inside_is_passed_on() {
    let sources = repository::texts(|path| path.ends_with(".rs") && !is_test_file(path));
    let with_hints = |(path, text): &(String, String)| forgotten_variants(path, text);
    assert_none(&sources.iter().flat_map(with_hints).collect::<Vec<_>>());
    let error = "enum E {\n    #[error(transparent)]\n    Inner(#[from] Inner),\n}\n\nimpl Hint for E {\n    _ => None,\n}\n";
    assert_eq!(forgotten_variants("a.rs", error).len(), 1);
    assert_none(&forgotten_variants(
        "a.rs",
        &error.replace("_ => None", "Self::Inner(error) => error.hint()"),
    ));
}

/// The types with hints in a file that no list of them names.
fn unlisted_types(path: &str, text: &str, lists: &str) -> Vec<String> {
    let text = without_tests(text);
    let types = text.split("\nimpl Hint for ").skip(1).filter_map(|rest| rest.split(' ').next());
    let entries = |name: &str| ["of::<", "as_hint::<", "::"].map(|start| format!("{start}{name}>"));
    let is_listed = |name: &str| entries(name).iter().any(|entry| lists.contains(entry));
    let is_copied = |name: &str| COPIED.iter().any(|(copied, _)| *copied == name);
    let unlisted = types.filter(|name| !is_listed(name) && !is_copied(name));
    unlisted.map(|name| format!("{path}: no list of hints has `{name}`; add it to `HINTS`")).collect()
}

#[test]
fn every_error_with_hints_is_listed_where_hints_are_printed() {
    let is_list =
        |path: &str| ["crates/nunet-core/src/hints.rs", "crates/nunet-daemon/src/exit.rs"].contains(&path);
    let lists: String = repository::texts(is_list).into_iter().map(|(_, text)| text).collect();
    let sources =
        repository::texts(|path| path.starts_with("crates/") && path.ends_with(".rs") && !is_test_file(path));
    let unlisted = |(path, text): &(String, String)| unlisted_types(path, text, &lists);
    assert_none(&sources.iter().flat_map(unlisted).collect::<Vec<_>>());
    let (error, list) = ("\nimpl Hint for E {", "as_hint::<E>, as_hint::<a::F>");
    assert_eq!(unlisted_types("a.rs", error, "as_hint::<EE>").len(), 1);
    assert_none(&unlisted_types("a.rs", &(error.to_owned() + "\nimpl Hint for F {"), list));
}

/// The crates whose errors become exceptions of the Python package.
const BEHIND_PYTHON: [&str; 4] = ["nunet-engine", "nunet-files", "nunet-ipc", "nunet-source"];

#[test]
fn every_error_with_hints_behind_the_python_package_is_listed_there() {
    let list = repository::texts(|path| path == "crates/nunet-py/src/error.rs").remove(0).1;
    assert!(list.contains("nunet_core::as_hint,"), "the list of nunet-core");
    let is_behind =
        |path: &str| BEHIND_PYTHON.iter().any(|name| path.starts_with(&format!("crates/{name}/")));
    let sources = repository::texts(|path| is_behind(path) && path.ends_with(".rs") && !is_test_file(path));
    let unlisted = |(path, text): &(String, String)| unlisted_types(path, text, &list);
    assert_none(&sources.iter().flat_map(unlisted).collect::<Vec<_>>());
    assert_eq!(
        unlisted_types("a.rs", "\nimpl Hint for SourceError {", &list.replace("SourceError", "E")).len(),
        1
    );
}

#[test]
fn no_message_contains_its_hint() {
    let mut sources = repository::texts(|path| path.ends_with(".rs") || path.ends_with(".py"));
    let is_joined = |path: &str| JOINED.iter().any(|(allowed, _)| *allowed == path);
    sources.retain(|(path, _)| !is_test_file(path) && !is_joined(path));
    let problems: Vec<String> = sources.iter().flat_map(|(path, text)| hints_in_texts(path, text)).collect();
    assert_none(&problems);
}

#[test]
fn a_hint_in_a_text_is_found_on_one_line_and_on_two() {
    for mark in MARKS.map(|(head, tail)| format!("{head}{tail}")) {
        assert_eq!(hints_in_texts("a.rs", &format!("bail!(\"it failed{mark}try again\");")).len(), 1);
    }
    let (head, tail) = MARKS[0];
    let continued = format!("bail!(\n    \"it failed\\n\\\n     {}{tail}try again\");", &head[2..]);
    assert_eq!(hints_in_texts("a.rs", &continued).len(), 1);
    let test = format!("#[cfg(test)]\nmod tests {{\n    const A: &str = \"a{head}{tail}b\";\n}}\n");
    assert_none(&hints_in_texts("a.rs", &test));
}
