//! Bounds: a function fits on a screen, and most are much shorter.

use crate::assert_none;
use crate::python_source;
use crate::repository;
use crate::rust_source::{functions, is_test_file};

/// The most lines of a function: signature and body, comments included.
const MAX_LINES: usize = 45;
/// The 90th percentile of these lines.
const MAX_P90: usize = 20;

/// A function and how many lines it has, from its signature to its end.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Function {
    pub(crate) name: String,
    /// Where it begins.
    pub(crate) line: usize,
    pub(crate) lines: usize,
}

/// Finds path, name, first line and number of lines of each function. Docstrings do not count, as doc
/// comments do not in Rust.
const PYTHON_FUNCTIONS: &str = "
for path, text in files:
    for node in ast.walk(ast.parse(text, path)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            lines, first = node.end_lineno - node.lineno + 1, node.body[0]
            if ast.get_docstring(node) is not None:
                lines -= first.end_lineno - first.lineno + 1
            found.append((path, node.name, node.lineno, lines))
";

fn python_functions(files: &[(String, String)]) -> Vec<(String, Function)> {
    let found: Vec<(String, String, usize, usize)> = python_source::run(PYTHON_FUNCTIONS, files);
    found.into_iter().map(|(path, name, line, lines)| (path, Function { name, line, lines })).collect()
}

fn rust_functions(files: &[(String, String)]) -> Vec<(String, Function)> {
    let of_file = |(path, text): &(String, String)| {
        let found = functions(path, text).into_iter();
        found.map(|function| (path.clone(), function)).collect::<Vec<_>>()
    };
    files.iter().flat_map(of_file).collect()
}

/// The functions that are too long, and their 90th percentile if that is too large.
fn problems(found: &[(String, Function)]) -> Vec<String> {
    let long = found.iter().filter(|(_, function)| function.lines > MAX_LINES);
    let mut problems: Vec<String> = long
        .map(|(path, Function { name, line, lines })| {
            format!("{path}:{line}: `{name}` has {lines} lines, {MAX_LINES} at most")
        })
        .collect();
    let mut lengths: Vec<usize> = found.iter().map(|(_, function)| function.lines).collect();
    lengths.sort_unstable();
    let p90 = lengths.get(lengths.len() * 9 / 10).copied().unwrap_or(0);
    if p90 > MAX_P90 {
        problems.push(format!("one of ten functions has {p90} lines or more, {MAX_P90} at most"));
    }
    problems
}

/// The sources with this ending that are not tests.
fn sources(ending: &str) -> Vec<(String, String)> {
    let mut sources = repository::texts(|path| path.ends_with(ending));
    sources.retain(|(path, _)| !is_test_file(path));
    sources
}

#[test]
fn no_rust_function_has_more_than_45_lines_and_nine_of_ten_have_20_at_most() {
    assert_none(&problems(&rust_functions(&sources(".rs"))));
}

#[test]
fn no_python_function_has_more_than_45_lines_and_nine_of_ten_have_20_at_most() {
    assert_none(&problems(&python_functions(&sources(".py"))));
}

#[test]
fn clippy_which_counts_tests_too_has_the_same_limit() {
    let (_, clippy) = repository::texts(|path| path == "clippy.toml").remove(0);
    let limit = format!("too-many-lines-threshold = {MAX_LINES}");
    assert!(clippy.lines().any(|line| line == limit), "clippy.toml: expected `{limit}`");
}

/// A function with so many lines, in an `impl`.
fn rust(lines: usize) -> String {
    format!("impl A {{\n    /// A.\n    fn a() {{\n{}    }}\n}}\n", "g();\n".repeat(lines - 2))
}

/// The same in a class.
fn python(lines: usize) -> String {
    format!("class A:\n    def a():\n        \"A.\"\n{}", "        g()\n".repeat(lines - 1))
}

type Find = fn(&[(String, String)]) -> Vec<(String, Function)>;

#[test]
fn a_long_function_is_found_in_both_languages() {
    for (find, of) in [(rust_functions as Find, rust as fn(usize) -> String), (python_functions, python)] {
        let files = |lines| [("short".to_owned(), of(5).repeat(20)), ("a".to_owned(), of(lines))];
        assert_eq!(find(&files(7))[20].1.lines, 7);
        assert_eq!(problems(&find(&files(MAX_LINES))), Vec::<String>::new());
        assert_eq!(problems(&find(&files(MAX_LINES + 1))).len(), 1);
    }
}

#[test]
fn test_functions_are_not_counted() {
    let test = format!("#[test]\nfn a() {{\n{}}}\n", "g();\n".repeat(60));
    assert!(functions("a.rs", &test).is_empty());
    assert!(functions("a.rs", &format!("#[cfg(test)]\nmod tests {{\n{}}}\n", &test[8..])).is_empty());
}

#[test]
fn many_functions_of_medium_length_are_found() {
    let of = |lengths: [usize; 10]| {
        let function = |lines| ("a.rs".to_owned(), Function { name: "a".into(), line: 1, lines });
        problems(&lengths.map(function)).len()
    };
    assert_eq!(of([5, 5, 5, 5, 5, 5, 5, 5, 40, 21]), 1);
    assert_eq!(of([5, 5, 5, 5, 5, 5, 5, 5, 5, 20]), 0);
}
