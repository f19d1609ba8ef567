//! The documents: links are valid, lines narrow and paragraphs short, releases are dated, versions agree.

use std::collections::BTreeSet;

use crate::assert_none;
use crate::repository;

/// Markdown without code blocks and code spans; lines stay where they were.
fn prose(text: &str) -> String {
    let mut fenced = false;
    let mut prose = String::new();
    for line in text.lines() {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        if !fenced && !fence {
            let outside = line.split('`').step_by(2);
            prose.push_str(&outside.collect::<Vec<_>>().join("`"));
        }
        prose.push('\n');
    }
    prose
}

/// Line and target of each link that is not an address on the web.
fn local_links(text: &str) -> Vec<(usize, String)> {
    let mut links = Vec::new();
    for (index, line) in prose(text).lines().enumerate() {
        let inline = line.split("](").skip(1).filter_map(|rest| rest.split([')', ' ']).next());
        let reference =
            line.strip_prefix('[').and_then(|line| line.split_once("]: ")).map(|(_, target)| target.trim());
        for target in inline.chain(reference) {
            if !target.contains("://") && !target.starts_with("mailto:") {
                links.push((index + 1, target.to_owned()));
            }
        }
    }
    links
}

/// The anchors of a document's headings, as GitHub makes them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut fenced = false;
    let mut anchors = BTreeSet::new();
    for line in text.lines() {
        fenced ^= line.trim_start().starts_with("```");
        if fenced || !line.starts_with('#') {
            continue;
        }
        let heading = line.trim_start_matches('#').trim().to_lowercase();
        let kept = heading.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        anchors.insert(kept.map(|c| if c == ' ' { '-' } else { c }).collect());
    }
    anchors
}

/// `folder/../x` without the detour; `None` where it leaves the repository.
fn resolve(document: &str, target: &str) -> Option<String> {
    let folder = document.rsplit_once('/').map_or("", |(folder, _)| folder);
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in target.split('/') {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()?),
            part => parts.push(part),
        }
    }
    Some(parts.join("/"))
}

fn dead_links(document: &str, text: &str, read: impl Fn(&str) -> Option<String>) -> Vec<String> {
    let mut problems = Vec::new();
    for (line, target) in local_links(text) {
        let (file, anchor) = target.split_once('#').unwrap_or((&target, ""));
        let content = match file {
            "" => Some(text.to_owned()),
            file => resolve(document, file).and_then(|path| read(&path)),
        };
        match content {
            None => problems.push(format!("{document}:{line}: there is no `{target}`")),
            Some(content) if !anchor.is_empty() && !anchors(&content).contains(anchor) => {
                problems.push(format!("{document}:{line}: `{file}` has no heading `#{anchor}`"));
            }
            Some(_) => {}
        }
    }
    problems
}

/// The most lines of a release in the changelog, which describes the result and not its history.
const MAX_RELEASE_LINES: usize = 40;

/// Releases without a date, and releases that take too many lines.
fn bad_releases(changelog: &str) -> Vec<String> {
    let mut problems = Vec::new();
    let sections = changelog.split("\n## ").skip(1).filter(|section| !section.starts_with("[Unreleased]"));
    let mut releases = 0;
    for section in sections {
        releases += 1;
        let title = section.lines().next().unwrap_or_default();
        let date = title.rsplit_once(" - ").map_or("", |(_, date)| date);
        if date.len() != "2026-01-31".len() || date.split('-').count() != 3 {
            problems.push(format!("CHANGELOG.md: `{title}` has no date; expected `[VERSION] - YYYY-MM-DD`"));
        }
        if section.trim_end().lines().count() > MAX_RELEASE_LINES {
            problems.push(format!("CHANGELOG.md: `{title}` takes more than {MAX_RELEASE_LINES} lines"));
        }
    }
    if releases == 0 {
        problems.push("CHANGELOG.md: no release".to_owned());
    }
    problems
}

/// The lines of the README: everything else is in the book.
const MAX_README_LINES: usize = 150;

