//! Puts the commit into release builds, for `nunetd --version`.
//!
//! Asked in this order: the variable `NUNET_COMMIT` (builds without a repository, such as the container's),
//! the file that `cargo package` leaves, git. Builds of other profiles carry no commit, so that a commit does
//! not recompile them.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-env-changed=NUNET_COMMIT");
    println!("cargo::rerun-if-changed=build.rs");
    let commit = from_environment().or_else(from_package).or_else(from_git);
    let commit = commit.unwrap_or_else(|| "unknown commit".to_owned());
    println!("cargo::rustc-env=NUNET_COMMIT={commit}");
}

fn from_environment() -> Option<String> {
    std::env::var("NUNET_COMMIT").ok().filter(|commit| !commit.is_empty())
}

/// `{ "git": { "sha1": "..." }, ... }`
fn from_package() -> Option<String> {
    let text = std::fs::read_to_string(".cargo_vcs_info.json").ok()?;
    let hash = text.split("\"sha1\": \"").nth(1)?.split('"').next()?;
    Some(hash.chars().take(12).collect())
}

fn from_git() -> Option<String> {
    if std::env::var("PROFILE").as_deref() != Ok("release") {
        return Some("development build".to_owned());
    }
    for name in ["HEAD", "index"] {
        let path = git(&["rev-parse", "--git-path", name])?;
        if Path::new(&path).exists() {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let is_changed = !git(&["status", "--porcelain", "--untracked-files=no"])?.is_empty();
    Some(commit + if is_changed { ", changed" } else { "" })
}

fn git(arguments: &[&str]) -> Option<String> {
    let output =
        Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
