//! The engine with the types of the command line: arguments in, pipelines out.

use std::num::{NonZeroU32, NonZeroUsize};
use std::path::Path;

use nunet_core::filter::FilterOptions;
use nunet_core::graph::GraphError;
use nunet_core::model::SelfTestReport;
use nunet_core::pipeline::{Focal, Pipeline, PipelineOptions};
use nunet_engine::{EngineError, EngineOptions, LoadedModel};

use crate::cli::{CameraArgs, EngineArgs, FilterArgs, FocalArg};
use crate::exit::BadArguments;
use crate::stream::{Stop, Stopped};

/// ONNX Runtime, loaded, and how networks are run in it.
pub(crate) struct Engine(nunet_engine::Engine);

impl std::ops::Deref for Engine {
    type Target = nunet_engine::Engine;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl Engine {
    /// Finds and loads ONNX Runtime's library.
    pub(crate) fn start(arguments: &EngineArgs) -> anyhow::Result<Self> {
        Ok(Self(nunet_engine::Engine::start(options(arguments))?))
    }

    /// Finds a model, checks it in a child process if it is new, and loads it.
    pub(crate) fn load(&self, model: &Path, every: &[(String, NonZeroU32)]) -> anyhow::Result<LoadedModel> {
        self.load_unless(model, every, &Stop::default())
    }

    /// The same, unless a shutdown is requested before it is loaded: [`Stopped`].
    pub(crate) fn load_unless(
        &self,
        model: &Path,
        every: &[(String, NonZeroU32)],
        stop: &Stop,
    ) -> anyhow::Result<LoadedModel> {
        self.0.load(model, every, stop.flag()).map_err(|error| match error {
            EngineError::Stopped => Stopped.into(),
            EngineError::Graph(GraphError::UnknownStage { .. } | GraphError::EveryTwice { .. }) => {
                anyhow::Error::from(error).context(BadArguments("`--every` does not fit the model".into()))
            }
            error => error.into(),
        })
    }
}

/// What the command line says about the engine.
pub(crate) fn options(arguments: &EngineArgs) -> EngineOptions {
    let EngineArgs { provider, threads, onnxruntime } = arguments.clone();
    EngineOptions { provider, threads, onnxruntime }
}

/// Rejects threads that this machine could not run.
pub(crate) fn check_threads(threads: Option<NonZeroUsize>) -> Result<(), EngineError> {
    EngineOptions { threads, ..EngineOptions::default() }.check()
}

/// One pipeline, self-tested; logs what was loaded.
pub(crate) fn tested_pipeline(loaded: LoadedModel, optics: &CameraArgs) -> anyhow::Result<Pipeline> {
    let mut pipelines = loaded.into_pipelines([pipeline_options(optics)?])?;
    Ok(pipelines.remove(0))
}

/// One pipeline, self-tested, and the test's report; logs nothing.
pub(crate) fn tested(loaded: LoadedModel, optics: &CameraArgs) -> anyhow::Result<(Pipeline, SelfTestReport)> {
    Ok(loaded.into_pipeline(pipeline_options(optics)?)?)
}

/// One pipeline per camera, at least one, on the same sessions.
pub(crate) fn tested_pipelines<'a>(
    loaded: LoadedModel,
    cameras: impl IntoIterator<Item = &'a CameraArgs>,
) -> anyhow::Result<Vec<Pipeline>> {
    let options = cameras.into_iter().map(pipeline_options).collect::<Result<Vec<_>, _>>()?;
    Ok(loaded.into_pipelines(options)?)
}

fn pipeline_options(optics: &CameraArgs) -> Result<PipelineOptions, BadArguments> {
    Ok(PipelineOptions {
        camera: None,
        focal: match optics.lens.focal {
            FocalArg::Auto => Focal::Auto,
            FocalArg::Off => Focal::Off,
        },
        cloud_stride: optics.cloud_stride,
        filters: filters(&optics.filters)?,
        max_range_m: optics.max_range,
        ..PipelineOptions::default()
    })
}

/// What clap cannot check, because it parses one value after the other.
pub(crate) fn filters(arguments: &FilterArgs) -> Result<FilterOptions, BadArguments> {
    arguments.options().map_err(|error| BadArguments(nunet_types::text_with_hint(&error)))
}
