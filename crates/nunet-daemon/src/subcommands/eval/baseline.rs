//! The mean image: the trivial prediction that needs no network.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, bail};
use serde::Serialize;
use tracing::warn;

use super::super::progress::progress;
use super::comparison::{Comparison, Kind, stretched};
use super::dataset::{Dataset, read_ids};
use super::metrics::DepthMetrics;
use crate::cli::{EvalArgs, ProtocolArg};
use crate::exit::WithHint;
use crate::sink::files::{read_npy, write_npy};

/// The trivial prediction: for each pixel its mean over all images, whatever the image shows.
#[derive(Debug, Default)]
struct MeanImage {
    size: Option<(u32, u32)>,
    meters: Means,
    stretched: Means,
}

#[derive(Debug, Default)]
struct Means(Vec<(f64, u32)>);

impl Means {
    fn add(&mut self, values: &[f32]) {
        self.0.resize(values.len(), (0.0, 0));
        for ((sum, count), &value) in self.0.iter_mut().zip(values) {
            if value.is_finite() {
                *sum += f64::from(value);
                *count += 1;
            }
        }
    }

    fn without(&self, other: &Self) -> Self {
        let pixels = self.0.iter().zip(&other.0);
        Self(pixels.map(|(all, part)| (all.0 - part.0, all.1 - part.1)).collect())
    }

    /// The mean of each pixel, `otherwise` where it was never known.
    fn image(&self, otherwise: f64) -> Vec<f32> {
        let mean = |&(sum, count): &(f64, u32)| if count == 0 { otherwise } else { sum / f64::from(count) };
        self.0.iter().map(|pixel| mean(pixel) as f32).collect()
    }

    fn overall(&self) -> f64 {
        let (sum, count) = self
            .0
            .iter()
            .fold((0.0, 0_u64), |(sum, count), pixel| (sum + pixel.0, count + u64::from(pixel.1)));
        sum / count.max(1) as f64
    }
}

impl MeanImage {
    /// Counts one image.
    ///
    /// # Errors
    /// It has another size than the first: there is no mean image then.
    fn add(&mut self, truth_m: &[f32], size: (u32, u32)) -> anyhow::Result<()> {
        let first = *self.size.get_or_insert(size);
        if first != size {
            bail!("images of {}x{} and of {}x{} have no mean image", first.0, first.1, size.0, size.1);
        }
        self.meters.add(truth_m);
        self.stretched.add(&stretched(truth_m, truth_m));
        Ok(())
    }

    /// The mean without what another one has counted.
    fn without(&self, other: &Self) -> Self {
        let (meters, stretched) =
            (self.meters.without(&other.meters), self.stretched.without(&other.stretched));
        Self { size: self.size, meters, stretched }
    }

    fn prediction(&self) -> Prediction {
        Prediction {
            meters: self.meters.image(self.meters.overall()),
            stretched: Some(self.stretched.image(0.5)),
        }
    }

    /// The mean image as a comparison to come; `None` before the first image.
    fn baseline(&self, of: Of, rules: Rules) -> Option<Baseline> {
        let (size, everywhere) = (self.size?, self.prediction());
        Some(Baseline::new(of, size, everywhere, BTreeMap::new(), rules))
    }
}

/// The mean image as a prediction.
#[derive(Debug)]
struct Prediction {
    meters: Vec<f32>,
    /// `None` for a file: then it is `meters`, stretched as those of a network are.
    stretched: Option<Vec<f32>>,
}

/// How predictions are compared.
#[derive(Debug, Clone, Copy)]
struct Rules {
    protocol: ProtocolArg,
    cap_m: f32,
}

impl Rules {
    fn of(arguments: &EvalArgs) -> Self {
        Self { protocol: arguments.protocol, cap_m: arguments.depth_cap as f32 }
    }
}

/// The mean images of scenes without each of them.
#[derive(Debug, Default)]
struct Scenes {
    all: MeanImage,
    each: BTreeMap<String, MeanImage>,
}

/// More scenes than this would take much memory, and one of them makes little difference.
const MAX_SCENES: usize = 32;

/// The scene that an id names: `bedroom_` of `bedroom_07`. `None` for an id without a number.
fn scene(id: &str) -> Option<&str> {
    let name = id.trim_end_matches(|c: char| c.is_ascii_digit());
    (name.len() < id.len()).then_some(name)
}

/// Whether ids name several scenes of several images each.
fn have_scenes(ids: &[String]) -> bool {
    let mut counts = BTreeMap::new();
    for id in ids {
        let Some(name) = scene(id) else { return false };
        *counts.entry(name).or_insert(0) += 1;
    }
    (2..=MAX_SCENES).contains(&counts.len()) && counts.values().all(|&count| count > 1)
}

