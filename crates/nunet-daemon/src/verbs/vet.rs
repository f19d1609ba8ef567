//! `nunetd vet`: what the child process does with a model that is not trusted yet.

use crate::cli::{CameraArgs, VetArgs};
use crate::engine::{Engine, tested_pipeline};
use crate::{Outcome, vetting};

/// Loads the model within limits and runs its self-test.
pub(super) fn vet(arguments: &VetArgs) -> anyhow::Result<Outcome> {
    vetting::limit_this_process(&arguments.model, arguments.engine.provider)?;
    let engine = Engine::start(&arguments.engine)?;
    let loaded = engine.load_trusted(arguments.model.clone(), &[])?;
    tested_pipeline(loaded, &CameraArgs::default())?;
    Ok(Outcome::Done)
}
