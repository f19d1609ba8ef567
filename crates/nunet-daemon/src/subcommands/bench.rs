//! `nunetd bench`: measures predictions of one image, as in Table 2 of the paper.

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use nunet_core::pipeline::{Pipeline, PipelineOptions};
use nunet_engine::{Buffers, Engine, EngineOptions, MonotonicClock};
use serde_json::{Value, json};

use super::load::{load, tested_pipeline};
use crate::Outcome;
use crate::source::{BitDepthCheck, Fill, Frame, OpenOptions, SourceName, decode};
use nunet_sink::stdout::print;

mod paper;

use nunet_telemetry::{SERIES_HEAD, Series, host, peak_rss_mb};
use nunet_types::{counted, printable};

/// Whether each prediction is measured. The first three warm up, in addition to the self-test.
pub(super) fn predictions(runs: NonZeroU32) -> impl Iterator<Item = bool> {
    std::iter::repeat_n(false, 3).chain((0..runs.get()).map(|_| true))
}

/// The options of `bench`.
pub(crate) struct BenchOptions {
    pub(crate) models: Vec<PathBuf>,
    /// The image to predict from; `None` for the first of the demo scene.
    pub(crate) image: Option<PathBuf>,
    pub(crate) runs: NonZeroU32,
    pub(crate) engine: EngineOptions,
    pub(crate) json: bool,
}

/// Measures the models interleaved, so that a disturbance affects all of them.
pub(crate) fn bench(options: &BenchOptions) -> anyhow::Result<Outcome> {
    let frame = image_or_demo(options.image.as_deref())?;
    let engine = Engine::start(options.engine.clone())?;
    let mut subjects = Vec::new();
    for model in &options.models {
        let loaded = load(&engine, model)?;
        let (name, hash) = (loaded.name(), loaded.hash());
        subjects.push(Subject::new(name, hash, tested_pipeline(loaded, PipelineOptions::default())?));
    }
    for is_measured in predictions(options.runs) {
        for subject in &mut subjects {
            subject.predict(&frame, is_measured)?;
        }
    }
    for subject in &subjects {
        let text =
            if options.json { subject.json(&engine, options).to_string() } else { subject.text(options) };
        print(&text)?;
    }
    Ok(Outcome::Done)
}

/// The image that all predictions use.
pub(super) fn image_or_demo(image: Option<&Path>) -> anyhow::Result<Frame> {
    let mut frame = Frame::default();
    match image {
        Some(path) => {
            let decoded = decode(path, &mut frame)
                .with_context(|| format!("cannot read the image `{}`", path.display()))?;
            let place = format_args!("`{}`", path.display());
            BitDepthCheck::default().check(|| decoded.maximum_16_bit, place);
        }
        None => {
            let folders = nunet_engine::model_folders();
            let options = OpenOptions { model_folders: &folders, ..OpenOptions::default() };
            let fill = SourceName::demo().open(options)?.fill(&mut frame);
            if let Fill::Failed(error) | Fill::Broken(error) = fill {
                return Err(error.into());
            }
        }
    }
    Ok(frame)
}

/// The value of `--threads`, else the default of the graph: one per core.
fn threads(options: &BenchOptions) -> usize {
    let cores = std::thread::available_parallelism().ok();
    options.engine.threads.or(cores).map_or(1, std::num::NonZero::get)
}

/// A model and its times.
pub(super) struct Subject {
    pub(super) name: String,
    pub(super) hash: String,
    pipeline: Pipeline,
    buffers: Buffers,
    networks: Series,
    end_to_end: Series,
    stages: Vec<Series>,
}

impl Subject {
    /// The columns of [`Subject::end_to_end_row`].
    pub(super) const HEAD: &str = SERIES_HEAD;

    pub(super) fn new(name: String, hash: String, pipeline: Pipeline) -> Self {
        let stages = pipeline.stage_names().iter().map(|_| Series::default()).collect();
        Self {
            name,
            hash,
            buffers: Buffers::new(&pipeline),
            pipeline,
            networks: Series::default(),
            end_to_end: Series::default(),
            stages,
        }
    }

    pub(super) fn predict(&mut self, frame: &Frame, measured: bool) -> anyhow::Result<()> {
        // The predictions are independent: each starts from an empty state.
        self.pipeline.reset();
        let start = std::time::Instant::now();
        let report = self.pipeline.process(&frame.view()?, self.buffers.outputs(), &MonotonicClock)?;
        if measured {
            self.end_to_end.add_micros(start.elapsed().as_micros() as f64);
            for (series, &micros) in self.stages.iter_mut().zip(report.stages.micros()) {
                series.add_micros(micros.into());
            }
            self.networks.add_micros(self.network_micros(report.stages.micros()));
        }
        Ok(())
    }

    /// The median end-to-end latency.
    pub(super) fn median_ms(&self) -> f64 {
        self.end_to_end.quantile(0.5)
    }

    pub(super) fn end_to_end_row(&self, name: &str) -> String {
        self.end_to_end.row(name)
    }

    pub(super) fn end_to_end_json(&self) -> Value {
        self.end_to_end.json()
    }

    /// The time of the networks alone, which the paper calls a prediction.
    fn network_micros(&self, micros: &[u32]) -> f64 {
        let graph = self.pipeline.graph().stages();
        let named = self.pipeline.stage_names().iter().zip(micros);
        let networks = named.filter(|(name, _)| graph.iter().any(|stage| stage.name == **name));
        networks.map(|(_, &micros)| f64::from(micros)).sum()
    }

    fn json(&self, engine: &Engine, options: &BenchOptions) -> Value {
        let stages: serde_json::Map<_, _> = self
            .pipeline
            .stage_names()
            .iter()
            .zip(&self.stages)
            .map(|(name, series)| (name.clone(), series.json()))
            .collect();
        json!({
            "contract": nunet_ipc::CONTRACT_VERSION,
            "host": host(),
            "onnxruntime": engine.runtime().version(),
            "model": { "name": self.name, "hash": self.hash },
            "provider": self.pipeline.graph().provider().name(),
            "threads": threads(options),
            "runs": options.runs,
            "ms": self.networks.json(),
            "stages": stages,
            "end_to_end_ms": self.end_to_end.json(),
            "fps": 1e3 / self.end_to_end.mean_ms(),
            "peak_rss_mb": peak_rss_mb(),
            "paper_ms": paper::row(&self.pipeline).map(|row| row.json()),
        })
    }

    fn text(&self, options: &BenchOptions) -> String {
        let title = format!(
            "{} ({}), {}, provider {}",
            self.name,
            self.pipeline.graph().description().architecture,
            counted(options.runs.get(), "prediction"),
            self.pipeline.graph().provider()
        );
        let mut text = format!("{}\n  {SERIES_HEAD}\n", printable::one_line(&title));
        let stages = self.pipeline.stage_names().iter().map(String::as_str).zip(&self.stages);
        let sums = [("all networks", &self.networks), ("end to end", &self.end_to_end)];
        for (name, series) in stages.chain(sums) {
            text += &format!("  {}\n", series.row(name));
        }
        if let Some(paper) = paper::row(&self.pipeline) {
            text += &format!("  {}\n", paper.text());
        }
        text
    }
}
