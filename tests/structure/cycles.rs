//! No crate has an import cycle between its modules.
//!
//! Each folder is checked by itself: its modules are the nodes, a subfolder counts as one module, and a path
//! such as `crate::depth::Units` is an edge between the modules in which its two ends lie below their common
//! folder. A name that a folder's root re-exports (`pub use child::Name`) stands for the child. Whatever else
//! the root contains belongs to the folder as a whole: children may name it.

use std::collections::{BTreeMap, BTreeSet};

use crate::assert_none;
use crate::repository;
use crate::rust_source::{is_test_file, paths, without_tests};

/// Cycles that still exist. The list may only shrink; the goal is an empty one.
const KNOWN: [&str; 0] = [];

/// A module: its path below the crate's root, such as `["depth", "decode"]`.
type Module = Vec<String>;

/// The modules of a crate and which of them each names.
struct Graph {
    modules: BTreeSet<Module>,
    /// For each module the names that it takes from others, each with the full path below the crate's root.
    named: BTreeMap<Module, Vec<Vec<String>>>,
}

/// The module that a file is, below the `src` folder of its crate; the root is empty.
fn module_of(path: &str) -> Module {
    let path = path.trim_end_matches(".rs");
    let mut segments: Module = path.split('/').map(str::to_owned).collect();
    if matches!(segments.last().map(String::as_str), Some("mod" | "lib" | "main")) {
        segments.pop();
    }
    segments
}

impl Graph {
    /// `sources`: paths below `src`, and texts.
    fn new<'a>(sources: impl Iterator<Item = (&'a str, &'a str)>) -> Self {
        let mut graph = Self { modules: BTreeSet::new(), named: BTreeMap::new() };
        for (path, text) in sources {
            let module = module_of(path);
            let named = paths(&without_tests(text));
            let targets = named.into_iter().filter_map(|path| absolute(&module, &path.segments));
            graph.named.entry(module.clone()).or_default().extend(targets);
            graph.modules.insert(module);
        }
        graph
    }

    /// The module in which a name is, through at most a few re-exports.
    fn home(&self, name: &[String]) -> Module {
        let mut name = name.to_vec();
        for _ in 0..4 {
            let longest = (0..=name.len()).rev().find(|&length| self.modules.contains(&name[..length]));
            let module = name[..longest.unwrap_or(0)].to_vec();
            let Some(item) = name.get(module.len()) else { return module };
            let inside =
                |target: &&Vec<String>| target.len() > module.len() + 1 && target.starts_with(&module);
            let exported = self.named.get(&module).into_iter().flatten();
            match exported.filter(inside).find(|target| target.last() == Some(item)) {
                Some(target) => name = target.clone(),
                None => return module,
            }
        }
        name
    }

    /// For each folder: which of its modules name which.
    fn edges(&self) -> BTreeMap<Module, BTreeMap<String, BTreeSet<String>>> {
        let mut folders: BTreeMap<Module, BTreeMap<String, BTreeSet<String>>> = BTreeMap::new();
        for (module, names) in &self.named {
            for target in names.iter().map(|name| self.home(name)) {
                let common = module.iter().zip(&target).take_while(|(a, b)| a == b).count();
                if let (Some(from), Some(to)) = (module.get(common), target.get(common)) {
                    let folder = folders.entry(module[..common].to_vec()).or_default();
                    folder.entry(from.clone()).or_default().insert(to.clone());
                }
            }
        }
        folders
    }

    /// The groups of modules of one folder that import each other in a circle.
    fn cycles(&self) -> Vec<String> {
        let mut found = Vec::new();
        for (folder, edges) in self.edges() {
            let reached: BTreeMap<&String, BTreeSet<&String>> =
                edges.keys().map(|from| (from, reachable(&edges, from))).collect();
            let mut done = BTreeSet::new();
            for (from, ends) in &reached {
                if done.contains(from) || !ends.contains(from) {
                    continue;
                }
                let back = |to: &&&String| reached.get(**to).is_some_and(|ends| ends.contains(*from));
                let group: Vec<&str> = ends.iter().filter(back).map(|name| name.as_str()).collect();
                done.extend(ends.iter().filter(back).copied());
                found.push(format!(
                    "{}{{{}}}",
                    folder.iter().map(|f| format!("{f}::")).collect::<String>(),
                    group.join(", ")
                ));
            }
        }
        found
    }
}

