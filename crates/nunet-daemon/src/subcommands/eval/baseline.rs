//! The mean image: the trivial prediction that needs no network.

use std::path::Path;

use anyhow::{Context as _, bail};
use serde::Serialize;
use tracing::warn;

use super::super::progress::progress;
use super::comparison::{Comparison, Kind, stretched};
use super::dataset::{Dataset, read_ids};
use super::metrics::DepthMetrics;
use crate::cli::{EvalArgs, ProtocolArg};
use crate::exit::BadArguments;
use crate::sink::files::{read_npy, write_npy};

/// The trivial prediction: for each pixel its mean over all pictures, whatever the picture shows.
#[derive(Debug, Default)]
struct MeanImage {
    size: Option<(u32, u32)>,
    metres: Means,
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
    /// Counts one picture.
    ///
    /// # Errors
    /// It is of another size than the first: there is no mean image then.
    fn add(&mut self, truth_m: &[f32], size: (u32, u32)) -> anyhow::Result<()> {
        let first = *self.size.get_or_insert(size);
        if first != size {
            bail!("pictures of {}x{} and of {}x{} have no mean image", first.0, first.1, size.0, size.1);
        }
        self.metres.add(truth_m);
        self.stretched.add(&stretched(truth_m, truth_m));
        Ok(())
    }

    /// Both mean images as comparisons to come; `None` before the first picture.
    fn baseline(&self, of: Of, protocol: ProtocolArg) -> Option<Baseline> {
        self.size.map(|size| Baseline {
            of,
            size,
            metres: self.metres.image(self.metres.overall()),
            stretched: Some(self.stretched.image(0.5)),
            metric: Comparison::new(protocol, Kind::Metric),
            minmax: Comparison::new(protocol, Kind::MinMax),
        })
    }
}

/// Whose mean the mean image is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(super) enum Of {
    /// Of what it is measured on: it is better than one can be on other pictures.
    #[serde(rename = "measured pictures")]
    Measured,
    /// Of pictures of the dataset that the user named.
    #[serde(rename = "baseline-ids")]
    Ids,
    /// Of a file that the user named.
    #[serde(rename = "baseline-file")]
    File,
}

/// The mean image compared with every picture.
#[derive(Debug)]
pub(super) struct Baseline {
    pub(super) of: Of,
    size: (u32, u32),
    metres: Vec<f32>,
    /// `None` of a file: then it is `metres`, stretched as a network's are.
    stretched: Option<Vec<f32>>,
    /// In metres.
    pub(super) metric: Comparison,
    minmax: Comparison,
}

impl Baseline {
    /// That of the file or of the pictures that the user named, who must all be readable, else of those that are measured; `None`
    /// where these have no mean image.
    pub(super) fn of(arguments: &EvalArgs, dataset: &Dataset) -> anyhow::Result<Option<Self>> {
        if let Some(file) = &arguments.baseline {
            return Self::read(file, arguments.protocol).map(Some);
        }
        let named = arguments.baseline_ids.as_deref().map(read_ids).transpose()?;
        let of = if named.is_some() { Of::Ids } else { Of::Measured };
        let mut mean = MeanImage::default();
        let progress = progress("mean image", Some(named.as_ref().unwrap_or(&dataset.ids).len() as u64));
        for id in named.as_ref().unwrap_or(&dataset.ids) {
            progress.inc(1);
            let truth = match dataset.truth(id, None) {
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
        Ok(mean.baseline(of, arguments.protocol))
    }

    fn read(file: &Path, protocol: ProtocolArg) -> anyhow::Result<Self> {
        let shown = file.display();
        let wrong = |what: String| {
            BadArguments(format!(
                "`{shown}` is no mean image: {what}\nhint: float32 (H, W), metres, as `--out` writes `mean_image.npy`"
            ))
        };
        let (metres, size) = read_npy(file).map_err(|error| wrong(format!("{error:#}")))?;
        if !metres.iter().all(|metres| metres.is_finite()) {
            bail!(wrong("not every pixel has a depth".to_owned()));
        }
        Ok(Self {
            of: Of::File,
            size,
            metres,
            stretched: None,
            metric: Comparison::new(protocol, Kind::Metric),
            minmax: Comparison::new(protocol, Kind::MinMax),
        })
    }

    /// Writes it as `float32` `(H, W)`, metres.
    pub(super) fn write(&self, path: &Path) -> anyhow::Result<()> {
        write_npy(path, &self.metres, self.size).with_context(|| format!("cannot write `{}`", path.display()))
    }

    /// Figures of stretched depth.
    pub(super) fn minmax(&self) -> &DepthMetrics {
        if self.stretched.is_some() { &self.minmax.minmax } else { &self.metric.minmax }
    }

    /// # Errors
    /// A picture of another size.
    pub(super) fn check_size(&self, size: (u32, u32)) -> anyhow::Result<()> {
        if size != self.size {
            bail!("the mean image is {}x{}, this picture {}x{}", self.size.0, self.size.1, size.0, size.1);
        }
        Ok(())
    }

    /// Counts one picture.
    pub(super) fn add(&mut self, truth_m: &[f32], size: (u32, u32)) -> anyhow::Result<()> {
        self.check_size(size)?;
        self.metric.add(&self.metres, truth_m, size)?;
        if let Some(stretched) = &self.stretched {
            self.minmax.add(stretched, truth_m, size)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (3, 1);

    #[test]
    fn the_mean_image_is_the_mean_of_each_pixel_and_of_all_where_none_is_known() {
        let mut mean = MeanImage::default();
        mean.add(&[1.0, f32::NAN, 3.0], SIZE).unwrap();
        mean.add(&[3.0, f32::NAN, f32::NAN], SIZE).unwrap();
        let baseline = mean.baseline(Of::Ids, ProtocolArg::Full).unwrap();
        assert_eq!(baseline.metres, [2.0, 7.0 / 3.0, 3.0]);
        assert_eq!(baseline.stretched.unwrap()[1], 0.5);
    }

    #[test]
    fn pictures_of_two_sizes_have_no_mean_image() {
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
        mean.baseline(Of::Measured, ProtocolArg::Full).unwrap().write(&path).unwrap();
        let mut baseline = Baseline::read(&path, ProtocolArg::Full).unwrap();
        assert_eq!(
            (&baseline.metres[..], baseline.size, baseline.of),
            (&[1.0, 2.0, 3.0][..], SIZE, Of::File)
        );
        baseline.add(&[2.0, 4.0, 6.0], SIZE).unwrap();
        assert_eq!(baseline.metric.depth.figures().unwrap().abs_rel, 0.5);
        assert!(baseline.minmax().figures().unwrap().mse < 1e-12, "its scale does not matter there");
    }

    #[test]
    fn what_is_no_mean_image_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let error = || Baseline::read(&path, ProtocolArg::Full).unwrap_err().to_string();
        assert!(error().contains("a.npy` is no mean image: "), "{}", error());
        std::fs::write(&path, "no array").unwrap();
        assert!(error().contains("is no mean image: ") && error().contains("hint: float32"), "{}", error());
        write_npy(&path, &[1.0, f32::NAN, 3.0], SIZE).unwrap();
        assert!(error().contains("not every pixel has a depth"), "{}", error());
    }
}
