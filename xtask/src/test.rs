//! `cargo xtask test`: all tests, Rust and Python.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::process::Command;

use anyhow::Result;

use crate::run::{cargo, run_all, say};
use crate::{package, paths, python, setup};

/// Sets up, then runs every part, also after a failure.
pub(crate) fn test() -> Result<()> {
    setup::onnxruntime()?;
    let light = package::built()?;
    let heavy = python::recipe_environment()?;

    let mut lint = Command::new(&light);
    lint.args(["-m", "ruff", "check", "."]);
    let mut clients = Command::new(&light);
    clients.args(["-m", "pytest", "-q", "-rs", "tests/python"]).env("NUNETD", paths::nunetd("debug")?);
    let mut recipe = python::recipe(&heavy);
    recipe.args(["-m", "pytest", "-q", "models/recipe/tests"]);
    let mut parts = vec![
        // It leaves `nunetd` and, in `deps`, `libnunet.a` and `libnunet.so` for the parts after it: cargo
        // builds a crate's binary and libraries for its integration tests. A build of its own would choose
        // other features and compile half of the dependencies again.
        ("Rust", cargo(&["test", "--workspace", "--no-fail-fast"])),
        ("Python lint", lint),
        ("Python clients", clients),
        ("recipe", recipe),
    ];
    if is_root() {
        // The same packages as above, so that nothing is compiled again.
        parts.push(("Rust as root", cargo(&["test", "--workspace", "--test", "daemon", "--", "--ignored"])));
    } else {
        say(
            "test: not root: the parts that need root are skipped (tests marked `needs root`; pytest lists the others)",
        );
    }
    run_all("test", &mut parts)
}

/// Whether this process belongs to root.
fn is_root() -> bool {
    fs::metadata("/proc/self").is_ok_and(|process| process.uid() == 0)
}
