//! Python environments without a Python package manager: Debian's python3 has `venv` but no pip and no ensurepip, so
//! a bare environment is made and filled by pip run from its own pinned wheel.

use std::fs;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result};

use crate::run::{output, run, say};
use crate::{paths, wheels};

/// Says that an environment is complete; written last.
const STAMP: &str = "complete";

/// What is asked of an environment's interpreter before it is used again.
const IDENTITY: &str = "import sys; assert sys.version_info >= (3, 10), 'Python 3.10 or newer is needed'; \
                        print(sys.base_prefix, sys.version)";

/// The interpreter to begin with: `$PYTHON`, else python3.
pub(crate) fn system() -> PathBuf {
    std::env::var_os("PYTHON")
        .filter(|path| !path.is_empty())
        .map_or_else(|| "python3".into(), PathBuf::from)
}

/// The environment of the tests in `tests/python`: small clients of what nunetd writes and publishes.
pub(crate) fn test_environment() -> Result<PathBuf> {
    let requirements = "tests/python/requirements.txt";
    environment("test", &[requirements], &["--requirement", requirements])
}

/// The environment of `models/recipe`: torch and its libraries, several gigabytes. The recipe itself is not installed
/// in it but found by PYTHONPATH, so that clones with different recipes share one environment.
pub(crate) fn recipe_environment() -> Result<PathBuf> {
    environment(
        "recipe",
        &["models/recipe/pyproject.toml"],
        &["--only-deps", "./models/recipe[dev]"],
    )
}

/// A command that runs the recipe's modules.
pub(crate) fn recipe(python: &Path) -> Command {
    let mut command = Command::new(python);
    command.env("PYTHONPATH", paths::root().join("models/recipe"));
    command
}

/// The interpreter of an environment with what pip installs by `arguments`. It lies in the cache under a hash of
/// `files` and of the interpreter, and is made anew when that differs or when it was left half finished.
fn environment(name: &str, files: &[&str], arguments: &[&str]) -> Result<PathBuf> {
    let system = system();
    let identity = output(Command::new(&system).args(["-c", IDENTITY])).with_context(|| {
        format!(
            "`{}` is not usable\nhint: install python3, or name another by PYTHON",
            system.display()
        )
    })?;
    let folder = paths::cache()?.join(format!(
        "venv-{name}-{:016x}",
        fingerprint(&identity, files, arguments)?
    ));
    let python = folder.join("bin/python");
    let _lock = paths::lock()?;
    if folder.join(STAMP).is_file() && output(Command::new(&python).args(["-c", IDENTITY])).is_ok() {
        return Ok(python);
    }
    say(&format!(
        "setting up the Python environment `{name}` in {}",
        folder.display()
    ));
    create(&system, &folder, arguments)?;
    Ok(python)
}

fn fingerprint(identity: &str, files: &[&str], arguments: &[&str]) -> Result<u64> {
    let mut hasher = DefaultHasher::new(); // its keys are fixed, and a new algorithm costs one new environment
    (identity, arguments, wheels::pinned("pip")?.sha256).hash(&mut hasher);
    for file in files {
        let path = paths::root().join(file);
        fs::read(&path)
            .with_context(|| format!("cannot read `{}`", path.display()))?
            .hash(&mut hasher);
    }
    Ok(hasher.finish())
}

fn create(system: &Path, folder: &Path, arguments: &[&str]) -> Result<()> {
    let pip = pip()?;
    run(Command::new(system)
        .args(["-m", "venv", "--clear", "--without-pip"])
        .arg(folder))?;
    let mut install = Command::new(folder.join("bin/python"));
    install
        .arg(pip.join("pip"))
        .args(["install", "--disable-pip-version-check", "--no-input"])
        .args(arguments);
    if let (None, Some(index)) = (std::env::var_os("PIP_INDEX_URL"), uv_index()) {
        install.env("PIP_INDEX_URL", index);
    }
    run(&mut install)?;
    let stamp = folder.join(STAMP);
    fs::write(&stamp, "").with_context(|| format!("cannot write `{}`", stamp.display()))
}

/// pip's own wheel, a zip file that Python runs as it is.
fn pip() -> Result<PathBuf> {
    let wheel = wheels::pinned("pip")?;
    let path = paths::cache()?
        .join(format!("pip-{}", wheel.version))
        .join(wheel.file);
    wheels::fetch(&wheel, None, &path)?;
    Ok(path)
}

/// uv's index, which pip does not read, so that one setting serves both (as in `fetch_wheel.py`).
fn uv_index() -> Option<String> {
    let index = ["UV_DEFAULT_INDEX", "UV_INDEX_URL"]
        .iter()
        .find_map(|key| std::env::var(key).ok())?;
    let named = index
        .split_once('=')
        .filter(|(name, _)| !name.contains(['/', ':']));
    Some(named.map_or(index.clone(), |(_, url)| url.to_owned()))
}
