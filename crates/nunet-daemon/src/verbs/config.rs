//! `nunetd config`: what `run` would do, as a configuration file.

use std::io::Write as _;

use crate::Outcome;
use crate::cli::ConfigArgs;

/// Prints the effective configuration.
pub(super) fn config(arguments: &ConfigArgs) -> anyhow::Result<Outcome> {
    write!(std::io::stdout(), "{}", arguments.effective)?;
    Ok(Outcome::Done)
}
