//! Paths of one machine and hosts of registries must not be in any file.

use crate::assert_none;
use crate::repository;

/// Beginnings of paths in a user's home or workplace. Spelled in two halves: this file is searched too.
const MACHINE_PATHS: [(&str, &str); 4] = [("/ro", "ot/"), ("/wo", "rk/"), ("/ho", "me/"), ("/Us", "ers/")];

/// Hosts of package registries: the configured index decides.
const HOSTS: [(&str, &str); 7] = [
    ("py", "pi.org"),
    ("python", "hosted.org"),
    ("static.", "crates.io"),
    ("index.", "crates.io"),
    ("registry.", "npmjs.org"),
    ("deb.", "debian.org"),
    ("proxy.", "golang.org"),
];

/// The one file that must know the public index: it is the default where nothing is configured.
const KNOWS_PUBLIC_INDEX: &str = "xtask/fetch_wheel.py";

fn places(path: &str, text: &str) -> Vec<String> {
    let mut problems = Vec::new();
    for (index, line) in text.lines().enumerate() {
        for mark in MACHINE_PATHS.map(|(head, tail)| format!("{head}{tail}")) {
            // Below a folder of the repository the same word is harmless.
            let absolute =
                |at: usize| !line[..at].ends_with(|c: char| c.is_alphanumeric() || "._-})*~".contains(c));
            if line.match_indices(&mark).any(|(at, _)| absolute(at)) {
                problems.push(format!("{path}:{}: a path of one machine: `{mark}`", index + 1));
            }
        }
        for host in HOSTS.map(|(head, tail)| format!("{head}{tail}")) {
            if line.contains(&host) && path != KNOWS_PUBLIC_INDEX {
                problems.push(format!("{path}:{}: a registry's host: `{host}`", index + 1));
            }
        }
    }
    problems
}

#[test]
fn no_file_names_a_path_of_one_machine_or_a_registry_s_host() {
    let files = repository::files();
    let texts = files.iter().filter_map(|file| Some((file.path.as_str(), file.text()?)));
    let problems: Vec<String> = texts.flat_map(|(path, text)| places(path, text)).collect();
    assert_none(&problems);
}

#[test]
fn machine_paths_and_hosts_are_found() {
    for (head, tail) in MACHINE_PATHS.into_iter().chain(HOSTS) {
        assert_eq!(places("a.md", &format!("see {head}{tail}x")).len(), 1, "{head}{tail}");
    }
    let (head, tail) = MACHINE_PATHS[1];
    assert!(places("a.md", &format!("docs{head}{tail}x")).is_empty());
}
