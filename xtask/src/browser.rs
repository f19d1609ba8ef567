//! `cargo xtask test --browser`: the live view in the system's Chromium.

use std::path::PathBuf;

use anyhow::{Result, bail};

use crate::hinted::Hinted;
use crate::python;
use crate::run::run_all;

/// The environment variable with the browser's path.
const CHROMIUM: &str = "CHROMIUM";

/// Builds nunetd and opens its page.
pub(crate) fn test() -> Result<()> {
    let chromium = chromium()?;
    let mut pytest = python::tests_of_nunetd(&python::browser_environment()?, "tests/browser")?;
    pytest.env(CHROMIUM, chromium);
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
