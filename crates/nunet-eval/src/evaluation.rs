//! The pipeline over all images of a dataset.

use std::path::Path;

use image::RgbImage;
use nunet_core::camera::Mount;
use nunet_core::depth::{DepthImage, DepthKind};
use nunet_core::pipeline::{Outputs, Pipeline};
use nunet_engine::ModelName;
use nunet_files::{make_folder, write_json, write_rgb};
use nunet_source::{CameraResolver, Frame};

use crate::baseline::{Baseline, NamedBaseline};
use crate::comparison::Comparison;
use crate::dataset::{Dataset, ImageMounts, Truth, is_recording, read_ids, refuse_own_depth};
use crate::error::EvalError;
use crate::event::{Event, OnEvent};
use crate::fit::Fit;
use crate::metrics::LabelMetrics;
use crate::obstacles::ObstacleComparison;
use crate::options::EvalOptions;
use crate::report::{self, ImageRow, Measured, MeasuredScale, Report};
use crate::reported::Reported;
use crate::sheet::{self, SheetRow, chosen};
use crate::sparsification::Sparsification;

/// The files that [`Evaluation::write`] writes.
pub const FILES: [&str; 4] = ["eval.json", "images.csv", "contact_sheet.png", "mean_image.npy"];

/// If a larger share of truth is beyond the cap, its unit may be wrong.
const MUCH_BEYOND: f64 = 0.05;

/// An evaluation whose options were checked, before a model is loaded.
#[derive(Debug)]
pub struct Evaluator {
    options: EvalOptions,
    camera: CameraResolver,
    /// The images to measure; `None` for all.
    ids: Option<Vec<String>>,
    baseline: NamedBaseline,
}

impl Evaluator {
    /// Does the fast checks of `options`, and reads the calibration, the lists of ids and the mean image.
    ///
    /// # Errors
    /// One of these files cannot be used, or the dataset is a recording of predictions.
    pub fn new(options: EvalOptions) -> Result<Self, EvalError> {
        let ids = options.ids.as_deref().map(read_ids).transpose()?;
        let baseline = NamedBaseline::read(&options)?;
        refuse_own_depth(&options)?;
        let camera = CameraResolver::new(&options.camera)?;
        Ok(Self { options, camera, ids, baseline })
    }

    /// Measures every image. Images that cannot be measured are reported to `on_event` and counted.
    ///
    /// # Errors
    /// The dataset or the baseline cannot be used, no image could be measured, or there is no true depth to
    /// compare with.
    pub fn run(
        self,
        pipeline: Pipeline,
        on_event: &mut dyn FnMut(Event<'_>),
    ) -> Result<Evaluation, EvalError> {
        let Self { options, camera, ids, baseline } = self;
        let classes = &pipeline.graph().description().classes;
        let dataset = Dataset::open_named(&options, ids, classes, on_event)?;
        if pipeline.graph().has_labels() && !dataset.has_labels() {
            on_event(Event::Warning("no true labels of this network's classes: only depth is measured"));
        }
        let baseline = baseline.with_images(&options, &dataset, on_event)?;
        let obstacles = ObstacleComparison::of(options.obstacles, &pipeline)?;
        let mounts = mounts(&options, &pipeline)?;
        mounts.report_doubt(on_event);
        let mut evaluation = Evaluation::new(options, dataset, pipeline, camera, baseline);
        evaluation.obstacles = obstacles;
        evaluation.mounts = mounts;
        evaluation.measure_all(on_event)?;
        evaluation.comparison.check_truth()?;
        evaluation.report_truth_beyond(on_event);
        if let Some(obstacles) = &evaluation.obstacles {
            obstacles.report(on_event);
        }
        Ok(evaluation)
    }
}

/// A finished evaluation.
pub struct Evaluation {
    options: EvalOptions,
    dataset: Dataset,
    pipeline: Pipeline,
    camera: CameraResolver,
    /// Whether the images are consecutive frames.
    is_clip: bool,
    frame: Frame,
    depth: Vec<f32>,
    labels: Vec<u8>,
    comparison: Comparison,
    confusion: LabelMetrics,
    sparsification: Sparsification,
    baseline: Option<Baseline>,
    obstacles: Option<ObstacleComparison>,
    /// The mounts for obstacles and for the scale from the floor.
    mounts: ImageMounts,
    /// For the scale, the mount of images without one of their own; `None` if the floor is not used.
    scale_mount: Option<Mount>,
    rows: Vec<ImageRow>,
    skipped: u64,
}

/// What the network predicts for an image, at the image's size.
struct Prediction {
    depth: Vec<f32>,
    labels: Vec<u8>,
    /// `None` if the network has none.
    confidence: Option<Vec<u8>>,
}

impl Evaluation {
    fn new(
        options: EvalOptions,
        dataset: Dataset,
        pipeline: Pipeline,
        camera: CameraResolver,
        baseline: Option<Baseline>,
    ) -> Self {
        let pixels = pipeline.size().pixel_count();
        let description = pipeline.graph().description();
        let kind = description.encoding.kind();
        Self {
            is_clip: options.clip || is_recording(&options.dataset),
            frame: Frame::default(),
            depth: vec![0.0; pixels],
            labels: if pipeline.graph().has_labels() { vec![0; pixels] } else { Vec::new() },
            comparison: Comparison::new(options.protocol, options.depth_cap_m, kind),
            confusion: LabelMetrics::new(description.classes.len()),
            sparsification: Sparsification::default(),
            rows: Vec::new(),
            skipped: dataset.unpaired,
            obstacles: None,
            mounts: ImageMounts::default(),
            scale_mount: pipeline.mount(),
            options,
            dataset,
            pipeline,
            camera,
            baseline,
        }
    }

