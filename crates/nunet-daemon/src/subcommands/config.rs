//! `nunetd config`: prints the configuration of `run` as a file.

use std::io::Write as _;

use super::run;
use crate::Outcome;
use crate::config::Config;

/// Prints the configuration `effective`, if `run` would accept it.
pub(crate) fn config(config: &Config, effective: &str) -> anyhow::Result<Outcome> {
    run::check(config)?;
    write!(std::io::stdout(), "{effective}")?;
    Ok(Outcome::Done)
}
