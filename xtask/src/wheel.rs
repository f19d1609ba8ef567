//! `cargo xtask wheel`: the Python package as a wheel, and everything that an installation without a network
//! needs.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};

use crate::run::{output, run, say};
use crate::{paths, python};

const FOLDER: &str = "dist";
const MANIFEST: &str = "crates/nunet-py/Cargo.toml";
const MODELS: &str = "crates/nunet-py/python/nunet_py/models";
const PREFIX: &str = "nunet_py-";

/// Of the wheel without its models, packed.
const MAX_BYTES: u64 = 20_000_000;

/// A first use of the wheel: in a folder without a checkout, with a bundled model.
const TRIAL: &str = "import numpy as np, nunet_py as nunet
result = nunet.Model('wnet_c.onnx').infer(np.zeros((480, 640, 3), np.uint8))
assert result.depth.shape == (480, 640) and result.cloud().points.shape == (480, 640, 3)
print(nunet.__version__, nunet.__file__)";

/// Other wheels than ours are made for one version of Python: those that are gathered are for this one.
const VERSION: &str = "import sys; print(*sys.version_info[:2], sep='.')";

/// Build, check, gather, try.
pub(crate) fn wheel() -> Result<()> {
    let tools = python::wheel_environment()?;
    let folder = paths::root().join(FOLDER);
    remove_older(&folder)?;
    let mut maturin = Command::new(tools.with_file_name("maturin"));
    run(maturin.args([
        "build",
        "--release",
        "--strip",
        "--locked",
        "--out",
        FOLDER,
        "--manifest-path",
        MANIFEST,
    ]))?;
    let wheel = ours(&folder)?.pop().context("maturin left no wheel")?;
    check_size(&wheel)?;
    run(Command::new(tools.with_file_name("abi3audit")).args(["--strict", "--verbose"]).arg(&wheel))?;
    // By its path: by its name an index would offer another project's package.
    run(python::pip_of(&tools, &["download", "--only-binary", ":all:", "--dest", FOLDER])?.arg(&wheel))?;
    try_out(&folder)?;
    let version = output(Command::new(&tools).args(["-c", VERSION]))?;
    say(&format!(
        "wheel: {}; `pip install nunet-py --no-index --find-links {FOLDER}` installs it with Python {} and {}",
        wheel.display(),
        version.trim(),
        c_library(&wheel)
    ));
    Ok(())
}

/// The C library that a wheel's name asks for: maturin writes there what its library needs of this machine's.
fn c_library(wheel: &Path) -> String {
    let name = wheel.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let tag = name.split("-manylinux_").nth(1).and_then(|rest| {
        let mut numbers = rest.split('_');
        Some(format!("glibc {}.{} or newer", numbers.next()?, numbers.next()?))
    });
    tag.unwrap_or_else(|| "this machine's C library".to_owned())
}

/// Our wheels in `folder`.
fn ours(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read `{}`", folder.display()))?;
    let paths = entries.flatten().map(|entry| entry.path());
    let named = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        name.starts_with(PREFIX) && name.ends_with(".whl")
    };
    Ok(paths.filter(named).collect())
}

/// An older wheel must not be taken for the one that is made now.
fn remove_older(folder: &Path) -> Result<()> {
    for path in ours(folder)? {
        fs::remove_file(&path).with_context(|| format!("cannot remove `{}`", path.display()))?;
    }
    Ok(())
}

fn check_size(wheel: &Path) -> Result<()> {
    let bytes = |path: &Path| fs::metadata(path).map(|about| about.len());
    let models =
        fs::read_dir(paths::root().join(MODELS)).with_context(|| format!("cannot read `{MODELS}`"))?;
    let models: u64 = models.flatten().filter_map(|entry| bytes(&entry.path()).ok()).sum();
    let all = bytes(wheel).with_context(|| format!("cannot read `{}`", wheel.display()))?;
    // Weights hardly shrink when packed, so this is a little less than the rest.
    let rest = all.saturating_sub(models);
    say(&format!("wheel: {:.1} MB, {:.1} MB without its models", all as f64 / 1e6, rest as f64 / 1e6));
    ensure!(rest <= MAX_BYTES, "the wheel has {rest} bytes without its models, {MAX_BYTES} at most");
    Ok(())
}

/// Installs from `dist` alone into a new environment, and uses it in another folder.
fn try_out(folder: &Path) -> Result<()> {
    let target = paths::target()?.join("wheel-trial");
    let python = python::bare_environment(&target)?;
    let mut install = python::pip_of(&python, &["install", "--no-index", "nunet-py"])?;
    run(install.arg("--find-links").arg(folder))?;
    let mut trial = Command::new(&python);
    trial.args(["-c", TRIAL]).current_dir(&target);
    let imported = output(&mut trial).context("the installed package does not work")?;
    let mut command = Command::new(python.with_file_name("nunetd"));
    let version = output(command.arg("--version").current_dir(&target))?;
    say(&format!("wheel: tried in a new environment: {}, {}", imported.trim(), version.trim()));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_of_a_wheel_states_its_c_library() {
        let of = |name: &str| c_library(Path::new(name));
        let tagged = "dist/nunet_py-0.1.0-cp310-abi3-manylinux_2_34_x86_64.whl";
        assert_eq!(of(tagged), "glibc 2.34 or newer");
        assert_eq!(
            of("nunet_py-0.1.0-cp310-abi3-manylinux_2_17_x86_64.manylinux2014_x86_64.whl"),
            "glibc 2.17 or newer"
        );
        assert_eq!(of("nunet_py-0.1.0-cp310-abi3-linux_x86_64.whl"), "this machine's C library");
    }
}
