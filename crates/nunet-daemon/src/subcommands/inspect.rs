//! `nunetd inspect`: what a model file is.

use std::io::Write as _;

use nunet_engine::ModelReport;

use crate::Outcome;
use crate::cli::{CameraArgs, InspectArgs};
use crate::engine::{Engine, tested};

/// Loads and self-tests the model, and prints what it is.
pub(super) fn inspect(arguments: &InspectArgs) -> anyhow::Result<Outcome> {
    let engine = Engine::start(&arguments.engine)?;
    let loaded = engine.load(&arguments.model, &[])?;
    let (file, hash) = (loaded.path().display().to_string(), loaded.hash());
    let (pipeline, selftest) = tested(loaded, &CameraArgs::default())?;
    let report = ModelReport { file, hash, graph: pipeline.graph(), selftest: &selftest };
    let text = if arguments.json { format!("{:#}", report.json()) } else { report.text() };
    writeln!(std::io::stdout(), "{}", text.trim_end())?;
    Ok(Outcome::Done)
}