impl Scenes {
    fn add(&mut self, id: &str, truth_m: &[f32], size: (u32, u32)) -> anyhow::Result<()> {
        self.all.add(truth_m, size)?;
        self.each.entry(scene(id).unwrap_or(id).to_owned()).or_default().add(truth_m, size)
    }

    fn baseline(&self, rules: Rules) -> Option<Baseline> {
        let others = |mean: &MeanImage| self.all.without(mean).prediction();
        let each = self.each.iter().map(|(name, mean)| (name.clone(), others(mean))).collect();
        Some(Baseline::new(Of::OtherScenes, self.all.size?, self.all.prediction(), each, rules))
    }
}

/// Whose mean the mean image is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(super) enum Of {
    /// Of what it is measured on: it is better than one can be on other images.
    #[serde(rename = "measured pictures")]
    Measured,
    /// Of the other scenes of the dataset, for each image.
    #[serde(rename = "other scenes")]
    OtherScenes,
    /// Of images of the dataset that the user named.
    #[serde(rename = "baseline-ids")]
    Ids,
    /// Of a file that the user named.
    #[serde(rename = "baseline-file")]
    File,
}

/// The mean image compared with every image.
#[derive(Debug)]
pub(super) struct Baseline {
    pub(super) of: Of,
    size: (u32, u32),
    /// For every image whose scene has none of its own.
    everywhere: Prediction,
    /// For the images of each scene.
    each: BTreeMap<String, Prediction>,
    /// In meters.
    pub(super) metric: Comparison,
    minmax: Comparison,
}

impl Baseline {
    fn new(
        of: Of,
        size: (u32, u32),
        everywhere: Prediction,
        each: BTreeMap<String, Prediction>,
        rules: Rules,
    ) -> Self {
        let comparison = |kind| Comparison::new(rules.protocol, rules.cap_m, kind);
        let (metric, minmax) = (comparison(Kind::Metric), comparison(Kind::MinMax));
        Self { of, size, everywhere, each, metric, minmax }
    }

    /// That of the file or of the images that the user named, which must all be readable; else that of the other scenes, if
    /// ids name scenes; else that of the measured images. `None` where these have no mean image.
    pub(super) fn of(arguments: &EvalArgs, dataset: &Dataset) -> anyhow::Result<Option<Self>> {
        let rules = Rules::of(arguments);
        if let Some(file) = &arguments.baseline {
            return Self::read(file, rules).map(Some);
        }
        let named = arguments.baseline_ids.as_deref().map(read_ids).transpose()?;
        let ids = named.as_ref().unwrap_or(&dataset.ids);
        let by_scene = named.is_none() && have_scenes(ids);
        let (mut mean, mut scenes) = (MeanImage::default(), Scenes::default());
        let progress = progress("mean image", Some(ids.len() as u64));
        for id in ids {
            progress.inc(1);
            let truth = match dataset.truth(id, None) {
                Ok(truth) => truth,
                Err(_) if named.is_none() => continue, // reported when it is measured
                Err(error) => return Err(error),
            };
            let added = match by_scene {
                true => scenes.add(id, &truth.depth_m, truth.size),
                false => mean.add(&truth.depth_m, truth.size),
            };
            if let Err(error) = added {
                warn!("no baseline: {error}");
                return Ok(None);
            }
        }
        progress.finish_and_clear();
        let of = if named.is_some() { Of::Ids } else { Of::Measured };
        Ok(if by_scene { scenes.baseline(rules) } else { mean.baseline(of, rules) })
    }

    fn read(file: &Path, rules: Rules) -> anyhow::Result<Self> {
        let wrong = |what: String| {
            WithHint::usage(
                format!("`{}` is not a mean image: {what}", file.display()),
                "pass float32 (H, W), meters, as `--out` writes `mean_image.npy`",
            )
        };
        let (meters, size) = read_npy(file).map_err(|error| wrong(format!("{error:#}")))?;
        if !meters.iter().all(|meters| meters.is_finite()) {
            bail!(wrong("not every pixel has a depth".to_owned()));
        }
        let everywhere = Prediction { meters, stretched: None };
        Ok(Self::new(Of::File, size, everywhere, BTreeMap::new(), rules))
    }

    /// Writes it as `float32` `(H, W)`, meters.
    pub(super) fn write(&self, path: &Path) -> anyhow::Result<()> {
        write_npy(path, &self.everywhere.meters, self.size)
            .with_context(|| format!("cannot write `{}`", path.display()))
    }

