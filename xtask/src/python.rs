//! Python environments without a Python package manager: Debian's python3 has `venv` but no pip and no
//! ensurepip, so a bare environment is made and filled by pip run from its own pinned wheel.

use std::fs;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use anyhow::{Context as _, Result};

use crate::hinted::Hinted;
use crate::interpreter::{self, IDENTITY};
use crate::run::{cargo, output, run, say};
use crate::{paths, setup, wheels};

/// Says that an environment is complete; written last.
const STAMP: &str = "complete";

/// Names a package index with CPU builds of torch.
const TORCH_INDEX: &str = "NUNET_TORCH_INDEX";

/// An environment that was not used for this long belongs to old requirements.
const FORGOTTEN_AFTER: Duration = Duration::from_hours(30 * 24);

/// Prints the recipe's dependencies, a line each: pip could install them by `--only-deps`, but a change
/// elsewhere in that file must not require a new environment.
const RECIPE_REQUIREMENTS: &str = "import tomllib
with open('models/recipe/pyproject.toml', 'rb') as file:
    project = tomllib.load(file)['project']
print(*project['dependencies'], *project['optional-dependencies']['dev'], sep='\\n')";

/// The environment of the tests in `tests/python`: small clients of what nunetd writes and publishes.
pub(crate) fn test_environment() -> Result<PathBuf> {
    required_by("test", "tests/python/requirements.txt")
}

/// The environment of the tests in `tests/browser`.
pub(crate) fn browser_environment() -> Result<PathBuf> {
    required_by("browser", "tests/browser/requirements.txt")
}

/// The environment of the tests in `tests/ros2`: ROS 2 itself.
pub(crate) fn ros2_environment() -> Result<PathBuf> {
    required_by_with(&interpreter::python311()?, "ros2", "tests/ros2/requirements.txt")
}

/// The environment of the tests in `tests/rerun`.
pub(crate) fn rerun_environment() -> Result<PathBuf> {
    required_by("rerun", "tests/rerun/requirements.txt")
}

/// Builds nunetd; pytest for a folder of tests that run it.
pub(crate) fn tests_of_nunetd(python: &Path, folder: &str) -> Result<Command> {
    setup::onnxruntime()?;
    // A test among the targets makes cargo choose the features that `cargo test --workspace` has.
    run(&mut cargo(&["build", "--workspace", "--bins", "--test", "structure"]))?;
    let mut pytest = Command::new(python);
    pytest.args(["-m", "pytest", "-q", "-rs", "-s", "-p", "no:cacheprovider", folder]);
    pytest.current_dir(paths::root()).env("NUNETD", paths::nunetd("debug")?);
    Ok(pytest)
}

/// An environment with what a file of the repository lists.
fn required_by(name: &str, requirements: &str) -> Result<PathBuf> {
    required_by_with(&interpreter::system()?, name, requirements)
}

fn required_by_with(system: &interpreter::System, name: &str, requirements: &str) -> Result<PathBuf> {
    let path = paths::root().join(requirements);
    let text = fs::read_to_string(&path).with_context(|| format!("cannot read `{}`", path.display()))?;
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or_default().trim());
    let lines: Vec<_> = lines.filter(|line| !line.is_empty()).map(str::to_owned).collect();
    environment_of(system, name, &lines, |python| install(python, &lines))
}

/// An environment in `folder` that extends the one of `shared`: packages that a clone builds
/// must not affect other clones.
pub(crate) fn layer_over(shared: &Path, folder: &Path) -> Result<Layer> {
    let python = folder.join("bin/python");
    let made_over = folder.join("over");
    if fs::read(&made_over).ok().as_deref() != Some(shared.as_os_str().as_bytes()) {
        run(Command::new(shared).args(["-m", "venv", "--clear", "--without-pip"]).arg(folder))?;
    }
    let (below, packages) = (packages_of(shared)?, packages_of(&python)?);
    let pth = packages.join("shared.pth");
    fs::write(&pth, format!("{}\n", below.display()))
        .and_then(|()| fs::write(&made_over, shared.as_os_str().as_bytes()))
        .with_context(|| format!("cannot write `{}`", pth.display()))?;
    Ok(Layer { python, packages })
}

/// An environment over another one.
pub(crate) struct Layer {
    pub(crate) python: PathBuf,
    /// Where its own packages lie.
    pub(crate) packages: PathBuf,
}

