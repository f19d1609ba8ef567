//! `cargo xtask test --rerun`: a recording of nunetd, opened by Rerun from the package index.

use anyhow::Result;

use crate::python;
use crate::run::run_all;

/// Builds nunetd and lets Rerun open what it records.
pub(crate) fn test() -> Result<()> {
    let pytest = python::tests_of_nunetd(&python::rerun_environment()?, "tests/rerun")?;
    run_all("test --rerun", &mut [("Rerun", pytest)])
}
