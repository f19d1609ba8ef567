//! `nunetd eval`: the production pipeline against pictures with true depth, and the mean image beside it.

use std::io::Write as _;
use std::path::Path;

use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};
use nunet_core::depth::Encoding;
use nunet_core::pipeline::{Outputs, Pipeline};
use tracing::{error, warn};

use crate::Outcome;
use crate::cli::{CameraArgs, EvalArgs};
use crate::engine::{Engine, tested_pipeline};
use crate::sink::files::make_folder;
use crate::sink::stats::{ModelName, write_json};
use crate::source::Frame;
use crate::stream::Optics;
use crate::telemetry::MonotonicClock;

mod comparison;
mod dataset;
mod metrics;
mod report;
mod sheet;
mod unpack;

use comparison::{Baseline, Comparison, Kind, MeanImage};
use dataset::{Dataset, Truth, read_ids, same_size};
use metrics::LabelMetrics;
use report::{PictureRow, Report};
use sheet::{Row, Sheet, chosen};

/// Measures every picture; one that cannot be read is named and counted.
pub(super) fn eval(arguments: &EvalArgs) -> anyhow::Result<Outcome> {
    let optics = Optics::new(&arguments.lens.geometry)?;
    if let Some(out) = &arguments.out {
        make_folder(out)?;
    }
    let engine = Engine::start(&arguments.engine)?;
    let loaded = engine.load(&arguments.model, &[])?;
    let model = ModelName { name: loaded.name(), hash: loaded.hash() };
    let camera = CameraArgs { lens: arguments.lens.clone(), ..CameraArgs::default() };
    let pipeline = tested_pipeline(loaded, &camera)?;
    let dataset = Dataset::open(arguments, &pipeline.graph().description().classes)?;
    if pipeline.graph().has_labels() && !dataset.has_labels() {
        warn!("no true labels of this network's classes: only depth is measured");
    }
    let baseline = baseline(arguments, &dataset)?;
    let mut work = Work::new(arguments, pipeline, optics, baseline);
    let skipped = dataset.unpaired + work.measure_all(&dataset)?;
    let report = work.report(arguments, model, skipped);
    let text = if arguments.json { serde_json::to_string(&report)? } else { report.text() };
    writeln!(std::io::stdout(), "{text}")?;
    if let Some(out) = &arguments.out {
        write_json(&out.join("eval.json"), &report)?;
        report::write_csv(&out.join("pictures.csv"), &work.rows)?;
        work.write_sheet(&dataset, &out.join("contact_sheet.png"))?;
    }
    Ok(if skipped == 0 { Outcome::Done } else { Outcome::Lost })
}

/// The mean image: of the pictures that the user named, who must all be readable, else of those that are measured.
fn baseline(arguments: &EvalArgs, dataset: &Dataset) -> anyhow::Result<Option<Baseline>> {
    let named = arguments.baseline_ids.as_deref().map(read_ids).transpose()?;
    let mut mean = MeanImage::default();
    let progress = progress("mean image", named.as_ref().unwrap_or(&dataset.ids).len());
    for id in named.as_ref().unwrap_or(&dataset.ids) {
        progress.inc(1);
        let truth = match dataset.truth(id) {
            Ok(truth) => truth,
            Err(_) if named.is_none() => continue, // told when its turn to be measured comes
            Err(error) => return Err(error),
        };
        if let Err(error) = mean.add(&truth.depth_m, truth.size) {
            warn!("no baseline: {error}");
            return Ok(None);
        }
    }
    progress.finish_and_clear();
    Ok(mean.baseline(arguments.protocol))
}

