//! Packed files exist: `cargo xtask check` builds neither the Debian package nor the container.

use crate::assert_none;
use crate::repository::{root, texts};

const MANIFEST: &str = "crates/nunet-daemon/Cargo.toml";
const CONTAINER: &str = "dist/Containerfile";

#[test]
fn every_file_of_the_debian_package_is_there() {
    assert_none(&missing(&packed(&text_of(MANIFEST))));
}

#[test]
fn every_file_that_the_container_copies_is_there() {
    assert_none(&missing(&copied(&text_of(CONTAINER))));
}

#[test]
fn a_renamed_file_is_reported_missing() {
    let assets = "assets = [\n    [\"../../README.md\", \"usr/\"],\n    [\"../../gone.md\", \"usr/\"],\n    [\"../../build/deb/lib/*\", \"x\"],\n]";
    assert_eq!(packed(assets), ["README.md", "gone.md"]);
    assert_eq!(copied("COPY . .\nCOPY --from=build /src/gone.md /src/target/x /usr/"), ["gone.md"]);
    assert_eq!(missing(&["README.md".into(), "gone.md".into()]), ["no `gone.md`, which is packed"]);
}

#[test]
fn releases_are_stripped() {
    assert_none(&unstripped(&text_of("Cargo.toml")));
}

#[test]
fn a_release_with_symbols_is_found() {
    assert!(
        unstripped("[profile.release]\ndebug = false\nstrip = \"symbols\"\n\n[profile.dev]\n").is_empty()
    );
    assert_eq!(unstripped("[profile.release]\nlto = true\n[profile.x]\ndebug = false\n").len(), 2);
    assert_eq!(unstripped("[profile.dev]\ndebug = false\nstrip = \"symbols\"\n").len(), 2);
}

#[test]
fn every_published_crate_can_be_found_in_a_registry() {
    let manifests = texts(|path| path.starts_with("crates/") && path.ends_with("Cargo.toml"));
    let problems = manifests.iter().flat_map(|(path, text)| undescribed(path, text));
    assert_none(&problems.collect::<Vec<_>>());
}

#[test]
fn a_published_crate_without_keywords_is_found() {
    let complete = "[package]\ndescription = \"x\"\nlicense.workspace = true\nreadme.workspace = true\n\
                    keywords.workspace = true\ncategories.workspace = true\n";
    assert!(undescribed("a", complete).is_empty());
    assert_eq!(undescribed("a", &complete.replace("keywords", "authors")), ["a: no `keywords`"]);
    assert!(undescribed("a", "[package]\npublish = false\n").is_empty());
}

/// Settings of the release profile that are missing. Without them, nunetd, the Python extension and
/// libnunet.a took 70 to 80 MB each.
fn unstripped(manifest: &str) -> Vec<String> {
    let profile = manifest.split("[profile.release]\n").nth(1).unwrap_or_default();
    let lines: Vec<_> = profile.lines().take_while(|line| !line.starts_with('[')).collect();
    let missing = ["debug = false", "strip = \"symbols\""].into_iter().filter(|line| !lines.contains(line));
    missing.map(|line| format!("Cargo.toml: `[profile.release]` has no `{line}`")).collect()
}

fn undescribed(path: &str, manifest: &str) -> Vec<String> {
    if manifest.contains("\npublish = false\n") {
        return Vec::new();
    }
    let has = |key: &str| manifest.lines().any(|line| line.split(['.', ' ', '=']).next() == Some(key));
    let keys = ["description", "license", "readme", "keywords", "categories"];
    keys.into_iter().filter(|key| !has(key)).map(|key| format!("{path}: no `{key}`")).collect()
}

fn text_of(path: &str) -> String {
    texts(|name| name == path).pop().unwrap_or_else(|| panic!("no `{path}`")).1
}

/// Files of the repository among the Debian package's assets; `cargo xtask deb` makes the others.
fn packed(manifest: &str) -> Vec<String> {
    let assets = manifest.split("assets = [").nth(1).and_then(|rest| rest.split("\n]").next());
    let sources = assets.unwrap_or_default().lines().filter_map(|line| line.split('"').nth(1));
    let ours = sources.filter_map(|source| source.strip_prefix("../../"));
    ours.filter(|source| !source.starts_with("build/")).map(str::to_owned).collect()
}

/// Files of the repository that reach the container's last stage.
fn copied(container: &str) -> Vec<String> {
    let lines = container.lines().filter(|line| line.starts_with("COPY --from=build"));
    let ours = lines.flat_map(str::split_whitespace).filter_map(|word| word.strip_prefix("/src/"));
    ours.filter(|source| !source.starts_with("target/")).map(str::to_owned).collect()
}

fn missing(sources: &[String]) -> Vec<String> {
    // A folder, or all files of one.
    let gone = sources.iter().filter(|source| !root().join(source.trim_end_matches("/*")).exists());
    let mut problems: Vec<_> = gone.map(|source| format!("no `{source}`, which is packed")).collect();
    if sources.is_empty() {
        problems.push("nothing is packed: the check reads what is no longer written so".to_owned());
    }
    problems
}
