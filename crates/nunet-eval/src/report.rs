//! The report: as JSON, as a table, and one row per image.

use std::path::Path;

use nunet_core::depth::DepthKind;
use nunet_core::pipeline::Pipeline;
use nunet_engine::ModelName;
use nunet_files::write_whole;
use nunet_types::{CONTRACT_VERSION, ScaleSource, counted, printable};
use serde::Serialize;

use crate::baseline::{Baseline, BaselineSource};
use crate::comparison::Comparison;
use crate::error::EvalError;
use crate::metrics::{DepthMetrics, DepthScores, LabelMetrics, LabelScores};
use crate::obstacles::ObstacleScores;
use crate::options::Protocol;
use crate::sparsification::SparsificationScores;

/// Everything that was found. Its fields are those of `eval.json`: serialize it.
#[derive(Debug, Serialize)]
pub struct Report {
    contract: u32,
    model: ModelName,
    architecture: String,
    dataset: String,
    protocol: &'static str,
    depth_cap_m: f32,
    units: &'static str,
    scale_source: &'static str,
    /// Images whose scale was measured on the floor; `None` if that was not requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    floor_images: Option<u64>,
    filters: Vec<String>,
    #[serde(rename = "pictures")]
    images: u64,
    skipped: u64,
    pixels: u64,
    pixels_without_prediction: u64,
    pixels_beyond: u64,
    metrics: Scores<DepthScores>,
    image_mean: Scores<DepthScores>,
    minmax: Scores<Stretched>,
    labels: Scores<LabelScores>,
    baseline: Option<BaselineReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sparsification: Option<SparsificationScores>,
    #[serde(skip_serializing_if = "Option::is_none")]
    obstacles: Option<ObstacleScores>,
}

/// Scores, `{}` where nothing could be measured.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(untagged)]
enum Scores<T> {
    Measured(T),
    Nothing {},
}

impl<T: Copy> Scores<T> {
    fn measured(&self) -> Option<T> {
        match *self {
            Self::Measured(scores) => Some(scores),
            Self::Nothing {} => None,
        }
    }
}

impl<T> From<Option<T>> for Scores<T> {
    fn from(scores: Option<T>) -> Self {
        scores.map_or(Self::Nothing {}, Self::Measured)
    }
}

/// Errors of depth stretched to 0..1 per image, as the paper measured.
#[derive(Debug, Clone, Copy, Serialize)]
struct Stretched {
    mse: f64,
    rmse: f64,
}

impl Stretched {
    fn of(metrics: &DepthMetrics) -> Option<Self> {
        metrics.scores().map(|scores| Self { mse: scores.mse, rmse: scores.rmse })
    }
}

/// The same of the mean image.
#[derive(Debug, Serialize)]
struct BaselineReport {
    /// Whose mean it is.
    of: BaselineSource,
    metrics: Scores<DepthScores>,
    image_mean: Scores<DepthScores>,
    minmax: Scores<Stretched>,
}

/// What was measured.
pub(crate) struct Measured {
    pub(crate) model: ModelName,
    pub(crate) dataset: String,
    pub(crate) protocol: Protocol,
    pub(crate) images: u64,
    pub(crate) skipped: u64,
    pub(crate) scale: MeasuredScale,
}

/// Where the scale of the images comes from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeasuredScale {
    /// `mixed` if it differs, because only some images have a camera or show enough floor.
    source: &'static str,
    /// Images whose scale was measured on the floor; `None` if that was not requested.
    floor_images: Option<u64>,
}

impl MeasuredScale {
    /// That of the images in `rows`.
    pub(crate) fn of(rows: &[ImageRow], uses_floor: bool) -> Self {
        let mut sources = rows.iter().map(|row| row.scale_source);
        let source = match sources.next() {
            Some(first) if sources.all(|source| source == first) => first.name(),
            _ => "mixed",
        };
        let is_measured = |row: &&ImageRow| row.scale_source == ScaleSource::Floor;
        let floor_images = uses_floor.then(|| rows.iter().filter(is_measured).count() as u64);
        Self { source, floor_images }
    }
}

