//! `nunetd config`: what `run` would do, as a configuration file.

use std::io::Write as _;

use super::run;
use crate::Outcome;
use crate::cli::ConfigArgs;

/// Prints the effective configuration, if `run` would begin with it.
pub(super) fn config(arguments: &ConfigArgs) -> anyhow::Result<Outcome> {
    run::check(&arguments.run)?;
    write!(std::io::stdout(), "{}", arguments.effective)?;
    Ok(Outcome::Done)
}
