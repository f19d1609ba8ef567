//! `nunetd config`: what `run` would do, as a configuration file.

use std::io::Write as _;

use super::run;
use crate::Outcome;
use crate::config::Config;

/// Prints the configuration `effective`, if `run` would begin with it.
pub(crate) fn config(config: &Config, effective: &str) -> anyhow::Result<Outcome> {
    run::check(config)?;
    write!(std::io::stdout(), "{effective}")?;
    Ok(Outcome::Done)
}