/// The folder of packages of an interpreter.
fn packages_of(python: &Path) -> Result<PathBuf> {
    let path =
        output(Command::new(python).args(["-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]))?;
    Ok(PathBuf::from(path.trim_end()))
}

/// The environment that builds and checks wheels.
pub(crate) fn wheel_environment() -> Result<PathBuf> {
    let tools = ["maturin>=1.16,<2", "abi3audit>=0.0.20,<1"].map(str::to_owned);
    environment("wheel", &tools, |python| install(python, &tools))
}

/// A new environment in `folder` with nothing in it.
pub(crate) fn bare_environment(folder: &Path) -> Result<PathBuf> {
    run(Command::new(interpreter::system()?.program)
        .args(["-m", "venv", "--clear", "--without-pip"])
        .arg(folder))?;
    Ok(folder.join("bin/python"))
}

/// pip, run by an interpreter that need not have it.
pub(crate) fn pip_of(python: &Path, words: &[&str]) -> Result<Command> {
    let mut command = Command::new(python);
    command.arg(pip()?.join("pip")).args(words).args(["--disable-pip-version-check", "--no-input"]);
    if let (None, Some(index)) = (std::env::var_os("PIP_INDEX_URL"), uv_index()) {
        command.env("PIP_INDEX_URL", index);
    }
    Ok(command)
}

/// The environment of `models/recipe`: torch and its libraries. The recipe itself is not installed in it but
/// found by PYTHONPATH, so that clones with different recipes share one environment.
pub(crate) fn recipe_environment() -> Result<PathBuf> {
    let mut reader = Command::new(interpreter::system()?.program);
    reader.args(["-c", RECIPE_REQUIREMENTS]).current_dir(paths::root());
    let lines = output(&mut reader).map_err(|error| {
        Hinted::new("cannot read what models/recipe needs", "set PYTHON to Python 3.11 or newer")
            .because(error)
    })?;
    let lines: Vec<_> = lines.lines().map(str::to_owned).collect();
    environment("recipe", &lines, |python| install_recipe(python, &lines))
}

/// A command that runs the recipe's modules.
pub(crate) fn recipe(python: &Path) -> Command {
    let mut command = Command::new(python);
    command.env("PYTHONPATH", paths::root().join("models/recipe"));
    command
}

/// The same for the interpreter that the machine offers.
fn environment(
    name: &str,
    requirements: &[String],
    fill: impl FnOnce(&Path) -> Result<()>,
) -> Result<PathBuf> {
    environment_of(&interpreter::system()?, name, requirements, fill)
}

/// The interpreter of an environment with these requirements. It is in the cache under a hash of them and of
/// the interpreter, and is created again if it is incomplete.
fn environment_of(
    system: &interpreter::System,
    name: &str,
    requirements: &[String],
    fill: impl FnOnce(&Path) -> Result<()>,
) -> Result<PathBuf> {
    let cache = paths::cache()?;
    let folder = cache.join(format!("venv-{name}-{:016x}", fingerprint(&system.identity, requirements)?));
    let (python, stamp) = (folder.join("bin/python"), folder.join(STAMP));
    let _lock = paths::lock()?;
    if !stamp.is_file() || output(Command::new(&python).args(["-c", IDENTITY])).is_err() {
        say(&format!("setting up the Python environment `{name}` in {}", folder.display()));
        create(&system.program, &folder)?;
        fill(&python)?;
    }
    // The stamp's time says when the environment was last used.
    fs::write(&stamp, "").with_context(|| format!("cannot write `{}`", stamp.display()))?;
    remove_forgotten(&cache, name)?;
    Ok(python)
}

fn fingerprint(identity: &str, requirements: &[String]) -> Result<u64> {
    let mut hasher = DefaultHasher::new(); // its keys are fixed, and a new algorithm costs one new environment
    (identity, requirements, wheels::pinned("pip")?.sha256).hash(&mut hasher);
    Ok(hasher.finish())
}

fn create(system: &Path, folder: &Path) -> Result<()> {
    run(Command::new(system).args(["-m", "venv", "--clear", "--without-pip"]).arg(folder))
}

fn install(python: &Path, requirements: &[String]) -> Result<()> {
    run(pip_of(python, &["install"])?.args(requirements))
}

/// Installs the recipe's requirements with the smallest torch to be had. On Linux, the package index's own
/// torch is built for CUDA and takes 5 GB with its libraries; the recipe and its tests compute on the
/// processor.
///
/// Tried in this order: an index of CPU builds named by [`TORCH_INDEX`]; wheels in the folders that pip is
/// configured to search (`find-links`); the usual index. Of its build for CUDA, the compiler for graphics
/// cards (1 GB) is removed again; torch does not start without the other libraries.
fn install_recipe(python: &Path, requirements: &[String]) -> Result<()> {
    let is_torch = |line: &&String| line.starts_with("torch");
    let torch: Vec<_> = requirements.iter().filter(is_torch).collect();
    let mut offline = pip_of(python, &["install", "--quiet", "--no-index"])?;
    match std::env::var(TORCH_INDEX).ok().filter(|index| !index.is_empty()) {
        Some(index) => run(pip_of(python, &["install", "--index-url", &index])?.args(&torch))?,
        // Not an error: few machines have such a folder.
        None => drop(offline.args(&torch).output()),
    }
    install(python, requirements)?;
    run(&mut pip_of(python, &["uninstall", "--yes", "--quiet", "triton"])?)
}

/// Removes environments of this name that no clone has used for long: one may hold gigabytes.
fn remove_forgotten(cache: &Path, name: &str) -> Result<()> {
    let entries = fs::read_dir(cache).with_context(|| format!("cannot read `{}`", cache.display()))?;
    for entry in entries.flatten() {
        let of_this_name = entry.file_name().to_string_lossy().starts_with(&format!("venv-{name}-"));
        let used = fs::metadata(entry.path().join(STAMP)).and_then(|stamp| stamp.modified());
        let age = used.ok().and_then(|used| used.elapsed().ok()).unwrap_or_default();
        if of_this_name && age > FORGOTTEN_AFTER {
            say(&format!("removing {}, unused for {} days", entry.path().display(), age.as_secs() / 86_400));
            fs::remove_dir_all(entry.path())
                .with_context(|| format!("cannot remove `{}`", entry.path().display()))?;
        }
    }
    Ok(())
}

/// pip's own wheel, a zip file that Python runs as it is.
fn pip() -> Result<PathBuf> {
    let wheel = wheels::pinned("pip")?;
    let path = paths::cache()?.join(format!("pip-{}", wheel.version)).join(wheel.file);
    wheels::fetch(&wheel, None, &path)?;
    Ok(path)
}

/// uv's index, which pip does not read, so that one setting serves both (as in `fetch_wheel.py`).
fn uv_index() -> Option<String> {
    let index = ["UV_DEFAULT_INDEX", "UV_INDEX_URL"].iter().find_map(|key| std::env::var(key).ok())?;
    let named = index.split_once('=').filter(|(name, _)| !name.contains(['/', ':']));
    Some(named.map_or(index.clone(), |(_, url)| url.to_owned()))
}