    /// Measures every image; an error if none could be measured.
    fn measure_all(&mut self, on_event: OnEvent<'_>) -> Result<(), EvalError> {
        let mut last = None;
        let mut reported = Reported::default();
        let ids = self.dataset.ids.clone();
        on_event(Event::Started { what: "images", count: ids.len() as u64 });
        for id in &ids {
            if let Err(error) = self.measure(id, on_event) {
                reported.report(id, &error, on_event);
                self.skipped += 1;
                last = Some(error);
            }
            on_event(Event::Advanced);
        }
        on_event(Event::Finished);
        reported.summarize(on_event);
        match last {
            Some(last) if self.rows.is_empty() => Err(EvalError::NothingMeasured { source: last.into() }),
            _ => Ok(()),
        }
    }

    fn measure(&mut self, id: &str, on_event: OnEvent<'_>) -> Result<(), EvalError> {
        let (truth, prediction) = self.predict(id, on_event)?;
        // Before anything is counted.
        self.comparison.check_size(truth.size)?;
        if let Some(baseline) = &self.baseline {
            baseline.check_size(truth.size)?;
        }
        self.compare_obstacles(id, &truth, &prediction)?;
        let alone = self.comparison.add(&prediction.depth, &truth.depth_m, truth.size)?;
        if let Some(confidence) = &prediction.confidence {
            let depth = &prediction.depth;
            let pixels = self.comparison.pixels(depth, &truth.depth_m, confidence, truth.size)?;
            self.sparsification.add(&pixels);
        }
        if truth.is_meters {
            self.comparison.see_meters();
        }
        if let Some(labels) = &truth.labels {
            self.confusion.add(&prediction.labels, labels);
        }
        if let Some(baseline) = &mut self.baseline {
            baseline.add(id, &truth.depth_m, truth.size)?;
        }
        self.rows.push(ImageRow::new(id, &alone, self.pipeline.scale().source));
        Ok(())
    }

    /// Compares the obstacles of an image, if that was requested.
    fn compare_obstacles(
        &mut self,
        id: &str,
        truth: &Truth,
        predicted: &Prediction,
    ) -> Result<(), EvalError> {
        let Some(comparison) = &mut self.obstacles else { return Ok(()) };
        let view = self.pipeline.framing().view();
        let of_view = self.pipeline.points_camera().scaled_to(view.width, view.height)?;
        let camera = of_view.padded(view, truth.size);
        let labels = (!predicted.labels.is_empty()).then_some(&predicted.labels[..]);
        let confidence = predicted.confidence.as_deref();
        let truth = DepthImage { depth_m: &truth.depth_m, labels: truth.labels.as_deref(), confidence: None };
        let predicted = DepthImage { depth_m: &predicted.depth, labels, confidence };
        let mount = self.mounts.of(id, self.options.obstacles.and_then(|obstacles| obstacles.mount))?;
        comparison.add(id, &camera, mount, [truth, predicted])
    }

    fn predict(&mut self, id: &str, on_event: OnEvent<'_>) -> Result<(Truth, Prediction), EvalError> {
        self.dataset.image(id, &mut self.frame, on_event)?;
        let mut truth = self.dataset.truth(id, Some(self.frame.size))?;
        if !self.is_clip {
            self.pipeline.reset_with_scale();
        }
        on_event(Event::Camera(self.camera.update(&self.frame, &mut self.pipeline)?));
        if self.scale_mount.is_some() {
            self.pipeline.set_mount(self.mounts.of(id, self.scale_mount)?);
        }
        let labels = (!self.labels.is_empty()).then_some(&mut self.labels[..]);
        let outputs = Outputs { depth_m: &mut self.depth, labels, confidence: None, cloud: None };
        self.pipeline.process(&self.frame.view()?, outputs, &|| 0)?;
        truth.blank_outside(self.pipeline.framing().view());
        let fit = Fit::new(&self.pipeline);
        let prediction = Prediction {
            depth: fit.depth(&self.depth),
            labels: fit.labels(&self.labels),
            confidence: self.pipeline.confidence().map(|confidence| fit.confidence(confidence)),
        };
        Ok((truth, prediction))
    }

