//! The mean image as a baseline for the network.

use std::collections::BTreeMap;
use std::path::Path;

use nunet_core::depth::DepthKind;
use nunet_files::write_npy;
use nunet_types::ImageSize;
use serde::Serialize;

use crate::comparison::Comparison;
use crate::dataset::{Dataset, read_ids};
use crate::error::EvalError;
use crate::event::{Event, OnEvent};
use crate::mean_image::{MeanImage, MeanPrediction, Scenes, have_scenes, scene};
use crate::metrics::DepthMetrics;
use crate::npy_file;
use crate::options::{BaselineChoice, EvalOptions, Protocol};

/// The rules by which predictions are compared.
#[derive(Debug, Clone, Copy)]
struct Rules {
    protocol: Protocol,
    cap_m: f32,
}

impl Rules {
    fn of(options: &EvalOptions) -> Self {
        Self { protocol: options.protocol, cap_m: options.depth_cap_m }
    }
}

/// The images whose mean is the baseline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(crate) enum BaselineSource {
    /// The measured images themselves. Such a baseline scores better than it would on other images.
    #[serde(rename = "measured images")]
    Measured,
    /// For each image, the other scenes of the dataset.
    #[serde(rename = "other scenes")]
    OtherScenes,
    /// Images of the dataset that the user named.
    #[serde(rename = "baseline-ids")]
    Ids,
    /// A mean image from a file.
    #[serde(rename = "baseline-file")]
    File,
}

/// What the user named as the baseline, read before anything else is.
#[derive(Debug)]
pub(crate) enum NamedBaseline {
    /// Nothing.
    Automatic,
    /// Images of the dataset.
    Ids(Vec<String>),
    /// A mean image.
    Image(Box<Baseline>),
}

impl NamedBaseline {
    /// # Errors
    /// The file cannot be used.
    pub(crate) fn read(options: &EvalOptions) -> Result<Self, EvalError> {
        match &options.baseline {
            BaselineChoice::Automatic => Ok(Self::Automatic),
            BaselineChoice::Ids(list) => read_ids(list).map(Self::Ids),
            BaselineChoice::File(file) => Ok(Self::Image(Baseline::read(file, Rules::of(options))?.into())),
        }
    }

    /// The mean image; `None` if the images have none. Every image that the user named must be readable.
    pub(crate) fn with_images(
        self,
        options: &EvalOptions,
        dataset: &Dataset,
        on_event: OnEvent<'_>,
    ) -> Result<Option<Baseline>, EvalError> {
        let (means, source) = match self {
            Self::Image(baseline) => return Ok(Some(*baseline)),
            Self::Ids(ids) => (Means::of(dataset, &ids, false, on_event)?, BaselineSource::Ids),
            Self::Automatic => (Means::of(dataset, &dataset.ids, true, on_event)?, BaselineSource::Measured),
        };
        Ok(means.and_then(|means| means.baseline(source, Rules::of(options))))
    }
}

/// The mean image compared with every image.
#[derive(Debug)]
pub(crate) struct Baseline {
    pub(crate) of: BaselineSource,
    size: ImageSize,
    /// The prediction for images whose scene has no prediction of its own.
    everywhere: MeanPrediction,
    /// The prediction for the images of each scene.
    each: BTreeMap<String, MeanPrediction>,
    /// Comparison in meters.
    pub(crate) metric: Comparison,
    minmax: Comparison,
}

impl Baseline {
    fn with(
        of: BaselineSource,
        size: ImageSize,
        everywhere: MeanPrediction,
        each: BTreeMap<String, MeanPrediction>,
        rules: Rules,
    ) -> Self {
        let comparison = |kind| Comparison::new(rules.protocol, rules.cap_m, kind);
        let (metric, minmax) = (comparison(DepthKind::Metric), comparison(DepthKind::MinMax));
        Self { of, size, everywhere, each, metric, minmax }
    }

    fn read(path: &Path, rules: Rules) -> Result<Self, EvalError> {
        let wrong = |reason: String| EvalError::NotAMeanImage { path: path.to_owned(), reason };
        let (meters, size) = npy_file::read(path).map_err(|error| wrong(error.to_string()))?;
        if !meters.iter().all(|meters| meters.is_finite()) {
            return Err(wrong("not every pixel has a depth".to_owned()));
        }
        let everywhere = MeanPrediction { meters, stretched: None };
        Ok(Self::with(BaselineSource::File, size, everywhere, BTreeMap::new(), rules))
    }

    /// Writes it as `float32` `(H, W)`, meters.
    pub(crate) fn write(&self, path: &Path) -> Result<(), EvalError> {
        Ok(write_npy(path, &self.everywhere.meters, self.size)?)
    }

    /// Metrics of stretched depth.
    pub(crate) fn minmax(&self) -> &DepthMetrics {
        if self.everywhere.stretched.is_some() { &self.minmax.minmax } else { &self.metric.minmax }
    }

