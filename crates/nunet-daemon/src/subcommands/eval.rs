//! `nunetd eval`: the production pipeline against images with true depth, and the mean image beside it.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;

use anyhow::Context as _;
use image::RgbImage;
use nunet_core::depth::DepthEncoding;
use nunet_core::pipeline::{Outputs, Pipeline};
use tracing::{error, warn};

use super::progress::progress;
use crate::Outcome;
use crate::cli::{CameraArgs, EvalArgs};
use crate::engine::{Engine, tested_pipeline};
use crate::sink::files::{check_folder, make_folder};
use crate::sink::stats::{ModelName, write_json};
use crate::source::Frame;
use crate::stream::CameraResolver;
use crate::telemetry::MonotonicClock;

mod baseline;
mod comparison;
mod dataset;
mod metrics;
mod pairs;
mod report;
mod resized;
mod sheet;
mod unpack;

use baseline::Baseline;
use comparison::{Comparison, Kind, beyond_hint};
use dataset::{Dataset, Truth};
use metrics::LabelMetrics;
use report::{PictureRow, Report};
use resized::Fit;
use sheet::{Row, chosen};
use unpack::{is_recording, refuse_own_depth};

/// The share of truth beyond what is compared from which on its scale looks wrong.
const MUCH_BEYOND: f64 = 0.05;

/// Measures every image; one that cannot be read is named and counted.
pub(super) fn eval(arguments: &EvalArgs) -> anyhow::Result<Outcome> {
    refuse_own_depth(arguments)?;
    let optics = CameraResolver::new(&arguments.lens.geometry.options())?;
    if let Some(out) = &arguments.out {
        check_folder(out)?;
    }
    let clip = arguments.clip || is_recording(&arguments.dataset);
    let engine = Engine::start(&arguments.engine)?;
    let loaded = engine.load(&arguments.model, &[])?;
    let model = ModelName { name: loaded.name(), hash: loaded.hash() };
    let (lens, filters) = (arguments.lens.clone(), arguments.filters.clone());
    let camera = CameraArgs { lens, filters, ..CameraArgs::default() };
    let pipeline = tested_pipeline(loaded, &camera)?;
    let dataset = Dataset::open(arguments, &pipeline.graph().description().classes)?;
    if pipeline.graph().has_labels() && !dataset.has_labels() {
        warn!("no true labels of this network's classes: only depth is measured");
    }
    let baseline = Baseline::of(arguments, &dataset)?;
    let mut work = Work::new(arguments, pipeline, optics, baseline, clip);
    let skipped = dataset.unpaired + work.measure_all(&dataset)?;
    work.comparison.check_truth()?;
    warn_of_truth_beyond(&work.comparison);
    let report = work.report(arguments, model, skipped);
    let text = if arguments.json { serde_json::to_string(&report)? } else { report.text() };
    writeln!(std::io::stdout(), "{text}")?;
    if let Some(out) = &arguments.out {
        make_folder(out)?;
        write_json(&out.join("eval.json"), &report)?;
        report::write_csv(&out.join("pictures.csv"), &work.rows)?;
        if let Some(baseline) = &work.baseline {
            baseline.write(&out.join("mean_image.npy"))?;
        }
        work.write_sheet(&dataset, &out.join("contact_sheet.png"))?;
    }
    if skipped > 0 {
        error!("images that were skipped: {skipped}");
    }
    Ok(if skipped == 0 { Outcome::Done } else { Outcome::Lost })
}

/// Some truth beyond the cap is in every dataset; much of it is a wrong unit or a wrong cap.
fn warn_of_truth_beyond(comparison: &Comparison) {
    let share = comparison.share_beyond();
    if let Some(far_m) = comparison.farthest_m().filter(|_| share > MUCH_BEYOND) {
        warn!(
            "{:.0} % of the true depth is at {} m or beyond and is not compared\nhint: {}",
            100.0 * share,
            comparison.cap_m(),
            beyond_hint(far_m)
        );
    }
}

