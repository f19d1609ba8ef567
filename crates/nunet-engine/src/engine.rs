//! Loads ONNX Runtime and models, up to a pipeline that has passed its self-test.

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use nunet_core::graph::{GraphOptions, Provider, Runtime, SerialGraph};
use nunet_core::model::SelfTestReport;
use nunet_core::pipeline::{Pipeline, PipelineOptions};
use nunet_types::counted;
use serde::Serialize;
use tracing::{info, warn};

use crate::clock::MonotonicClock;
use crate::error::EngineError;
use crate::library::LibraryFile;
use crate::options::EngineOptions;
use crate::telemetry::Telemetry;
use crate::text::hexadecimal;
use crate::{huge_pages, model_check, models};

/// The loaded ONNX Runtime, and the options for running networks.
///
/// # Example: a pipeline for a stream of frames
/// ```no_run
/// use std::sync::atomic::AtomicBool;
///
/// use nunet_core::pipeline::PipelineOptions;
/// use nunet_engine::{Engine, EngineOptions};
///
/// # fn main() -> Result<(), nunet_engine::EngineError> {
/// let engine = Engine::start(EngineOptions::default())?;
/// let loaded = engine.load("wnet_c.onnx".as_ref(), &[], &AtomicBool::new(false))?;
/// println!("{} with SHA-256 {}", loaded.name(), loaded.hash());
/// let pipelines = loaded.into_pipelines([PipelineOptions::default()])?;
/// assert_eq!(pipelines.len(), 1);
/// # Ok(())
/// # }
/// ```
pub struct Engine {
    library: LibraryFile,
    runtime: Runtime,
    options: EngineOptions,
}

impl Engine {
    /// Finds and loads the library, with its telemetry off by default ([`Telemetry`]). [`Provider::Auto`] is
    /// resolved here, because a model must be checked with the provider that will run it.
    ///
    /// # Errors
    /// Options out of range; a library that is missing or not usable.
    pub fn start(options: EngineOptions) -> Result<Self, EngineError> {
        options.check()?;
        let library = LibraryFile::find(options.onnxruntime.as_deref())?;
        Telemetry::turn_off_by_default();
        let runtime = Runtime::load(&library.path)?;
        let provider = match options.provider {
            Provider::Auto => runtime.best_provider(),
            named => named,
        };
        Ok(Self { library, runtime, options: EngineOptions { provider, ..options } })
    }

    /// The library that was loaded.
    #[must_use]
    pub fn library(&self) -> &LibraryFile {
        &self.library
    }

    /// The runtime.
    #[must_use]
    pub fn runtime(&self) -> &Runtime {
        &self.runtime
    }

    /// Finds a model by path or name, checks it in a child process if it is new on this machine, and loads
    /// it.
    ///
    /// `every`: stages that run only each n-th frame, overriding the manifest. `cancel` ends a model check.
    ///
    /// # Errors
    /// No such model, a file that is refused, a stage that the model does not have; [`EngineError::Stopped`]
    /// if `cancel` became true.
    pub fn load(
        &self,
        model: &Path,
        every: &[(String, NonZeroU32)],
        cancel: &AtomicBool,
    ) -> Result<LoadedModel, EngineError> {
        let path = models::find_model(model)?;
        let hashes = model_check::check(&path, &self.options, &self.library, cancel)?;
        if cancel.load(Ordering::Relaxed) {
            return Err(EngineError::Stopped);
        }
        self.load_trusted(path, every, hashes)
    }

    /// Loads a model file without a check, if its files have these hashes; any file if there are none.
    ///
    /// # Errors
    /// A file that cannot be loaded or has another hash.
    pub(crate) fn load_trusted(
        &self,
        path: PathBuf,
        every: &[(String, NonZeroU32)],
        allowed_hashes: Vec<[u8; 32]>,
    ) -> Result<LoadedModel, EngineError> {
        let options = GraphOptions {
            provider: self.options.provider,
            threads: self.options.threads,
            every: every.iter().map(|(stage, count)| (stage.clone(), count.get())).collect(),
            allowed_hashes,
        };
        let graph = SerialGraph::load(&path, &self.runtime, &options)?;
        Ok(LoadedModel { path, graph })
    }
}

/// The name and hash of a model, for statistics and reports.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ModelName {
    /// The file's name.
    pub name: String,
    /// The file's SHA-256, hexadecimal.
    pub hash: String,
}

/// A model in memory that has not passed its self-test yet.
pub struct LoadedModel {
    path: PathBuf,
    graph: SerialGraph,
}

impl LoadedModel {
    /// The model file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file's name, for statistics and recordings.
    #[must_use]
    pub fn name(&self) -> String {
        self.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    }

    /// The file's SHA-256, hexadecimal.
    #[must_use]
    pub fn hash(&self) -> String {
        hexadecimal(&self.graph.description().hash)
    }

    /// Name and hash.
    #[must_use]
    pub fn model_name(&self) -> ModelName {
        ModelName { name: self.name(), hash: self.hash() }
    }

    /// The network.
    #[must_use]
    pub fn graph(&self) -> &SerialGraph {
        &self.graph
    }

    /// One pipeline, self-tested, and the test's report. Logs nothing and does not change the memory's pages:
    /// for programs that embed this crate.
    ///
    /// # Errors
    /// Options that do not fit the network's size; a self-test that fails.
    pub fn into_pipeline(self, options: PipelineOptions) -> Result<(Pipeline, SelfTestReport), EngineError> {
        let mut pipeline = Pipeline::new(self.graph, options)?;
        let report = pipeline.selftest(&MonotonicClock);
        let report = report.map_err(|source| EngineError::SelfTest { path: self.path, source })?;
        Ok((pipeline, report))
    }

    /// One pipeline per camera, at least one. They share the sessions, so weights are loaded and tested once.
    /// The state of networks, filters and skipped stages belongs to each pipeline.
    ///
    /// Afterwards this process's memory is moved into huge pages, and what was loaded is logged.
    ///
    /// # Errors
    /// As for [`LoadedModel::into_pipeline`].
    pub fn into_pipelines(
        self,
        options: impl IntoIterator<Item = PipelineOptions>,
    ) -> Result<Vec<Pipeline>, EngineError> {
        let mut options = options.into_iter();
        let path = self.path.clone();
        let (first, report) = self.into_pipeline(options.next().unwrap_or_default())?;
        huge_pages::collapse_resident();
        log_model(&path, &first, &report);
        let mut pipelines = vec![first];
        for options in options {
            let graph = pipelines[0].graph().share_sessions()?;
            pipelines.push(Pipeline::new(graph, options)?);
        }
        if pipelines.len() > 1 {
            let cameras = counted(pipelines.len(), "camera");
            info!("{cameras} share the model; its weights are in memory once");
        }
        Ok(pipelines)
    }
}

fn log_model(path: &Path, pipeline: &Pipeline, report: &SelfTestReport) {
    let (graph, path) = (pipeline.graph(), path.display());
    let description = graph.description();
    info!(
        "model `{path}`: {}, {}, provider {}, self-test {report}",
        description.architecture,
        graph.size(),
        graph.provider()
    );
    for filter in pipeline.filters().specs() {
        info!("filter {filter}");
    }
    if !description.trained {
        warn!("`{path}` has untrained weights: its depth is meaningless");
    }
    if !description.encoding.is_metric() {
        warn!("`{path}` gives depth without a unit ({}): nothing is in meters", description.encoding);
    }
    if description.selftest.is_none() {
        warn!("`{path}` has no self-test: its results on this machine are not verified");
    }
}