/// The last part of the dataset's path.
fn name_of(dataset: &Path) -> String {
    let path = dataset.canonicalize().unwrap_or_else(|_| dataset.to_owned());
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Seen on a terminal only.
fn progress(what: &'static str, count: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{prefix} {wide_bar} {pos}/{len} {per_sec} {eta} left");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(count as u64).with_style(style).with_prefix(what)
}

/// The pipeline, and what was found so far.
struct Work {
    pipeline: Pipeline,
    optics: Optics,
    frame: Frame,
    depth: Vec<f32>,
    labels: Vec<u8>,
    comparison: Comparison,
    confusion: LabelMetrics,
    baseline: Option<Baseline>,
    rows: Vec<PictureRow>,
}

/// What the network says of a picture, at the picture's size.
struct Prediction {
    depth: Vec<f32>,
    labels: Vec<u8>,
}

impl Work {
    fn new(arguments: &EvalArgs, pipeline: Pipeline, optics: Optics, baseline: Option<Baseline>) -> Self {
        let (width, height) = pipeline.size();
        let pixels = width as usize * height as usize;
        let description = pipeline.graph().description();
        let kind = match description.encoding {
            Encoding::MinMax => Kind::MinMax,
            Encoding::Relative => Kind::Relative,
            Encoding::Metric | Encoding::Inverse | Encoding::Log => Kind::Metric,
        };
        Self {
            optics,
            frame: Frame::default(),
            depth: vec![0.0; pixels],
            labels: if pipeline.graph().has_labels() { vec![0; pixels] } else { Vec::new() },
            comparison: Comparison::new(arguments.protocol, kind),
            confusion: LabelMetrics::new(description.classes.len()),
            baseline,
            rows: Vec::new(),
            pipeline,
        }
    }

    /// Measures every picture and returns how many could not be; an error when none could.
    fn measure_all(&mut self, dataset: &Dataset) -> anyhow::Result<u64> {
        let mut last = None;
        let mut skipped = 0;
        let progress = progress("pictures", dataset.ids.len());
        for id in &dataset.ids {
            if let Err(failure) = self.measure(dataset, id) {
                progress.suspend(|| error!("skipped `{id}`: {failure:#}"));
                skipped += 1;
                last = Some(failure);
            }
            progress.inc(1);
        }
        progress.finish_and_clear();
        match last {
            Some(last) if self.rows.is_empty() => Err(last.context("no picture could be measured")),
            _ => Ok(skipped),
        }
    }

    fn measure(&mut self, dataset: &Dataset, id: &str) -> anyhow::Result<()> {
        let truth = dataset.truth(id)?;
        let prediction = self.predict(dataset, id, &truth)?;
        let alone = self.comparison.add(&prediction.depth, &truth.depth_m, truth.size)?;
        if let Some(labels) = &truth.labels {
            self.confusion.add(&prediction.labels, labels);
        }
        if let Some(baseline) = &mut self.baseline {
            baseline.add(&truth.depth_m, truth.size)?;
        }
        self.rows.push(PictureRow::new(id, &alone));
        Ok(())
    }

    fn predict(&mut self, dataset: &Dataset, id: &str, truth: &Truth) -> anyhow::Result<Prediction> {
        dataset.picture(id, &mut self.frame)?;
        same_size(Path::new(id), self.frame.size, truth.size)?;
        self.optics.follow(&self.frame, &mut self.pipeline)?;
        let labels = (!self.labels.is_empty()).then_some(&mut self.labels[..]);
        let outputs = Outputs { depth_m: &mut self.depth, labels, cloud: None };
        self.pipeline.process(&self.frame.view()?, outputs, &MonotonicClock)?;
        let from = self.pipeline.size();
        Ok(Prediction {
            depth: resized_depth(&self.depth, from, truth.size),
            labels: resized_labels(&self.labels, from, truth.size),
        })
    }

    fn report(&self, arguments: &EvalArgs, model: ModelName, skipped: u64) -> Report {
        Report::new(
            &report::What {
                model,
                dataset: name_of(&arguments.dataset),
                protocol: arguments.protocol,
                baseline_of: if arguments.baseline_ids.is_some() {
                    "baseline-ids"
                } else {
                    "measured pictures"
                },
                pictures: self.rows.len() as u64,
                skipped,
            },
            &self.pipeline,
            &self.comparison,
            &self.confusion,
            self.baseline.as_ref(),
        )
    }

    /// Predicts the chosen pictures once more: nine, where all would not fit into memory.
    fn write_sheet(&mut self, dataset: &Dataset, path: &Path) -> anyhow::Result<()> {
        let errors: Vec<f64> = self.rows.iter().map(PictureRow::error).collect();
        let mut sheet = Sheet::new();
        for (group, place) in chosen(&errors) {
            let Some(row) = self.rows.get(place) else { continue };
            let (id, caption) = (row.id.clone(), format!("{group}: {}", row.caption()));
            let truth = dataset.truth(&id)?;
            let prediction = self.predict(dataset, &id, &truth)?;
            sheet.add(&Row {
                caption,
                size: truth.size,
                rgb: self.frame.view()?.bytes(),
                truth: &truth.depth_m,
                predicted: &prediction.depth,
                metric: self.comparison.kind() == Kind::Metric,
            });
        }
        sheet.picture().save(path).with_context(|| format!("cannot write `{}`", path.display()))
    }
}

/// `[H, W]` depth of a picture of size `from` at size `to`, bilinear over the pixels that have depth; pixel centres as
/// the network's own enlargement has them.
fn resized_depth(depth: &[f32], from: (u32, u32), to: (u32, u32)) -> Vec<f32> {
    if from == to {
        return depth.to_vec();
    }
    let place = |index: u32, from: u32, to: u32| {
        let at = ((f64::from(index) + 0.5) * f64::from(from) / f64::from(to) - 0.5)
            .clamp(0.0, f64::from(from - 1));
        let low = at.floor();
        (low as usize, ((low as usize) + 1).min(from as usize - 1), (at - low) as f32)
    };
    let at =
        |row: usize, column: usize| depth.get(row * from.0 as usize + column).copied().unwrap_or(f32::NAN);
    let pixel = |row: u32, column: u32| {
        let ((top, bottom, down), (left, right, across)) =
            (place(row, from.1, to.1), place(column, from.0, to.0));
        let taps = [
            (at(top, left), (1.0 - down) * (1.0 - across)),
            (at(top, right), (1.0 - down) * across),
            (at(bottom, left), down * (1.0 - across)),
            (at(bottom, right), down * across),
        ];
        let known = taps.iter().filter(|(depth, _)| depth.is_finite());
        let (sum, weight) =
            known.fold((0.0, 0.0), |(sum, all), (depth, weight)| (sum + depth * weight, all + weight));
        if weight > 0.0 { sum / weight } else { f32::NAN }
    };
    (0..to.1)
        .flat_map(|row| (0..to.0).map(move |column| (row, column)))
        .map(|(row, column)| pixel(row, column))
        .collect()
}

/// The same of labels: the nearest.
fn resized_labels(labels: &[u8], from: (u32, u32), to: (u32, u32)) -> Vec<u8> {
    if from == to || labels.is_empty() {
        return labels.to_vec();
    }
    let nearest = |index: u32, from: u32, to: u32| {
        (u64::from(2 * index + 1) * u64::from(from) / (2 * u64::from(to))).min(u64::from(from) - 1) as usize
    };
    let rows = (0..to.1).map(|row| nearest(row, from.1, to.1));
    let columns: Vec<usize> = (0..to.0).map(|column| nearest(column, from.0, to.0)).collect();
    let label = |at: usize| labels.get(at).copied().unwrap_or(metrics::IGNORE);
    rows.flat_map(|row| columns.iter().map(move |column| row * from.0 as usize + column)).map(label).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_keeps_its_metres_at_every_size() {
        for to in [(3, 2), (8, 6), (5, 9)] {
            let resized = resized_depth(&[5.0; 4 * 3], (4, 3), to);
            assert_eq!(resized.len(), (to.0 * to.1) as usize);
            assert!(resized.iter().all(|depth| (depth - 5.0).abs() < 1e-6), "{resized:?}");
        }
    }

    #[test]
    fn depth_between_pixels_is_between_theirs_and_none_spreads_nowhere() {
        assert_eq!(resized_depth(&[2.0, 4.0], (2, 1), (4, 1)), [2.0, 2.5, 3.5, 4.0]);
        assert_eq!(resized_depth(&[2.0, f32::NAN], (2, 1), (4, 1))[..3], [2.0; 3]);
        assert!(resized_depth(&[2.0, f32::NAN], (2, 1), (4, 1))[3].is_nan());
    }

    #[test]
    fn labels_are_those_of_the_nearest_pixel() {
        assert_eq!(resized_labels(&[1, 2, 3, 4], (2, 2), (4, 2)), [1, 1, 2, 2, 3, 3, 4, 4]);
        assert_eq!(resized_labels(&[1, 2, 3], (3, 1), (1, 1)), [2]);
    }
}
