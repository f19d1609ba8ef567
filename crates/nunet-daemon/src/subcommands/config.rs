//! `nunetd config`: prints the configuration of `run` as a file.

use super::run;
use crate::Outcome;
use crate::config::Config;
use nunet_sink::stdout::print;

/// Prints the configuration `effective`, if `run` would accept it. `warn` is called before.
pub(crate) fn config(config: &Config, effective: &str, warn: impl FnOnce()) -> anyhow::Result<Outcome> {
    run::check(config)?;
    warn();
    print(effective.trim_end())?;
    Ok(Outcome::Done)
}
