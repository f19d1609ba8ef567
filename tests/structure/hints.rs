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
