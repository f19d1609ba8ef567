//! `nunetd infer`: depth, labels and cloud of single images, as files.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use nunet_core::clock::Clock as _;
use nunet_core::depth::Units;
use nunet_core::pipeline::{FrameReport, Pipeline};
use nunet_engine::{Buffers, Engine, EngineOptions, MonotonicClock, find_model};
use nunet_files::{ResultArrays, check_folder, write_json, write_results};
use nunet_sink::file_plan::FilePlan;
use nunet_sink::obstacle_images::ObstacleView;
use nunet_sink::obstacles::ObstacleStage;
use nunet_telemetry::{Counts, Latencies, Totals};
use nunet_types::counted;
use tracing::{error, info};

use super::load::{load_unless, obstacle_stage, tested_pipeline};
use crate::Outcome;
use crate::config::{ModelConfig, ObstacleConfig, ProcessingConfig};
use crate::exit::{BadArguments, warn_of_camera};
use crate::sink::stats::{Common, ModelName, Stats};
use crate::source::{
    BitDepthCheck, CameraResolver, Frame, Rotator, SourceName, decode, glance, list, listed_files,
};
use crate::stream::{Stop, Stopped};

/// The options of `infer`.
pub(crate) struct InferOptions {
    /// Files, folders and globs.
    pub(crate) images: Vec<PathBuf>,
    pub(crate) out: PathBuf,
    pub(crate) model: PathBuf,
    pub(crate) processing: ProcessingConfig,
    /// The settings of obstacles, if they were requested.
    pub(crate) obstacles: Option<ObstacleConfig>,
    pub(crate) engine: EngineOptions,
}

/// Processes the images in order and continues after a bad one. After a stop, the current image is finished.
pub(crate) fn infer(options: &InferOptions) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    match infer_unless(options, &stop) {
        Err(error) if error.is::<Stopped>() => {
            error!("{error}");
            Ok(Outcome::Lost)
        }
        outcome => outcome,
    }
}

fn infer_unless(options: &InferOptions, stop: &Stop) -> anyhow::Result<Outcome> {
    let images: Vec<PathBuf> = named_images(&options.images)?;
    let folders = result_folders(&images, &options.out)?;
    file_plan(options, &images, &folders).check()?;
    let camera = CameraResolver::new(&options.processing.geometry)?;
    check_folder(&options.out)?;
    refuse_no_images(&images)?;
    let engine = Engine::start(options.engine.clone())?;
    let loaded = load_unless(&engine, &ModelConfig { path: options.model.clone(), every: Vec::new() }, stop)?;
    let model = ModelName { name: loaded.name(), hash: loaded.hash() };
    let pipeline = tested_pipeline(loaded, options.processing.pipeline)?;
    let obstacles = obstacle_stage(options.obstacles, &pipeline)?;
    let mut work = Work { obstacles, ..Work::new(pipeline, camera, model) };

    let mut failures = Vec::new();
    let mut looked_at = 0;
    for (image, folder) in images.iter().zip(&folders).take_while(|_| !stop.requested()) {
        looked_at += 1;
        match work.infer(image, folder) {
            Ok(()) => info!("`{}` -> `{}`", image.display(), folder.display()),
            Err(error) => failures.push(error),
        }
    }
    let outcome = judge(failures, looked_at)?;
    if looked_at < images.len() {
        error!("stopped before {} of {}", images.len() - looked_at, counted(images.len(), "image"));
        return Ok(Outcome::Lost);
    }
    Ok(outcome)
}

/// The images in the given order; those of a folder or a glob sorted by name.
fn named_images(named: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut images = Vec::new();
    for name in named {
        let found = list(name)?;
        if found.is_empty() {
            let message = format!(
                "no image `{}`: neither a file nor a folder with JPEG or PNG images, and no file matches it as a glob",
                name.display()
            );
            let hint = "name an image, a folder of images, or a glob such as 'frames/*.jpg' (quoted)";
            bail!(BadArguments::new(message).with_hint(hint));
        }
        images.extend(found);
    }
    Ok(images)
}

/// Fails before the network is loaded if no file is an image.
fn refuse_no_images(images: &[PathBuf]) -> anyhow::Result<()> {
    let mut failures = Vec::new();
    for image in images {
        match glance(image) {
            Ok(()) => return Ok(()),
            Err(error) => failures.push(unreadable(error.into(), image)),
        }
    }
    judge(failures, images.len()).map(drop)
}

fn unreadable(error: anyhow::Error, image: &Path) -> anyhow::Error {
    error.context(format!("cannot read the image `{}`", image.display()))
}

/// The outcome: a failure if every image failed, a loss if some did.
fn judge(mut failures: Vec<anyhow::Error>, images: usize) -> anyhow::Result<Outcome> {
    if failures.is_empty() {
        return Ok(Outcome::Done);
    }
    let (failed, last) = (failures.len(), failures.pop());
    for failure in failures {
        error!("{failure:#}");
    }
    match last {
        Some(last) if failed == images => Err(last),
        last => {
            last.into_iter().for_each(|last| error!("{last:#}"));
            error!("{failed} of {} failed", counted(images, "image"));
            Ok(Outcome::Lost)
        }
    }
}

