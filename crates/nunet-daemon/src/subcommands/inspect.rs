//! `nunetd inspect`: describes a model file.

use std::path::Path;

use nunet_core::pipeline::PipelineOptions;
use nunet_engine::{Engine, EngineOptions, ModelReport};

use super::load::load;
use crate::Outcome;
use nunet_sink::stdout::print;

/// Loads and self-tests the model, and prints its description.
pub(crate) fn inspect(model: &Path, engine: EngineOptions, json: bool) -> anyhow::Result<Outcome> {
    let loaded = load(&Engine::start(engine)?, model)?;
    let (file, hash) = (loaded.path().display().to_string(), loaded.hash());
    let (pipeline, selftest) = loaded.into_pipeline(PipelineOptions::default())?;
    let report = ModelReport { file, hash, graph: pipeline.graph(), selftest: &selftest };
    let text = if json { format!("{:#}", report.json()) } else { report.text() };
    print(text.trim_end())?;
    Ok(Outcome::Done)
}