    /// Reports truth beyond the cap. Every dataset has some; a large share is caused by a wrong unit or cap.
    fn report_truth_beyond(&self, on_event: OnEvent<'_>) {
        let share = self.comparison.share_beyond();
        if let Some(farthest_m) = self.comparison.farthest_m().filter(|_| share > MUCH_BEYOND) {
            let (cap_m, is_meters) = (self.comparison.cap_m(), self.comparison.is_meters());
            on_event(Event::TruthBeyondCap { share, cap_m, farthest_m, is_meters });
        }
    }

    /// Images that could not be measured, and images of a recording without depth.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// The report.
    #[must_use]
    pub fn report(&self, model: ModelName) -> Report {
        Report::new(
            Measured {
                model,
                dataset: name_of(&self.options.dataset),
                protocol: self.options.protocol,
                images: self.rows.len() as u64,
                skipped: self.skipped,
                scale: MeasuredScale::of(&self.rows, self.scale_mount.is_some()),
            },
            &self.pipeline,
            &self.comparison,
            &self.confusion,
            self.baseline.as_ref(),
        )
        .with_sparsification(self.sparsification.scores())
        .with_obstacles(self.obstacles.as_ref().map(ObstacleComparison::scores))
    }

    /// Writes [`FILES`] into `folder`, which is created if it is
    /// missing. The images of the sheet are predicted once more.
    ///
    /// # Errors
    /// A file cannot be written, or an image can no longer be read.
    pub fn write(&mut self, folder: &Path, report: &Report) -> Result<(), EvalError> {
        make_folder(folder)?;
        let [eval, rows, sheet, mean] = FILES.map(|name| folder.join(name));
        write_json(&eval, report)?;
        report::write_csv(&rows, &self.rows)?;
        if let Some(baseline) = &self.baseline {
            baseline.write(&mean)?;
        }
        Ok(write_rgb(&sheet, self.contact_sheet()?)?)
    }

    /// Predicts the chosen nine images once more, because all results would not fit into memory. In a clip,
    /// the images before them are predicted too.
    fn contact_sheet(&mut self) -> Result<RgbImage, EvalError> {
        let errors: Vec<f64> = self.rows.iter().map(ImageRow::error).collect();
        let chosen = chosen(&errors);
        let mut strips = vec![None; chosen.len()];
        self.pipeline.reset_with_scale();
        for id in &self.dataset.ids.clone() {
            let is_this = |&(_, place): &(&str, usize)| self.rows[place].id == *id;
            if let Some(index) = chosen.iter().position(is_this) {
                let (group, place) = chosen[index];
                let caption = format!("{group}: {}", self.rows[place].caption());
                strips[index] = Some(self.strip(id, caption)?);
            } else if self.is_clip {
                let _reported_before = self.predict(id, &mut |_| {});
            }
        }
        Ok(sheet::stacked(&strips.into_iter().flatten().collect::<Vec<_>>()))
    }

    fn strip(&mut self, id: &str, caption: String) -> Result<RgbImage, EvalError> {
        let (truth, prediction) = self.predict(id, &mut |_| {})?;
        let row = SheetRow {
            caption,
            size: truth.size,
            rgb: self.frame.view()?.bytes(),
            truth: &truth.depth_m,
            predicted: &prediction.depth,
            metric: self.comparison.kind() == DepthKind::Metric,
        };
        Ok(row.strip())
    }
}

/// The mounts of the images, if obstacles or the scale need them. The file is read once for both.
fn mounts(options: &EvalOptions, pipeline: &Pipeline) -> Result<ImageMounts, EvalError> {
    if options.obstacles.is_none() && pipeline.mount().is_none() {
        return Ok(ImageMounts::default());
    }
    let are_required = options.obstacles.is_some_and(|obstacles| obstacles.mount.is_none());
    ImageMounts::read(&options.dataset, are_required)
}

/// The last part of the dataset's path.
fn name_of(dataset: &Path) -> String {
    let path = dataset.canonicalize().unwrap_or_else(|_| dataset.to_owned());
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::EvalErrorKind;
    use crate::options::BaselineChoice;

    /// There is no dataset: the files are read before it, and so before a model is loaded.
    #[test]
    fn files_that_are_named_and_cannot_be_used_are_found_before_a_model_is_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let file = |text: &str| {
            let path = folder.path().join(format!("{}.txt", text.len()));
            std::fs::write(&path, text).unwrap();
            path
        };
        let wrong = ["missing".into(), "/dev/zero".into(), file(" \n"), file("a\nb\na\n")];
        for path in wrong {
            let of_list = EvalOptions { ids: Some(path.clone()), ..EvalOptions::new("missing") };
            let of_baseline =
                EvalOptions { baseline: BaselineChoice::Ids(path.clone()), ..EvalOptions::new("missing") };
            for options in [of_list, of_baseline] {
                let error = Evaluator::new(options).unwrap_err();
                assert!(matches!(error, EvalError::Ids(_)), "{error}");
            }
            let of_image =
                EvalOptions { baseline: BaselineChoice::File(path), ..EvalOptions::new("missing") };
            let error = Evaluator::new(of_image).unwrap_err();
            assert!(matches!(error, EvalError::NotAMeanImage { .. }), "{error}");
            assert_eq!(error.kind(), EvalErrorKind::Argument);
        }
    }
}