/// `--out` itself for one image, else one folder below it per image.
fn result_folders(images: &[PathBuf], out: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if images.len() == 1 {
        return Ok(vec![out.to_owned()]);
    }
    let mut seen = HashSet::new();
    let mut folders = Vec::new();
    for image in images {
        let stem = image.file_stem().with_context(|| format!("`{}` names no file", image.display()))?;
        if !seen.insert(stem) {
            let folder = out.join(stem);
            let message = format!(
                "two images are called `{}`: both results would go to `{}`",
                stem.display(),
                folder.display()
            );
            bail!(BadArguments::new(message).with_hint("run nunetd for each with its own --out"));
        }
        folders.push(out.join(stem));
    }
    Ok(folders)
}

fn file_plan(options: &InferOptions, images: &[PathBuf], folders: &[PathBuf]) -> FilePlan {
    let mut files = FilePlan::default();
    let names = options.images.iter().map(|name| SourceName::parse(&name.to_string_lossy()));
    names.for_each(|name| files.read_source("an image", &name));
    let named = options.images.iter().flat_map(|name| listed_files(name));
    named.chain(images.iter().cloned()).for_each(|image| files.read("an image", image));
    find_model(&options.model).iter().for_each(|model| files.read_model(model));
    options.processing.geometry.calibration.iter().for_each(|file| files.read("the calibration", file));
    // A new folder has no files to overwrite.
    for folder in folders.iter().filter(|folder| folder.exists()) {
        files.write_results(folder);
        files.write("a result", folder.join("stats.json"));
    }
    files
}

/// The pipeline and its buffers, reused for each image.
struct Work {
    pipeline: Pipeline,
    rotator: Option<Rotator>,
    camera: CameraResolver,
    model: ModelName,
    frame: Frame,
    bit_depth: BitDepthCheck,
    buffers: Buffers,
    obstacles: Option<ObstacleStage>,
}

impl Work {
    fn new(pipeline: Pipeline, camera: CameraResolver, model: ModelName) -> Self {
        let (buffers, frame) = (Buffers::new(&pipeline), Frame::default());
        let rotator = camera.rotation().map(Rotator::new);
        let bit_depth = BitDepthCheck::default();
        Self { buffers, pipeline, rotator, camera, model, frame, bit_depth, obstacles: None }
    }

    fn infer(&mut self, image: &Path, folder: &Path) -> anyhow::Result<()> {
        let start_nanos = MonotonicClock.nanos();
        let rotator = self.rotator.as_mut();
        let maximum = decode(image, &mut self.frame)
            .and_then(|decoded| {
                rotator.map_or(Ok(()), |rotator| rotator.rotate(&mut self.frame))?;
                Ok(decoded.maximum_16_bit)
            })
            .map_err(|error| unreadable(error.into(), image))?;
        self.bit_depth.check(|| maximum, format_args!("`{}`", image.display()));
        let ready_nanos = MonotonicClock.nanos();
        warn_of_camera(&self.camera.update(&self.frame, &mut self.pipeline)?);
        // The images are independent.
        self.pipeline.reset_with_scale();
        let report = self.pipeline.process(&self.frame.view()?, self.buffers.outputs(), &MonotonicClock)?;
        nunet_sink::image_check::warn_of_image(image, &report, &self.pipeline);
        let done_nanos = MonotonicClock.nanos();
        write_results(folder, &self.results(&report))?;
        self.write_obstacles(image, folder)?;
        let stats = self.stats(image, &report, [start_nanos, ready_nanos, done_nanos]);
        Ok(write_json(&folder.join("stats.json"), &stats)?)
    }

    /// Writes the obstacles of the image, if they were requested.
    fn write_obstacles(&mut self, path: &Path, folder: &Path) -> anyhow::Result<()> {
        let Some(stage) = &mut self.obstacles else { return Ok(()) };
        let (config, image) = (*stage.config(), self.buffers.depth_image(&self.pipeline));
        let (camera, name) = (self.pipeline.points_camera(), format!("`{}`", path.display()));
        let found = stage.detect_alone(camera, &image, &name, std::time::Instant::now())?;
        let image = self.frame.view()?;
        let rgb = self.pipeline.network_image(&image);
        ObstacleView { found, config: &config, pipeline: &self.pipeline, rgb }.write(folder)
    }

    fn results(&self, report: &FrameReport) -> ResultArrays<'_> {
        ResultArrays {
            size: self.pipeline.size(),
            depth: self.buffers.depth(),
            metric: report.units == Units::Metre,
            labels: self.buffers.labels(),
            confidence: self.pipeline.confidence(),
            cloud: Some(self.buffers.cloud()),
        }
    }

    fn stats(&self, image: &Path, report: &FrameReport, [start, ready, done]: [u64; 3]) -> Stats {
        let micros = |from: u64, to: u64| (to - from) / 1000;
        let names = std::iter::once("read").chain(self.pipeline.stage_names().iter().map(String::as_str));
        let mut latencies = Latencies::new(names);
        let inner = report.stages.micros().iter().map(|&stage| stage.into());
        latencies.record(micros(start, done), std::iter::once(micros(start, ready)).chain(inner));
        let mut totals = Totals::default();
        totals.start(start);
        totals.add_published(done, self.frame.bytes_copied + report.bytes_copied);
        let counts = Counts { captured: 1, published: 1, ..Counts::default() };
        let camera = image.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        let graph = self.pipeline.graph();
        let (provider, classes) = (graph.provider().to_string(), &graph.description().classes);
        let common = Common { model: &self.model, provider: &provider, classes };
        Stats::new(camera, common, self.pipeline.scale(), counts, &totals, &latencies)
            .with_view(self.pipeline.framing().view())
    }
}
