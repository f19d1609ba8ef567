//! `cargo xtask test --browser`: the live view in the system's Chromium.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Result, bail};

use crate::hinted::Hinted;
use crate::run::{cargo, run, run_all};
use crate::{paths, python, setup};

/// The environment variable with the browser's path.
const CHROMIUM: &str = "CHROMIUM";

/// Builds nunetd and opens its page.
pub(crate) fn test() -> Result<()> {
    let chromium = chromium()?;
    setup::onnxruntime()?;
    // A test among the targets makes cargo choose the features that `cargo test --workspace` has.
    run(&mut cargo(&["build", "--workspace", "--bins", "--test", "structure"]))?;
    let mut pytest = Command::new(python::browser_environment()?);
    pytest.args(["-m", "pytest", "-q", "-rs", "-s", "-p", "no:cacheprovider", "tests/browser"]);
    pytest.current_dir(paths::root()).env("NUNETD", paths::nunetd("debug")?).env(CHROMIUM, chromium);
    run_all("test --browser", &mut [("browser", pytest)])
}

fn chromium() -> Result<PathBuf> {
    if let Some(named) = std::env::var_os(CHROMIUM).filter(|named| !named.is_empty()) {
        return Ok(named.into());
    }
    let folders: Vec<PathBuf> = std::env::var_os("PATH").iter().flat_map(std::env::split_paths).collect();
    let programs = ["chromium", "chromium-browser", "google-chrome"];
    let mut candidates = folders.iter().flat_map(|folder| programs.map(|program| folder.join(program)));
    match candidates.find(|candidate| candidate.is_file()) {
        Some(found) => Ok(found),
        None => bail!(Hinted::new(
            "cannot find Chromium",
            "install it (Debian and Ubuntu: `apt-get install chromium`), or set CHROMIUM"
        )),
    }
}
