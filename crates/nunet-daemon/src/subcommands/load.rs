//! Loads a model for a subcommand.

use std::path::Path;

use anyhow::Context as _;
use nunet_core::graph::GraphError;
use nunet_core::pipeline::{Pipeline, PipelineOptions};
use nunet_engine::{Engine, EngineError, LoadedModel};
use nunet_sink::obstacles::{ObstacleConfig, ObstacleStage};
use tracing::warn;

use crate::config::ModelConfig;
use crate::exit::BadArguments;
use crate::stream::{Stop, Stopped};

/// Finds a model, checks it in a child process if it is new, and loads it.
pub(super) fn load(engine: &Engine, model: &Path) -> anyhow::Result<LoadedModel> {
    load_unless(engine, &ModelConfig { path: model.to_owned(), every: Vec::new() }, &Stop::default())
}

/// The same, unless a shutdown is requested before it is loaded: [`Stopped`].
pub(super) fn load_unless(engine: &Engine, model: &ModelConfig, stop: &Stop) -> anyhow::Result<LoadedModel> {
    engine.load(&model.path, &model.every, stop.flag()).map_err(|error| match error {
        EngineError::Stopped => Stopped.into(),
        EngineError::Graph(GraphError::UnknownStage { .. } | GraphError::EveryTwice { .. }) => {
            anyhow::Error::from(error).context(BadArguments::new("`--every` does not fit the model"))
        }
        error => error.into(),
    })
}

/// The stage that finds obstacles; `None` if it is off, or off by default for depth without unit.
pub(super) fn obstacle_stage(
    config: Option<ObstacleConfig>,
    pipeline: &Pipeline,
) -> Result<Option<ObstacleStage>, BadArguments> {
    let Some(config) = config else { return Ok(None) };
    let stage = ObstacleStage::new(config, pipeline);
    let text = "obstacles need depth in meters, and the model's depth has no unit";
    match &stage {
        None if config.is_required => {
            return Err(BadArguments::new(text).with_hint("choose a model with metric depth"));
        }
        None => warn!("obstacles are off: {text}"),
        Some(_) => {}
    }
    Ok(stage)
}

/// One pipeline, self-tested; logs what was loaded.
pub(super) fn tested_pipeline(loaded: LoadedModel, options: PipelineOptions) -> anyhow::Result<Pipeline> {
    loaded.into_pipelines([options])?.pop().context("one pipeline was asked for")
}