impl Report {
    pub(crate) fn new(
        what: Measured,
        pipeline: &Pipeline,
        comparison: &Comparison,
        labels: &LabelMetrics,
        baseline: Option<&Baseline>,
    ) -> Self {
        Self {
            contract: CONTRACT_VERSION,
            model: what.model,
            architecture: pipeline.graph().description().architecture.clone(),
            dataset: what.dataset,
            protocol: what.protocol.name(),
            depth_cap_m: comparison.cap_m(),
            units: pipeline.scale().units.name(),
            scale_source: what.scale.source,
            floor_images: what.scale.floor_images,
            filters: pipeline.filters().specs().map(|filter| filter.to_string()).collect(),
            images: what.images,
            skipped: what.skipped,
            pixels: comparison.compared().pixels,
            pixels_without_prediction: comparison.compared().missing,
            pixels_beyond: comparison.beyond,
            metrics: comparison.depth.scores().into(),
            image_mean: comparison.each.scores().into(),
            minmax: Stretched::of(&comparison.minmax).into(),
            labels: labels.scores().into(),
            baseline: baseline.map(|baseline| BaselineReport {
                of: baseline.of,
                metrics: baseline.metric.depth.scores().into(),
                image_mean: baseline.metric.each.scores().into(),
                minmax: Stretched::of(baseline.minmax()).into(),
            }),
            sparsification: None,
            obstacles: None,
        }
    }

    /// The same with the sparsification, if the network has a confidence.
    pub(crate) fn with_sparsification(self, sparsification: Option<SparsificationScores>) -> Self {
        Self { sparsification, ..self }
    }

    /// The same with what was found of obstacles.
    pub(crate) fn with_obstacles(self, obstacles: Option<ObstacleScores>) -> Self {
        Self { obstacles, ..self }
    }

    /// What was found of obstacles, if they were compared.
    #[must_use]
    pub fn obstacles(&self) -> Option<&ObstacleScores> {
        self.obstacles.as_ref()
    }

    /// Errors of depth in meters; `None` for a network without meters.
    #[must_use]
    pub fn depth(&self) -> Option<DepthScores> {
        self.metrics.measured()
    }

    /// A table of the network and the mean image side by side, without a final newline.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = self.header() + &self.depth_lines();
        if let Some(labels) = self.labels.measured() {
            text += &line("labels miou", labels.miou, None);
            text += &line("labels acc.", labels.accuracy, None);
        }
        text += &self.sparsification.as_ref().map(sparsification_lines).unwrap_or_default();
        text += &self.obstacles.as_ref().map(ObstacleScores::text).unwrap_or_default();
        text += &format!(
            "{} compared, {} without a prediction, {} with true depth outside of what is compared",
            counted(self.pixels, "pixel"),
            self.pixels_without_prediction,
            self.pixels_beyond
        );
        text
    }

    fn header(&self) -> String {
        let Self { model, architecture, dataset, images, skipped, protocol, .. } = self;
        let (images, scale) = (counted(*images, "image"), self.scale_source);
        let floor = self.floor_images.map(|floor| format!(", measured on the floor of {floor} of {images}"));
        let title = format!(
            "{} ({architecture}) on {dataset}: {images}, {skipped} skipped, protocol {protocol}, scale {scale}{}",
            model.name,
            floor.unwrap_or_default()
        );
        format!("{}\n{:<15}{:>9}{:>12}\n", printable::one_line(&title), "", "network", "mean image")
    }

    fn depth_lines(&self) -> String {
        let mut text = String::new();
        let trivial = self.baseline.as_ref();
        if let Some(scores) = self.metrics.measured() {
            let beside = trivial.and_then(|baseline| baseline.metrics.measured());
            for (index, (name, value)) in scores.named().into_iter().enumerate() {
                text += &line(name, value, beside.map(|scores| scores.named()[index].1));
            }
        }
        if let Some(scores) = self.image_mean.measured() {
            let beside = trivial.and_then(|baseline| baseline.image_mean.measured());
            text += &line("rmse, averaged", scores.rmse, beside.map(|scores| scores.rmse));
        }
        if let Some(scores) = self.minmax.measured() {
            let beside = trivial.and_then(|baseline| baseline.minmax.measured());
            text += &line("minmax mse", scores.mse, beside.map(|scores| scores.mse));
            text += &line("minmax rmse", scores.rmse, beside.map(|scores| scores.rmse));
        }
        text
    }

    /// Whether the mean image is that of the measured images themselves: a network cannot be that good on
    /// images that it has not seen.
    #[must_use]
    pub fn baseline_has_seen_the_images(&self) -> bool {
        self.baseline.as_ref().is_some_and(|baseline| baseline.of == BaselineSource::Measured)
    }
}