    /// Metrics of stretched depth.
    pub(super) fn minmax(&self) -> &DepthMetrics {
        if self.everywhere.stretched.is_some() { &self.minmax.minmax } else { &self.metric.minmax }
    }

    /// # Errors
    /// An image of another size.
    pub(super) fn check_size(&self, size: (u32, u32)) -> anyhow::Result<()> {
        if size != self.size {
            bail!("the mean image is {}x{}, this image {}x{}", self.size.0, self.size.1, size.0, size.1);
        }
        Ok(())
    }

    /// Counts one image.
    pub(super) fn add(&mut self, id: &str, truth_m: &[f32], size: (u32, u32)) -> anyhow::Result<()> {
        self.check_size(size)?;
        let prediction = scene(id).and_then(|scene| self.each.get(scene)).unwrap_or(&self.everywhere);
        self.metric.add(&prediction.meters, truth_m, size)?;
        if let Some(stretched) = &prediction.stretched {
            self.minmax.add(stretched, truth_m, size)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (3, 1);
    const RULES: Rules = Rules { protocol: ProtocolArg::Full, cap_m: 10.0 };

    #[test]
    fn the_mean_image_is_the_mean_of_each_pixel_and_of_all_where_none_is_known() {
        let mut mean = MeanImage::default();
        mean.add(&[1.0, f32::NAN, 3.0], SIZE).unwrap();
        mean.add(&[3.0, f32::NAN, f32::NAN], SIZE).unwrap();
        let baseline = mean.baseline(Of::Ids, RULES).unwrap();
        assert_eq!(baseline.everywhere.meters, [2.0, 7.0 / 3.0, 3.0]);
        assert_eq!(baseline.everywhere.stretched.unwrap()[1], 0.5);
    }

    #[test]
    fn images_of_two_sizes_have_no_mean_image() {
        let mut mean = MeanImage::default();
        mean.add(&[1.0; 3], SIZE).unwrap();
        assert!(mean.add(&[1.0; 4], (2, 2)).unwrap_err().to_string().contains("3x1 and of 2x2"));
    }

    #[test]
    fn a_mean_image_is_read_as_it_was_written_and_stretched_as_a_network_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mean_image.npy");
        let mut mean = MeanImage::default();
        mean.add(&[1.0, 2.0, 3.0], SIZE).unwrap();
        mean.baseline(Of::Measured, RULES).unwrap().write(&path).unwrap();
        let mut baseline = Baseline::read(&path, RULES).unwrap();
        assert_eq!(
            (&baseline.everywhere.meters[..], baseline.size, baseline.of),
            (&[1.0, 2.0, 3.0][..], SIZE, Of::File)
        );
        baseline.add("a", &[2.0, 4.0, 6.0], SIZE).unwrap();
        assert_eq!(baseline.metric.depth.figures().unwrap().abs_rel, 0.5);
        assert!(baseline.minmax().figures().unwrap().mse < 1e-12, "its scale does not matter there");
    }

    #[test]
    fn what_is_not_a_mean_image_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let error = || Baseline::read(&path, RULES).unwrap_err().to_string();
        assert!(error().contains("a.npy` is not a mean image: "), "{}", error());
        std::fs::write(&path, "no array").unwrap();
        assert!(error().contains("is not a mean image: "), "{}", error());
        write_npy(&path, &[1.0, f32::NAN, 3.0], SIZE).unwrap();
        assert!(error().contains("not every pixel has a depth"), "{}", error());
    }

    #[test]
    fn a_scene_is_compared_with_the_mean_of_the_others() {
        let ids = ["bed_0", "bed_1", "sofa_0", "sofa_1"].map(str::to_owned);
        assert!(have_scenes(&ids));
        assert!(!have_scenes(&ids[..3]), "one image is no scene");
        assert!(!have_scenes(&["0001".to_owned(), "0002".to_owned()]));
        let mut scenes = Scenes::default();
        for (id, meters) in ids.iter().zip([1.0, 1.0, 3.0, 5.0]) {
            scenes.add(id, &[meters; 3], SIZE).unwrap();
        }
        let mut baseline = scenes.baseline(RULES).unwrap();
        assert_eq!(baseline.of, Of::OtherScenes);
        baseline.add("bed_1", &[2.0; 3], SIZE).unwrap(); // the sofas' mean is 4 m
        assert_eq!(baseline.metric.depth.figures().unwrap().mse, 4.0);
    }
}