/// Everything that can be reached from a module in one step or more.
fn reachable<'a>(edges: &'a BTreeMap<String, BTreeSet<String>>, from: &str) -> BTreeSet<&'a String> {
    let mut reached = BTreeSet::new();
    let mut open: Vec<&String> = edges.get(from).into_iter().flatten().collect();
    while let Some(next) = open.pop() {
        if reached.insert(next) {
            open.extend(edges.get(next).into_iter().flatten());
        }
    }
    reached
}

/// A path as seen from the crate's root; `None` for one that leads out of the crate.
fn absolute(module: &[String], segments: &[String]) -> Option<Vec<String>> {
    let first = segments.first()?;
    match first.as_str() {
        "crate" => Some(segments[1..].to_vec()),
        "self" => Some(module.iter().chain(&segments[1..]).cloned().collect()),
        "super" => {
            let ups = segments.iter().take_while(|segment| *segment == "super").count();
            let parent = module.get(..module.len().checked_sub(ups)?)?;
            Some(parent.iter().chain(&segments[ups..]).cloned().collect())
        }
        // `pub use child::Name`: the folder's own module, if there is one of that name; `home` finds out.
        _ if segments.len() > 1 => Some(module.iter().chain(segments).cloned().collect()),
        _ => None,
    }
}

/// The crates of the workspace: the folder of each one's sources.
fn crates(sources: &[(String, String)]) -> BTreeSet<String> {
    let folders = sources.iter().filter_map(|(path, _)| Some(path.split_once("/src/")?.0.to_owned()));
    folders.filter(|folder| !folder.contains('/') || folder.starts_with("crates/")).collect()
}

#[test]
fn no_crate_has_an_import_cycle() {
    let mut sources = repository::rust();
    sources.retain(|(path, _)| !is_test_file(path));
    let mut found = Vec::new();
    for folder in crates(&sources) {
        let prefix = format!("{folder}/src/");
        let own =
            sources.iter().filter_map(|(path, text)| Some((path.strip_prefix(&prefix)?, text.as_str())));
        found.extend(Graph::new(own).cycles().into_iter().map(|cycle| format!("{folder}: {cycle}")));
    }
    let new = found.iter().filter(|cycle| !KNOWN.contains(&cycle.as_str())).cloned();
    let gone = KNOWN.iter().filter(|known| !found.iter().any(|cycle| cycle == *known));
    let gone = gone.map(|known| format!("{known} is gone: remove it from KNOWN"));
    assert_none(&new.chain(gone).collect::<Vec<_>>());
}

#[test]
fn planted_cycles_are_found() {
    let cycles = |sources: &[(&str, &str)]| Graph::new(sources.iter().copied()).cycles();
    let lib = ("lib.rs", "mod a;\nmod b;\nmod c;\npub use b::Thing;\n");
    assert_eq!(cycles(&[lib, ("a.rs", "use crate::b::X;"), ("b.rs", "use crate::a::Y;")]), ["{a, b}"]);
    assert_eq!(cycles(&[lib, ("a.rs", "use super::b;"), ("b.rs", "fn f() { super::a::g() }")]), ["{a, b}"]);
    assert_eq!(
        cycles(&[lib, ("a.rs", "use crate::Thing;"), ("b.rs", "use crate::a::Y;")]),
        ["{a, b}"],
        "a re-export"
    );
    let three =
        [("a.rs", "use crate::{b, other};"), ("b.rs", "use crate::c::d::X;"), ("c/d.rs", "use crate::a;")];
    let three = [lib, ("c/mod.rs", "mod d;"), three[0], three[1], three[2]];
    assert_eq!(cycles(&three), ["{a, b, c}"]);
    let inside =
        [("c/mod.rs", "mod d;\nmod e;"), ("c/d.rs", "use super::e::X;"), ("c/e.rs", "use crate::c::d;")];
    assert_eq!(cycles(&inside), ["c::{d, e}"]);
}

#[test]
fn imports_in_one_direction_or_of_a_parent_are_no_cycle() {
    let sources = [
        ("lib.rs", "mod a;\nmod b;\npub use a::X;\npub struct Root;"),
        ("a.rs", "use crate::Root;\nuse std::fmt;\n#[cfg(test)]\nmod tests { use crate::b::Y; }"),
        ("b/mod.rs", "mod c;\nuse crate::a::X;\npub use c::Y;\npub struct Folder;"),
        ("b/c.rs", "use super::Folder;\nuse crate::a::X;\n// use crate::b\n"),
    ];
    assert_eq!(Graph::new(sources.into_iter()).cycles(), Vec::<String>::new());
}