fn line(name: &str, value: f64, beside: Option<f64>) -> String {
    let beside = beside.map(|value| format!("{value:>12.4}")).unwrap_or_default();
    format!("{name:<15}{value:>9.4}{beside}\n")
}

fn sparsification_lines(scores: &SparsificationScores) -> String {
    let mut text = String::new();
    for (suffix, curve) in [("", &scores.curve), (", median fit", &scores.median_fit)] {
        text += &format!(
            "confidence{suffix}: abs_rel {:.4}, of the 50 % most certain pixels {:.4} (oracle {:.4}); area {:.4} \
             (random order {:.4})\n",
            curve.abs_rel, curve.certain_50, curve.oracle_50, curve.area, curve.area_random
        );
    }
    text
}

/// One image's own scores.
#[derive(Debug)]
pub(crate) struct ImageRow {
    pub(crate) id: String,
    metric: bool,
    scale_source: ScaleSource,
    depth: Option<DepthScores>,
    minmax: Option<Stretched>,
}

impl ImageRow {
    pub(crate) fn new(id: &str, alone: &Comparison, scale_source: ScaleSource) -> Self {
        Self {
            id: id.to_owned(),
            metric: alone.kind() == DepthKind::Metric,
            scale_source,
            depth: alone.depth.scores(),
            minmax: Stretched::of(&alone.minmax),
        }
    }

    /// What images are ranked by: the root of the mean squared error, in meters where there are meters.
    pub(crate) fn error(&self) -> f64 {
        let stretched = self.minmax.map(|scores| scores.rmse);
        let metric = self.depth.map(|scores| scores.rmse);
        (if self.metric { metric } else { stretched }).unwrap_or(f64::INFINITY)
    }

    pub(crate) fn caption(&self) -> String {
        let unit = if self.metric { " m" } else { " of the image's range" };
        format!("{}, rmse {:.3}{unit}", self.id, self.error())
    }
}

/// Writes one row per image; a value that could not be measured is empty.
pub(crate) fn write_csv(path: &Path, rows: &[ImageRow]) -> Result<(), EvalError> {
    let written = write_whole(path, |file| {
        let mut file = csv::Writer::from_writer(file);
        let names = DepthScores::NAMES.iter().copied();
        file.write_record(["id"].into_iter().chain(names).chain(["minmax_mse", "minmax_rmse"]))?;
        for row in rows {
            let depth = row.depth.map(|scores| scores.named().map(|(_, value)| value.to_string()));
            let minmax = row.minmax.map(|scores| [scores.mse.to_string(), scores.rmse.to_string()]);
            let values = depth.unwrap_or_default().into_iter().chain(minmax.unwrap_or_default());
            file.write_record([row.id.clone()].into_iter().chain(values))?;
        }
        Ok(file.flush()?)
    });
    Ok(written?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_report_counts_the_images_whose_scale_is_from_the_floor() {
        let row = |scale_source| ImageRow {
            id: "a".to_owned(),
            metric: true,
            scale_source,
            depth: None,
            minmax: None,
        };
        let rows = [ScaleSource::Floor, ScaleSource::FocalScaled, ScaleSource::Floor].map(row);
        let scale = |rows: &[ImageRow], uses_floor| {
            let MeasuredScale { source, floor_images } = MeasuredScale::of(rows, uses_floor);
            (source, floor_images)
        };
        assert_eq!(scale(&rows, true), ("mixed", Some(2)));
        assert_eq!(scale(&rows[..1], true), ("floor", Some(1)));
        assert_eq!(scale(&rows[1..2], true), ("focal_scaled", Some(0)), "no image shows enough floor");
        assert_eq!(scale(&rows[1..2], false), ("focal_scaled", None), "the floor was not requested");
    }
}