/// The last part of the dataset's path.
fn name_of(dataset: &Path) -> String {
    let path = dataset.canonicalize().unwrap_or_else(|_| dataset.to_owned());
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The pipeline, and what was found so far.
struct Work {
    pipeline: Pipeline,
    optics: CameraResolver,
    frame: Frame,
    depth: Vec<f32>,
    labels: Vec<u8>,
    comparison: Comparison,
    confusion: LabelMetrics,
    baseline: Option<Baseline>,
    rows: Vec<PictureRow>,
    /// Whether each image follows the one before it.
    clip: bool,
}

/// Which failures were reported: the same one of hundreds of images is reported once, and counted.
#[derive(Default)]
struct Reported(BTreeMap<String, u64>);

impl Reported {
    fn is_new(&mut self, id: &str, failure: &anyhow::Error) -> bool {
        let count = self.0.entry(format!("{failure:#}").replace(id, "ID")).or_default();
        *count += 1;
        *count == 1
    }

    fn summarize(&self) {
        for (failure, count) in self.0.iter().filter(|(_, count)| **count > 1) {
            error!("skipped {count} images for the same reason: {failure}");
        }
    }
}

/// What the network predicts for an image, at the image's size.
struct Prediction {
    depth: Vec<f32>,
    labels: Vec<u8>,
}

impl Work {
    fn new(
        arguments: &EvalArgs,
        pipeline: Pipeline,
        optics: CameraResolver,
        baseline: Option<Baseline>,
        clip: bool,
    ) -> Self {
        let (width, height) = pipeline.size();
        let pixels = width as usize * height as usize;
        let description = pipeline.graph().description();
        let kind = match description.encoding {
            DepthEncoding::MinMax => Kind::MinMax,
            DepthEncoding::Relative | DepthEncoding::RelativeInverse => Kind::Relative,
            DepthEncoding::Metric | DepthEncoding::Inverse | DepthEncoding::Log => Kind::Metric,
        };
        Self {
            optics,
            frame: Frame::default(),
            depth: vec![0.0; pixels],
            labels: if pipeline.graph().has_labels() { vec![0; pixels] } else { Vec::new() },
            comparison: Comparison::new(arguments.protocol, arguments.depth_cap as f32, kind),
            confusion: LabelMetrics::new(description.classes.len()),
            baseline,
            rows: Vec::new(),
            clip,
            pipeline,
        }
    }

    /// Measures every image and returns how many could not be; an error when none could.
    fn measure_all(&mut self, dataset: &Dataset) -> anyhow::Result<u64> {
        let mut last = None;
        let mut skipped = 0;
        let mut reported = Reported::default();
        let progress = progress("pictures", Some(dataset.ids.len() as u64));
        for id in &dataset.ids {
            if let Err(failure) = self.measure(dataset, id) {
                if reported.is_new(id, &failure) {
                    progress.suspend(|| error!("skipped `{id}`: {failure:#}"));
                }
                skipped += 1;
                last = Some(failure);
            }
            progress.inc(1);
        }
        progress.finish_and_clear();
        reported.summarize();
        match last {
            Some(last) if self.rows.is_empty() => Err(last.context("no image could be measured")),
            _ => Ok(skipped),
        }
    }

    fn measure(&mut self, dataset: &Dataset, id: &str) -> anyhow::Result<()> {
        let (truth, prediction) = self.predict(dataset, id)?;
        if let Some(baseline) = &self.baseline {
            baseline.check_size(truth.size)?; // before anything is counted
        }
        let alone = self.comparison.add(&prediction.depth, &truth.depth_m, truth.size)?;
        if let Some(labels) = &truth.labels {
            self.confusion.add(&prediction.labels, labels);
        }
        if let Some(baseline) = &mut self.baseline {
            baseline.add(id, &truth.depth_m, truth.size)?;
        }
        self.rows.push(PictureRow::new(id, &alone));
        Ok(())
    }

    fn predict(&mut self, dataset: &Dataset, id: &str) -> anyhow::Result<(Truth, Prediction)> {
        dataset.picture(id, &mut self.frame)?;
        let truth = dataset.truth(id, Some(self.frame.size))?;
        if !self.clip {
            self.pipeline.reset();
        }
        self.optics.update(&self.frame, &mut self.pipeline)?;
        let labels = (!self.labels.is_empty()).then_some(&mut self.labels[..]);
        let outputs = Outputs { depth_m: &mut self.depth, labels, cloud: None };
        self.pipeline.process(&self.frame.view()?, outputs, &MonotonicClock)?;
        let fit = Fit::new(&self.pipeline, truth.size);
        let prediction = Prediction { depth: fit.depth(&self.depth)?, labels: fit.labels(&self.labels)? };
        Ok((truth, prediction))
    }

    fn report(&self, arguments: &EvalArgs, model: ModelName, skipped: u64) -> Report {
        Report::new(
            &report::What {
                model,
                dataset: name_of(&arguments.dataset),
                protocol: arguments.protocol,
                pictures: self.rows.len() as u64,
                skipped,
            },
            &self.pipeline,
            &self.comparison,
            &self.confusion,
            self.baseline.as_ref(),
        )
    }

    /// Predicts the chosen images once more, nine, where all would not fit into memory; of a clip, whatever leads up to
    /// them as well.
    fn write_sheet(&mut self, dataset: &Dataset, path: &Path) -> anyhow::Result<()> {
        let errors: Vec<f64> = self.rows.iter().map(PictureRow::error).collect();
        let chosen = chosen(&errors);
        let mut strips = vec![None; chosen.len()];
        self.pipeline.reset();
        for id in &dataset.ids {
            let is_this = |&(_, place): &(&str, usize)| self.rows[place].id == *id;
            if let Some(index) = chosen.iter().position(is_this) {
                let (group, place) = chosen[index];
                let caption = format!("{group}: {}", self.rows[place].caption());
                strips[index] = Some(self.strip(dataset, id, caption)?);
            } else if self.clip {
                let _told_before = self.predict(dataset, id);
            }
        }
        let sheet = sheet::stacked(&strips.into_iter().flatten().collect::<Vec<_>>());
        sheet.save(path).with_context(|| format!("cannot write `{}`", path.display()))
    }

    fn strip(&mut self, dataset: &Dataset, id: &str, caption: String) -> anyhow::Result<RgbImage> {
        let (truth, prediction) = self.predict(dataset, id)?;
        let row = Row {
            caption,
            size: truth.size,
            rgb: self.frame.view()?.bytes(),
            truth: &truth.depth_m,
            predicted: &prediction.depth,
            metric: self.comparison.kind() == Kind::Metric,
        };
        Ok(row.strip())
    }
}
