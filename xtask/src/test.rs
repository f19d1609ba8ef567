//! `cargo xtask test`: every test, Rust and Python.

use std::process::Command;

use anyhow::Result;

use crate::run::{cargo, run_all};
use crate::{paths, python, setup};

/// Set up, then run everything, also after a failure.
pub(crate) fn test() -> Result<()> {
    setup::onnxruntime()?;
    let light = python::test_environment()?;
    let heavy = python::recipe_environment()?;

    let mut lint = Command::new(&light);
    lint.args(["-m", "ruff", "check", "."]);
    let mut clients = Command::new(&light);
    clients
        .args(["-m", "pytest", "-q", "tests/python"])
        .env("NUNETD", paths::nunetd("debug")?);
    let mut recipe = python::recipe(&heavy);
    recipe.args(["-m", "pytest", "-q", "models/recipe/tests"]);
    run_all(
        "test",
        &mut [
            ("nunetd", cargo(&["build", "--package", "nunet-daemon"])),
            ("Rust", cargo(&["test", "--workspace", "--no-fail-fast"])),
            ("Python lint", lint),
            ("Python clients", clients),
            ("recipe", recipe),
        ],
    )
}
