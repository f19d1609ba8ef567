//! Limits for lines of source files and bytes in git.

use crate::assert_none;
use crate::repository;
use crate::rust_source::{code_lines, is_test_file};

/// The most lines of a source file without its tests. Most files have 100 to 300.
const MAX_LINES: usize = 350;

/// The most bytes of all files below `models/` together.
const MAX_MODEL_BYTES: usize = 110_000_000;

/// Copies of some models for the Python package. Git stores equal files once.
const COPIES: &str = "crates/nunet-py/python/nunet_py/models/";

/// The most bytes of any other file: larger ones are data, recordings or builds, which do not belong into
/// git.
const MAX_FILE_BYTES: usize = 5_000_000;

fn too_long(path: &str, text: &str) -> Vec<String> {
    let lines = if path.ends_with(".rs") { code_lines(text) } else { text.lines().count() };
    let message =
        format!("{path}: {lines} lines of code, {MAX_LINES} at most; what is the second thing in it?");
    Vec::from_iter((lines > MAX_LINES).then_some(message))
}

fn too_heavy<'a>(files: impl Iterator<Item = (&'a str, usize)>) -> Vec<String> {
    let mut problems = Vec::new();
    let mut models = 0;
    for (path, bytes) in files {
        if path.starts_with("models/") {
            models += bytes;
        } else if bytes > MAX_FILE_BYTES && !path.starts_with(COPIES) {
            problems.push(format!("{path}: {bytes} bytes, {MAX_FILE_BYTES} at most"));
        }
    }
    if models > MAX_MODEL_BYTES {
        problems.push(format!("models/: {models} bytes in all, {MAX_MODEL_BYTES} at most"));
    }
    problems
}

#[test]
fn no_source_file_is_longer_than_350_lines_without_its_tests() {
    let mut sources = repository::texts(|path| path.ends_with(".rs") || path.ends_with(".py"));
    sources.retain(|(path, _)| !is_test_file(path));
    let long = sources.iter().flat_map(|(path, text)| too_long(path, text));
    assert_none(&long.collect::<Vec<_>>());
}

/// The most lines of the daemon's crate without its tests: code that other programs could use belongs into a
/// library.
const MAX_DAEMON_LINES: usize = 8_000;

#[test]
fn the_daemon_has_less_than_8000_lines_without_its_tests() {
    let mut sources = repository::texts(|path| path.starts_with("crates/nunet-daemon/"));
    sources.retain(|(path, _)| path.ends_with(".rs") && !is_test_file(path));
    assert!(sources.iter().any(|(path, _)| path.ends_with("/build.rs")), "the whole crate counts");
    let lines: usize = sources.iter().map(|(_, text)| code_lines(text)).sum();
    assert!((1..MAX_DAEMON_LINES).contains(&lines), "{lines} lines, fewer than {MAX_DAEMON_LINES} wanted");
}

/// The most columns of a comment. rustfmt limits code, and texts may be longer.
const MAX_COLUMNS: usize = 110;

/// Comments that are too wide. Rows of tables and links cannot be wrapped.
fn wide_comments(path: &str, text: &str) -> Vec<String> {
    let is_wide = |line: &str| {
        let comment = line.trim_start().strip_prefix("//").unwrap_or_default();
        let comment = comment.trim_start_matches(['/', '!']).trim();
        line.chars().count() > MAX_COLUMNS && !comment.starts_with('|') && comment.contains(' ')
    };
    let wide = text.lines().enumerate().filter(|(_, line)| is_wide(line));
    wide.map(|(index, _)| format!("{path}:{}: more than {MAX_COLUMNS} columns", index + 1)).collect()
}

#[test]
fn comments_have_110_columns_at_most() {
    let sources = repository::texts(|path| path.ends_with(".rs"));
    let wide = sources.iter().flat_map(|(path, text)| wide_comments(path, text));
    assert_none(&wide.collect::<Vec<_>>());
}

#[test]
fn a_wide_comment_is_found_and_a_table_or_a_text_is_none() {
    let wide = "word ".repeat(23);
    for comment in ["// ", "    /// ", "//! - "] {
        assert_eq!(wide_comments("a.rs", &format!("{comment}{wide}")).len(), 1);
    }
    assert_none(&wide_comments("a.rs", &format!("//! | {wide} |\nlet text = \"{wide}\";\n")));
}

#[test]
fn a_long_file_is_found_and_its_tests_do_not_count() {
    let code = "//\n".repeat(MAX_LINES);
    assert!(too_long("a.rs", &code).is_empty());
    assert_eq!(too_long("a.rs", &format!("{code}//\n")).len(), 1);
    assert!(too_long("a.rs", &format!("{}\n#[cfg(test)]\nmod tests {{\n{code}}}\n", &code[3..])).is_empty());
}

#[test]
fn the_models_in_git_take_110_mb_at_most_and_other_files_5_mb() {
    let files = repository::files();
    assert_none(&too_heavy(files.iter().map(|file| (file.path.as_str(), file.bytes.len()))));
}

/// The copies that differ from their originals or have none.
fn stale(files: &[repository::File]) -> Vec<String> {
    let copies = files.iter().filter_map(|file| Some((file, file.path.strip_prefix(COPIES)?)));
    let stale = copies.filter(|(copy, name)| {
        let original = files.iter().find(|file| file.path.strip_prefix("models/") == Some(name));
        original.is_none_or(|original| original.bytes != copy.bytes)
    });
    stale.map(|(copy, name)| format!("{}: not models/{name}; run `cargo xtask bundle`", copy.path)).collect()
}

#[test]
fn the_models_of_the_python_package_are_those_of_the_repository() {
    let files = repository::files();
    assert!(files.iter().any(|file| file.path.starts_with(COPIES)), "no model is bundled");
    assert_none(&stale(&files));
}

#[test]
fn a_copy_of_an_older_model_or_of_none_is_found() {
    let file = |path: &str, bytes: &[u8]| repository::File { path: path.to_owned(), bytes: bytes.to_owned() };
    let copy = format!("{COPIES}a.onnx");
    assert!(stale(&[file("models/a.onnx", b"1"), file(&copy, b"1")]).is_empty());
    assert_eq!(stale(&[file("models/a.onnx", b"2"), file(&copy, b"1")]).len(), 1);
    assert_eq!(stale(&[file("other/a.onnx", b"1"), file(&copy, b"1")]).len(), 1);
}

#[test]
fn models_are_limited_in_total_and_other_files_individually() {
    let half = MAX_MODEL_BYTES / 2;
    let fine =
        [("models/a.onnx", half), ("models/b.onnx", half), ("a", MAX_FILE_BYTES), ("b", MAX_FILE_BYTES)];
    assert!(too_heavy(fine.into_iter()).is_empty());
    assert_eq!(too_heavy([("models/a.onnx", half), ("models/b.onnx", half + 1)].into_iter()).len(), 1);
    assert_eq!(too_heavy([("a.mcap", MAX_FILE_BYTES + 1)].into_iter()).len(), 1);
}
