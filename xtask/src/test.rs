//! `cargo xtask test`: every test, Rust and Python.

use std::process::Command;

use anyhow::Result;

use crate::run::{cargo, run_all};
use crate::{package, paths, python, setup};

/// Set up, then run everything, also after a failure.
pub(crate) fn test() -> Result<()> {
    setup::onnxruntime()?;
    let light = package::built()?;
    let heavy = python::recipe_environment()?;

    let mut lint = Command::new(&light);
    lint.args(["-m", "ruff", "check", "."]);
    let mut clients = Command::new(&light);
    clients.args(["-m", "pytest", "-q", "tests/python"]).env("NUNETD", paths::nunetd("debug")?);
    let mut recipe = python::recipe(&heavy);
    recipe.args(["-m", "pytest", "-q", "models/recipe/tests"]);
    run_all(
        "test",
        &mut [
            // It leaves `nunetd` and, in `deps`, `libnunet.a` and `libnunet.so` for the steps after it: cargo builds a
            // crate's binary and libraries for its integration tests. A build of its own would choose other features
            // and compile half of the dependencies again.
            ("Rust", cargo(&["test", "--workspace", "--no-fail-fast"])),
            ("Python lint", lint),
            ("Python clients", clients),
            ("recipe", recipe),
        ],
    )
}
