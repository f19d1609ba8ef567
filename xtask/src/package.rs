//! The Python package as the tests use it: in an environment of this checkout's own, over the shared one.
//!
//! Laid out by hand and not by maturin, which builds the crate alone: with other features than `cargo test`
//! has, so that half of the dependencies would be compiled twice. What maturin makes is for
//! `cargo xtask wheel`.

use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

use crate::run::{cargo, print, run};
use crate::{paths, python, setup};

const SOURCE: &str = "crates/nunet-py/python/nunet_py";
const EXECUTABLE: u32 = 0o755;

/// Builds and lays out the package, and prints the interpreter.
pub(crate) fn package() -> Result<()> {
    setup::onnxruntime()?;
    print(&built()?.display().to_string());
    Ok(())
}

/// The interpreter that has the package, built in debug.
pub(crate) fn built() -> Result<PathBuf> {
    // A test among the targets makes cargo choose the features that `cargo test --workspace` has.
    run(&mut cargo(&["build", "--workspace", "--lib", "--bins", "--test", "structure"]))?;
    let target = paths::target()?;
    let layer = python::layer_over(&python::test_environment()?, &target.join("python"))?;
    lay_out(&layer, &target.join("debug/lib_native.so"))
        .with_context(|| format!("cannot lay out the package in `{}`", layer.packages.display()))?;
    Ok(layer.python)
}

fn lay_out(layer: &python::Layer, library: &Path) -> std::io::Result<()> {
    let package = layer.packages.join("nunet_py");
    if package.exists() {
        // A file that is gone from the source must not linger.
        fs::remove_dir_all(&package)?;
    }
    copy(&paths::root().join(SOURCE), &package)?;
    symlink(library, package.join("_native.abi3.so"))?;
    let command = layer.python.with_file_name("nunetd");
    let script = "from nunet_py.__main__ import main\nmain()\n";
    fs::write(&command, format!("#!{}\n{script}", layer.python.display()))?;
    fs::set_permissions(&command, fs::Permissions::from_mode(EXECUTABLE))
}

fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let (entry, kind) = entry.and_then(|entry| Ok((entry.path(), entry.file_type()?)))?;
        let Some(name) = entry.file_name().filter(|name| *name != "__pycache__") else { continue };
        if kind.is_dir() {
            copy(&entry, &to.join(name))?;
        } else if entry.extension().is_none_or(|ending| ending != "so") {
            fs::copy(&entry, to.join(name))?;
        }
    }
    Ok(())
}