/// The lines of a paragraph or list item.
const MAX_PARAGRAPH_LINES: usize = 5;

/// Paragraphs and list items that are too long to be read at once. Tables, code and headings do not count.
fn long_paragraphs(document: &str, text: &str) -> Vec<String> {
    let (mut problems, mut length) = (Vec::new(), 0);
    let mut fenced = false;
    for (index, line) in text.lines().enumerate() {
        let start = line.trim_start();
        fenced ^= start.starts_with("```");
        let is_item = ["- ", "* "].iter().any(|mark| start.starts_with(mark))
            || start.split_once(". ").is_some_and(|(number, _)| number.parse::<u32>().is_ok());
        let is_text =
            !fenced && !start.is_empty() && !["|", "#", "```"].iter().any(|mark| start.starts_with(mark));
        length = if is_item {
            1
        } else if is_text {
            length + 1
        } else {
            0
        };
        if length == MAX_PARAGRAPH_LINES + 1 {
            problems.push(format!(
                "{document}:{}: a paragraph of more than {MAX_PARAGRAPH_LINES} lines",
                index + 1
            ));
        }
    }
    problems
}

/// The width of a document's lines, in characters.
const MAX_COLUMNS: usize = 110;

/// Lines that are too wide. Rows of tables and a line that is one link cannot be wrapped.
fn wide_lines(document: &str, text: &str) -> Vec<String> {
    let is_link = |line: &str| line.split_once("](").is_some_and(|(_, target)| !target.contains(' '));
    let is_wide = |line: &str| line.chars().count() > MAX_COLUMNS;
    let lines = text.lines().enumerate().filter(|(_, line)| {
        let start = line.trim_start();
        is_wide(line) && !start.starts_with('|') && !(start.starts_with(['[', '!']) && is_link(start))
    });
    lines.map(|(index, _)| format!("{document}:{}: more than {MAX_COLUMNS} columns", index + 1)).collect()
}

/// Versions written after `mark`, such as 1.2.3 in `onnxruntime==1.2.3`.
fn versions_after<'a>(mark: &str, text: &'a str) -> Vec<&'a str> {
    let rests = text.split(mark).skip(1);
    rests
        .map(|rest| {
            let end = rest.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(rest.len());
            rest[..end].trim_end_matches('.')
        })
        .filter(|version| version.contains('.'))
        .collect()
}

#[test]
fn links_between_documents_lead_to_files_and_headings_that_exist() {
    let documents = documents();
    let files = repository::files();
    let read = |path: &str| {
        let file = files.iter().find(|file| file.path == path);
        let folder = files.iter().any(|file| file.path.starts_with(&format!("{path}/")));
        file.map(|file| file.text().unwrap_or_default().to_owned()).or_else(|| folder.then(String::new))
    };
    let problems: Vec<String> =
        documents.iter().flat_map(|(path, text)| dead_links(path, text, read)).collect();
    assert_none(&problems);
}

#[test]
fn dead_links_are_found() {
    let read = |path: &str| (path == "docs/a.md").then(|| "# One, two\n".to_owned());
    let dead = "[x](b.md) ![y](../a.png)\n[z](a.md#three)\n[out](../../c.md)\n[ref]: gone.md";
    assert_eq!(dead_links("docs/index.md", dead, read).len(), 5);
    let fine = "# Here\n[x](a.md#one-two) [h](#here) [w](https://example.org/x)\n```\n[c](code.md)\n```\n`[s](span.md)`";
    assert_none(&dead_links("docs/index.md", fine, read));
}

#[test]
fn releases_in_the_changelog_are_dated_and_short() {
    let (_, changelog) = repository::texts(|path| path == "CHANGELOG.md").remove(0);
    assert_none(&bad_releases(&changelog));
}