    /// # Errors
    /// An image of another size.
    pub(crate) fn check_size(&self, image: ImageSize) -> Result<(), EvalError> {
        if image != self.size {
            return Err(EvalError::MeanSize { mean: self.size, image });
        }
        Ok(())
    }

    /// Counts one image.
    pub(crate) fn add(&mut self, id: &str, truth_m: &[f32], size: ImageSize) -> Result<(), EvalError> {
        self.check_size(size)?;
        let prediction = scene(id).and_then(|scene| self.each.get(scene)).unwrap_or(&self.everywhere);
        self.metric.add(&prediction.meters, truth_m, size)?;
        if let Some(stretched) = &prediction.stretched {
            self.minmax.add(stretched, truth_m, size)?;
        }
        Ok(())
    }
}

/// Mean images of many images: one of all, or one for each scene.
enum Means {
    All(MeanImage),
    Scenes(Scenes),
}

impl Means {
    /// The mean images of `ids`. `automatic` allows scenes and skips unreadable images, which are
    /// reported when they are measured.
    fn of(
        dataset: &Dataset,
        ids: &[String],
        automatic: bool,
        on_event: OnEvent<'_>,
    ) -> Result<Option<Self>, EvalError> {
        let mut means = match automatic && have_scenes(ids) {
            true => Self::Scenes(Scenes::default()),
            false => Self::All(MeanImage::default()),
        };
        on_event(Event::Started { what: "mean image", count: ids.len() as u64 });
        for id in ids {
            on_event(Event::Advanced);
            let truth = match dataset.truth(id, None) {
                Ok(truth) => truth,
                Err(_) if automatic => continue,
                Err(error) => return Err(error),
            };
            let added = match &mut means {
                Self::Scenes(scenes) => scenes.add(id, &truth.depth_m, truth.size),
                Self::All(mean) => mean.add(&truth.depth_m, truth.size),
            };
            if let Err(error) = added {
                on_event(Event::Finished);
                on_event(Event::Warning(&format!("no baseline: {error}")));
                return Ok(None);
            }
        }
        on_event(Event::Finished);
        Ok(Some(means))
    }

    /// The baseline; `None` without an image.
    fn baseline(&self, of: BaselineSource, rules: Rules) -> Option<Baseline> {
        let (of, mean, each) = match self {
            Self::All(mean) => (of, mean, BTreeMap::new()),
            Self::Scenes(scenes) => (BaselineSource::OtherScenes, &scenes.all, scenes.predictions()),
        };
        Some(Baseline::with(of, mean.size?, mean.prediction(), each, rules))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: ImageSize = ImageSize::new(3, 1);
    const RULES: Rules = Rules { protocol: Protocol::Full, cap_m: 10.0 };

    #[test]
    fn a_mean_image_is_read_as_it_was_written_and_stretched_as_a_network_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mean_image.npy");
        let mut mean = MeanImage::default();
        mean.add(&[1.0, 2.0, 3.0], SIZE).unwrap();
        Means::All(mean).baseline(BaselineSource::Measured, RULES).unwrap().write(&path).unwrap();
        let mut baseline = Baseline::read(&path, RULES).unwrap();
        assert_eq!(
            (&baseline.everywhere.meters[..], baseline.size, baseline.of),
            (&[1.0, 2.0, 3.0][..], SIZE, BaselineSource::File)
        );
        baseline.add("a", &[2.0, 4.0, 6.0], SIZE).unwrap();
        assert_eq!(baseline.metric.depth.scores().unwrap().abs_rel, 0.5);
        assert!(baseline.minmax().scores().unwrap().mse < 1e-12, "its scale does not matter there");
        let other = ImageSize::new(1, 3);
        assert!(matches!(baseline.add("b", &[1.0; 3], other), Err(EvalError::MeanSize { .. })));
    }

    #[test]
    fn what_is_not_a_mean_image_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let refused = || match Baseline::read(&path, RULES) {
            Err(EvalError::NotAMeanImage { path: named, reason }) if named == path => reason,
            other => panic!("{other:?}"),
        };
        refused();
        std::fs::write(&path, "no array").unwrap();
        refused();
        write_npy(&path, &[1.0, f32::NAN, 3.0], SIZE).unwrap();
        assert_eq!(refused(), "not every pixel has a depth");
    }

    #[test]
    fn a_scene_is_compared_with_the_mean_of_the_others() {
        let mut scenes = Scenes::default();
        for (id, meters) in [("bed_0", 1.0), ("bed_1", 1.0), ("sofa_0", 3.0), ("sofa_1", 5.0)] {
            scenes.add(id, &[meters; 3], SIZE).unwrap();
        }
        let mut baseline = Means::Scenes(scenes).baseline(BaselineSource::Measured, RULES).unwrap();
        assert_eq!(baseline.of, BaselineSource::OtherScenes);
        baseline.add("bed_1", &[2.0; 3], SIZE).unwrap(); // the sofas' mean is 4 m
        assert_eq!(baseline.metric.depth.scores().unwrap().mse, 4.0);
    }
}
