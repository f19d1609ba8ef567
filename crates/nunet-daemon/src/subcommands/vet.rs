//! `nunetd vet`: what the child process does with a model that is not trusted yet.

use std::io::Write as _;

use crate::cli::{CameraArgs, VetArgs};
use crate::engine::{Engine, tested};
use crate::fault::Fault;
use crate::{Outcome, vetting};

/// Loads the model within limits and runs its self-test; says on stdout of which kind a failure is.
pub(super) fn vet(arguments: &VetArgs) -> anyhow::Result<Outcome> {
    let outcome = within_limits(arguments);
    if let Err(error) = &outcome {
        write!(std::io::stdout(), "{}", Fault::of(error).name())?;
    }
    outcome
}

fn within_limits(arguments: &VetArgs) -> anyhow::Result<Outcome> {
    vetting::limit_this_process(&arguments.model, arguments.engine.provider)?;
    let engine = Engine::start(&arguments.engine)?;
    let loaded = engine.load_trusted(arguments.model.clone(), &[], arguments.hash.clone())?;
    tested(loaded, &CameraArgs::default())?;
    Ok(Outcome::Done)
}
