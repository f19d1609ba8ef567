//! From `--model`, `--provider`, `--threads`, `--onnxruntime` to a pipeline that has passed its self-test.

use std::num::{NonZeroU32, NonZeroUsize};
use std::path::{Path, PathBuf};
use std::thread::available_parallelism;

use anyhow::Context as _;
use nunet_core::filter::FilterOptions;
use nunet_core::graph::{GraphError, GraphOptions, Provider, Runtime, SerialGraph};
use nunet_core::model::SelfTestReport;
use nunet_core::pipeline::{Focal, Pipeline, PipelineOptions};
use nunet_engine::Telemetry;
use tracing::{info, warn};

use crate::cli::{CameraArgs, EngineArgs, FilterArgs, FocalArg};
use crate::exit::BadArguments;
use crate::library::{self, Found};
use crate::stream::Stop;
use crate::telemetry::MonotonicClock;
use crate::words::hexadecimal;
use crate::{models, pages, vetting};

/// ONNX Runtime, loaded, and how graphs are to run in it.
pub(crate) struct Engine {
    pub(crate) library: Found,
    pub(crate) runtime: Runtime,
    arguments: EngineArgs,
}

/// A model in memory.
pub(crate) struct Loaded {
    pub(crate) path: PathBuf,
    pub(crate) graph: SerialGraph,
}

impl Loaded {
    /// The model file's name, for figures and pictures.
    pub(crate) fn name(&self) -> String {
        self.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    }

    /// The model file's SHA-256, hexadecimal.
    pub(crate) fn hash(&self) -> String {
        hexadecimal(&self.graph.description().hash)
    }
}

impl Engine {
    /// Finds and loads the library. What `auto` means is settled here: a model must be tried with what will run it.
    pub(crate) fn start(arguments: &EngineArgs) -> anyhow::Result<Self> {
        check_threads(arguments.threads)?;
        Telemetry::turn_off_by_default();
        let library = library::find(arguments.onnxruntime.as_deref())?;
        let runtime = Runtime::load(&library.path)?;
        let provider = match arguments.provider {
            Provider::Auto => runtime.best_provider(),
            named => named,
        };
        Ok(Self { library, runtime, arguments: EngineArgs { provider, ..arguments.clone() } })
    }

    /// Finds a model, has it vetted in a child process where it is new, and loads it.
    pub(crate) fn load(&self, model: &Path, every: &[(String, NonZeroU32)]) -> anyhow::Result<Loaded> {
        self.load_unless(model, every, &Stop::default())
    }

    /// The same, unless a stop is requested before it is loaded: [`Stopped`](crate::stream::Stopped).
    pub(crate) fn load_unless(
        &self,
        model: &Path,
        every: &[(String, NonZeroU32)],
        stop: &Stop,
    ) -> anyhow::Result<Loaded> {
        let path = models::find(model)?;
        let vetted = vetting::vet(&path, &self.arguments, &self.library, stop)?;
        stop.check()?;
        self.load_trusted(path, every, vetted)
    }

    /// Loads a model file without a child process, if its files have these hashes; any file where there are none.
    pub(crate) fn load_trusted(
        &self,
        path: PathBuf,
        every: &[(String, NonZeroU32)],
        only: Vec<[u8; 32]>,
    ) -> anyhow::Result<Loaded> {
        let options = GraphOptions {
            provider: self.arguments.provider,
            threads: self.arguments.threads,
            every: every.iter().map(|(stage, count)| (stage.clone(), count.get())).collect(),
            only,
        };
        let graph = SerialGraph::load(&path, &self.runtime, &options).map_err(blame_every)?;
        Ok(Loaded { path, graph })
    }
}

/// ONNX Runtime's threads spin while they wait for each other: far more of them than cores do not get through one
/// prediction.
const MOST_THREADS_A_CORE: usize = 4;

/// Refuses threads that this machine could not run.
pub(crate) fn check_threads(threads: Option<NonZeroUsize>) -> Result<(), BadArguments> {
    let (Some(threads), Ok(cores)) = (threads, available_parallelism()) else { return Ok(()) };
    let most = cores.get().saturating_mul(MOST_THREADS_A_CORE);
    if threads.get() <= most {
        return Ok(());
    }
    Err(BadArguments(format!(
        "{threads} threads on {cores} cores; expected at most {most}\nhint: one a core is fastest, and the default"
    )))
}