#[test]
fn a_release_without_a_date_and_a_long_one_are_found() {
    assert_eq!(bad_releases("# Changelog\n\n## [0.1.0]\n- x\n").len(), 1);
    assert_eq!(bad_releases("# Changelog\n\n## [Unreleased]\n- x\n").len(), 1);
    let long = "- x\n".repeat(MAX_RELEASE_LINES);
    assert_eq!(bad_releases(&format!("# Changelog\n\n## [0.1.0] - 2026-01-31\n{long}")).len(), 1);
    assert_none(&bad_releases("# Changelog\n\n## [0.1.0] - 2026-01-31\n- x\n"));
}

/// All documents: those in `docs/`, of models and packages, and of the folders of crates.
fn documents() -> Vec<(String, String)> {
    repository::texts(|path| path.ends_with(".md"))
}

#[test]
fn paragraphs_have_5_lines_at_most() {
    let documents = documents();
    for place in ["README.md", "docs/book/", "models/", "dist/", "crates/", "CONTRIBUTING.md"] {
        assert!(documents.iter().any(|(path, _)| path.starts_with(place)), "no document in {place}");
    }
    let long = documents.iter().flat_map(|(path, text)| long_paragraphs(path, text));
    assert_none(&long.collect::<Vec<_>>());
}

#[test]
fn the_readme_has_150_lines_at_most() {
    let (_, readme) = repository::texts(|path| path == "README.md").remove(0);
    let lines = readme.lines().count();
    assert!(lines <= MAX_README_LINES, "README.md: {lines} lines; move something to the book");
}

#[test]
fn a_long_paragraph_is_found_and_a_table_is_none() {
    let line = "words and words\n";
    assert_none(&long_paragraphs("a.md", &line.repeat(MAX_PARAGRAPH_LINES)));
    assert_eq!(long_paragraphs("a.md", &line.repeat(MAX_PARAGRAPH_LINES + 1)).len(), 1);
    assert_eq!(long_paragraphs("a.md", &format!("- {}", line.repeat(MAX_PARAGRAPH_LINES + 1))).len(), 1);
    assert_eq!(long_paragraphs("a.md", &"`code` and words\n".repeat(MAX_PARAGRAPH_LINES + 1)).len(), 1);
    assert_none(&long_paragraphs("a.md", &"| a | b |\n".repeat(20)));
    assert_none(&long_paragraphs("a.md", &format!("```\n{}```\n", line.repeat(20))));
}

#[test]
fn lines_of_documents_have_110_columns_at_most() {
    let wide: Vec<String> = documents().iter().flat_map(|(path, text)| wide_lines(path, text)).collect();
    assert_none(&wide);
}

#[test]
fn a_wide_line_is_found_and_a_table_or_a_link_is_none() {
    let wide = "word ".repeat(23);
    assert_eq!(wide_lines("a.md", &format!("short\n{wide}\n")).len(), 1);
    assert_eq!(wide_lines("a.md", &format!("[{wide}](a.md) and more")).len(), 1);
    assert_none(&wide_lines("a.md", &format!("| {wide} |\n![{wide}](a.png)\n")));
}

#[test]
fn all_requirements_name_the_same_release_of_onnx_runtime() {
    let (_, lock) = repository::texts(|path| path == "xtask/wheels.lock").remove(0);
    let lines = lock.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
    let pinned: BTreeSet<&str> =
        lines.filter(|words| words.get(1) == Some(&"onnxruntime")).map(|words| words[2]).collect();
    assert_eq!(pinned.len(), 1, "{pinned:?}");
    let mut problems = Vec::new();
    for (path, text) in repository::texts(|path| path.ends_with(".txt") || path.ends_with(".toml")) {
        for version in
            versions_after("onnxruntime==", &text).into_iter().filter(|version| !pinned.contains(version))
        {
            problems.push(format!("{path}: onnxruntime {version}, xtask/wheels.lock has {pinned:?}"));
        }
    }
    assert_none(&problems);
}

#[test]
fn versions_are_read_after_their_mark() {
    assert_eq!(versions_after("thing==", "thing==1.2.3\nother==4\nthing==1.2.\n"), ["1.2.3", "1.2"]);
}
