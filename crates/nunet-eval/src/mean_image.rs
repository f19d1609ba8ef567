//! Mean images: the trivial prediction that needs no network.

use std::collections::BTreeMap;

use nunet_types::ImageSize;

use crate::comparison::stretched;
use crate::error::EvalError;

/// The trivial prediction: the mean of each pixel over all images, independent of the image.
#[derive(Debug, Default)]
pub(crate) struct MeanImage {
    pub(crate) size: Option<ImageSize>,
    meters: PixelMeans,
    stretched: PixelMeans,
}

#[derive(Debug, Default)]
struct PixelMeans(Vec<(f64, u32)>);

impl PixelMeans {
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
    /// It has another size than the first one: there is no mean then.
    pub(crate) fn add(&mut self, truth_m: &[f32], size: ImageSize) -> Result<(), EvalError> {
        let first = *self.size.get_or_insert(size);
        if first != size {
            return Err(EvalError::NoMean { first, other: size });
        }
        self.meters.add(truth_m);
        self.stretched.add(&stretched(truth_m, truth_m));
        Ok(())
    }

    /// The mean without the images of another one.
    fn without(&self, other: &Self) -> Self {
        let (meters, stretched) =
            (self.meters.without(&other.meters), self.stretched.without(&other.stretched));
        Self { size: self.size, meters, stretched }
    }

    pub(crate) fn prediction(&self) -> MeanPrediction {
        MeanPrediction {
            meters: self.meters.image(self.meters.overall()),
            stretched: Some(self.stretched.image(0.5)),
        }
    }
}

/// The mean image as a prediction.
#[derive(Debug)]
pub(crate) struct MeanPrediction {
    pub(crate) meters: Vec<f32>,
    /// `None` for a mean image from a file: then `meters` are stretched like those of a network.
    pub(crate) stretched: Option<Vec<f32>>,
}

/// The mean images of scenes without each of them.
#[derive(Debug, Default)]
pub(crate) struct Scenes {
    pub(crate) all: MeanImage,
    each: BTreeMap<String, MeanImage>,
}

/// The largest number of scenes. More would need too much memory, and a single scene would hardly change the
/// mean.
const MAX_SCENES: usize = 32;

/// The scene that an id names: `bedroom_` of `bedroom_07`. `None` for an id without a number.
pub(crate) fn scene(id: &str) -> Option<&str> {
    let name = id.trim_end_matches(|c: char| c.is_ascii_digit());
    (name.len() < id.len()).then_some(name)
}

/// Whether ids name several scenes of several images each.
pub(crate) fn have_scenes(ids: &[String]) -> bool {
    let mut counts = BTreeMap::new();
    for id in ids {
        let Some(name) = scene(id) else { return false };
        *counts.entry(name).or_insert(0) += 1;
    }
    (2..=MAX_SCENES).contains(&counts.len()) && counts.values().all(|&count| count > 1)
}

impl Scenes {
    pub(crate) fn add(&mut self, id: &str, truth_m: &[f32], size: ImageSize) -> Result<(), EvalError> {
        self.all.add(truth_m, size)?;
        self.each.entry(scene(id).unwrap_or(id).to_owned()).or_default().add(truth_m, size)
    }

    /// For the images of each scene, the mean of the others.
    pub(crate) fn predictions(&self) -> BTreeMap<String, MeanPrediction> {
        let others = |mean: &MeanImage| self.all.without(mean).prediction();
        self.each.iter().map(|(name, mean)| (name.clone(), others(mean))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_name_scenes_if_each_has_several_images() {
        let ids = ["bed_0", "bed_1", "sofa_0", "sofa_1"].map(str::to_owned);
        assert!(have_scenes(&ids));
        assert!(!have_scenes(&ids[..3]), "one image is no scene");
        assert!(!have_scenes(&["0001".to_owned(), "0002".to_owned()]));
    }

    #[test]
    fn the_mean_image_is_the_mean_of_each_pixel_and_of_all_where_none_is_known() {
        let size = ImageSize::new(3, 1);
        let mut mean = MeanImage::default();
        mean.add(&[1.0, f32::NAN, 3.0], size).unwrap();
        mean.add(&[3.0, f32::NAN, f32::NAN], size).unwrap();
        let prediction = mean.prediction();
        assert_eq!(prediction.meters, [2.0, 7.0 / 3.0, 3.0]);
        assert_eq!(prediction.stretched.unwrap()[1], 0.5);
    }

    #[test]
    fn images_of_two_sizes_have_no_mean_image() {
        let mut mean = MeanImage::default();
        let (first, other) = (ImageSize::new(3, 1), ImageSize::new(2, 2));
        mean.add(&[1.0; 3], first).unwrap();
        let error = mean.add(&[1.0; 4], other).unwrap_err();
        assert!(matches!(error, EvalError::NoMean { first: a, other: b } if (a, b) == (first, other)));
    }
}