/// A stage that the graph does not have was named on the command line.
fn blame_every(error: GraphError) -> anyhow::Error {
    let is_unknown = matches!(error, GraphError::UnknownStage { .. });
    let error = anyhow::Error::from(error);
    if is_unknown { error.context(BadArguments("`--every` does not fit the model".into())) } else { error }
}

/// Builds the pipeline around a graph and tests it: no frame before the numbers are right.
pub(crate) fn tested_pipeline(loaded: Loaded, optics: &CameraArgs) -> anyhow::Result<Pipeline> {
    let path = loaded.path.clone();
    let (pipeline, report) = tested(loaded, optics)?;
    pages::make_huge();
    say_what_is_loaded(&path, &pipeline, &report);
    Ok(pipeline)
}

/// The same without a word, and what the test found.
pub(crate) fn tested(loaded: Loaded, optics: &CameraArgs) -> anyhow::Result<(Pipeline, SelfTestReport)> {
    let path = loaded.path;
    let mut pipeline = Pipeline::new(loaded.graph, options(optics)?)?;
    let report =
        pipeline.selftest(&MonotonicClock).with_context(|| format!("`{}` is refused", path.display()))?;
    Ok((pipeline, report))
}

/// A pipeline for each camera, one at least. They run the same sessions, so that weights are in memory once and tested
/// once; what a network, a filter or a skipped stage keeps from frame to frame, each has for itself.
pub(crate) fn tested_pipelines<'a>(
    loaded: Loaded,
    cameras: impl IntoIterator<Item = &'a CameraArgs>,
) -> anyhow::Result<Vec<Pipeline>> {
    let mut cameras = cameras.into_iter();
    let first = tested_pipeline(loaded, cameras.next().unwrap_or(&CameraArgs::default()))?;
    let others = cameras.map(|optics| Ok(Pipeline::new(first.graph().sibling()?, options(optics)?)?));
    let others = others.collect::<anyhow::Result<Vec<_>>>()?;
    if !others.is_empty() {
        info!("{} cameras share the model: its weights are in memory once", others.len() + 1);
    }
    Ok(std::iter::once(first).chain(others).collect())
}

fn options(optics: &CameraArgs) -> Result<PipelineOptions, BadArguments> {
    Ok(PipelineOptions {
        camera: None,
        focal: match optics.lens.focal {
            FocalArg::Auto => Focal::Auto,
            FocalArg::Off => Focal::Off,
        },
        cloud_stride: optics.cloud_stride,
        filters: filters(&optics.filters)?,
    })
}

/// What clap cannot see, because it parses one value after the other.
pub(crate) fn filters(arguments: &FilterArgs) -> Result<FilterOptions, BadArguments> {
    arguments.options().map_err(|error| BadArguments(error.to_string()))
}

fn say_what_is_loaded(path: &Path, pipeline: &Pipeline, report: &SelfTestReport) {
    let graph = pipeline.graph();
    let (width, height) = graph.size();
    info!(
        "model `{}`: {}, {width}x{height}, provider {}, self-test {report}",
        path.display(),
        graph.description().architecture,
        graph.provider()
    );
    for filter in pipeline.filters().specs() {
        info!("filter {filter}");
    }
    if !graph.description().trained {
        warn!("`{}` carries untrained weights: its depth means nothing", path.display());
    }
    let encoding = graph.description().encoding;
    if !encoding.is_metric() {
        warn!("`{}` gives depth without a unit ({encoding}): nothing here is metres", path.display());
    }
    if graph.description().selftest.is_none() {
        warn!("`{}` carries no self-test: nobody knows whether its numbers are right here", path.display());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_four_threads_a_core_are_a_bad_argument() {
        let most = 4 * available_parallelism().unwrap().get();
        for threads in [None, NonZeroUsize::new(1), NonZeroUsize::new(most)] {
            assert!(check_threads(threads).is_ok(), "{threads:?}");
        }
        let error = check_threads(NonZeroUsize::new(most + 1)).unwrap_err().to_string();
        assert!(error.contains(&format!("expected at most {most}\nhint: one a core")), "{error}");
    }
}
