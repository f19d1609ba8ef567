//! The documents: links lead somewhere, the changelog is open, versions agree.

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

fn unreleased(changelog: &str) -> Vec<String> {
    let section = changelog.split("\n## ").find(|section| section.starts_with("[Unreleased]"));
    match section {
        None => vec!["CHANGELOG.md: no `## [Unreleased]` section".to_owned()],
        Some(section) if !section.contains("\n- ") => vec!["CHANGELOG.md: nothing is unreleased".to_owned()],
        Some(_) => Vec::new(),
    }
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
    let documents = repository::texts(|path| path.ends_with(".md"));
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
fn the_changelog_has_an_unreleased_section_with_an_entry() {
    let (_, changelog) = repository::texts(|path| path == "CHANGELOG.md").remove(0);
    assert_none(&unreleased(&changelog));
}

#[test]
fn a_changelog_without_an_entry_is_found() {
    assert_eq!(unreleased("# Changelog\n\n## [0.1.0]\n- x\n").len(), 1);
    assert_eq!(unreleased("# Changelog\n\n## [Unreleased]\n\n## [0.1.0]\n- x\n").len(), 1);
    assert!(unreleased("# Changelog\n\n## [Unreleased]\n### Added\n- x\n").is_empty());
}

#[test]
fn everybody_means_the_same_release_of_onnx_runtime() {
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
