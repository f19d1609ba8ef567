//! The files of the repository, as git sees them.

use std::fs;
use std::path::Path;
use std::process::Command;

/// A file that is tracked, or would be by `git add --all`.
pub(crate) struct File {
    /// From the root, with `/`.
    pub(crate) path: String,
    pub(crate) bytes: Vec<u8>,
}

impl File {
    /// The text, or `None` for images, models and the like.
    pub(crate) fn text(&self) -> Option<&str> {
        if self.bytes.contains(&0) { None } else { str::from_utf8(&self.bytes).ok() }
    }
}

/// The checkout.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("xtask is a folder of the checkout")
}

/// All files, by path. New files count before they are added, so that a check fails before the commit.
pub(crate) fn files() -> Vec<File> {
    let output = Command::new("git")
        .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"])
        .current_dir(root())
        .output()
        .expect("these tests ask git for the list of files");
    assert!(output.status.success(), "git ls-files: {}", String::from_utf8_lossy(&output.stderr));
    let list = String::from_utf8(output.stdout).expect("file names are UTF-8 here");
    let mut paths: Vec<&str> = list.split_terminator('\0').collect();
    paths.sort_unstable();
    paths.dedup();
    let present = paths.into_iter().filter(|path| root().join(path).is_file()); // not yet committed deletions
    let files: Vec<File> = present
        .map(|path| File {
            path: path.to_owned(),
            bytes: fs::read(root().join(path)).expect("a file that git lists can be read"),
        })
        .collect();
    assert!(files.iter().any(|file| file.path == "Cargo.toml"), "git lists no Cargo.toml");
    files
}

/// Paths and texts of all files that `wanted` accepts; there must be some.
pub(crate) fn texts(wanted: impl Fn(&str) -> bool) -> Vec<(String, String)> {
    let chosen: Vec<_> = files()
        .iter()
        .filter(|file| wanted(&file.path))
        .filter_map(|file| Some((file.path.clone(), file.text()?.to_owned())))
        .collect();
    assert!(!chosen.is_empty(), "no file was found to check");
    chosen
}

/// All Rust sources of the workspace.
pub(crate) fn rust() -> Vec<(String, String)> {
    texts(|path| path.ends_with(".rs"))
}
