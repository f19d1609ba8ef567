//! `nunetd config`: prints the configuration of `run` as a file.

use super::run;
use crate::Outcome;
use crate::config::Config;
use nunet_sink::stdout::print;

/// Prints the configuration `effective`, if `run` would accept it.
pub(crate) fn config(config: &Config, effective: &str) -> anyhow::Result<Outcome> {
    run::check(config)?;
    print(effective.trim_end())?;
    Ok(Outcome::Done)
}
