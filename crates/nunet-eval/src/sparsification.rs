//! Sparsification: the error of the pixels that the network's confidence ranks highest, per image.
//!
//! A useful confidence puts the wrong pixels last, so that the error falls as fewer pixels are kept. The
//! oracle ranks pixels by their true error, which no confidence can beat. In a random order, each share of
//! the pixels has the error of all of them. (Ilg et al., "Uncertainty estimates and multi-hypotheses networks
//! for optical flow", 2018.) The recipe's `evaluate` computes the same.

use serde::Serialize;

use crate::median::median;

/// The shares of the curve, percent. The area is the mean distance over them.
const CURVE: [usize; 20] = [5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70, 75, 80, 85, 90, 95, 100];

/// Mean absolute relative errors of shares of the pixels, averaged over images.
#[derive(Debug, Clone, Copy, Default, Serialize, PartialEq)]
pub(crate) struct Curve {
    /// All pixels.
    pub(crate) abs_rel: f64,
    /// The 90, 75 and 50 % most certain pixels.
    certain_90: f64,
    certain_75: f64,
    pub(crate) certain_50: f64,
    /// The same shares, ranked by the true error.
    oracle_90: f64,
    oracle_75: f64,
    pub(crate) oracle_50: f64,
    /// The mean distance of both over all shares: 0 is perfect.
    pub(crate) area: f64,
    /// The same of a random order: a confidence as large is useless.
    pub(crate) area_random: f64,
}

/// The sparsification of all images.
#[derive(Debug, Clone, Copy, Serialize)]
pub(crate) struct SparsificationScores {
    images: u64,
    /// Errors as they are.
    #[serde(flatten)]
    pub(crate) curve: Curve,
    /// Errors after each image's depth was scaled to the right median: the error of scale is that of the
    /// image.
    pub(crate) median_fit: Curve,
}

/// The sums over images.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sparsification {
    sums: [Curve; 2],
    images: u64,
}

/// One pixel: prediction, truth, and confidence.
pub(crate) type Pixel = (f32, f32, u8);

impl Sparsification {
    /// Counts an image; one without pixels does not count.
    pub(crate) fn add(&mut self, pixels: &[Pixel]) {
        let median_of =
            |value: fn(&Pixel) -> f32| median(pixels.iter().map(|pixel| f64::from(value(pixel))).collect());
        let (Some(truth), Some(predicted)) = (median_of(|pixel| pixel.1), median_of(|pixel| pixel.0)) else {
            return;
        };
        let fit = truth / predicted;
        for (sum, scale) in self.sums.iter_mut().zip([1.0, fit]) {
            let error = |&(predicted, truth, confidence): &Pixel| {
                let truth = f64::from(truth);
                ((f64::from(predicted) * scale - truth).abs() / truth, confidence)
            };
            sum.add(&Curve::of(pixels.iter().map(error).collect()));
        }
        self.images += 1;
    }

    /// The scores; `None` before the first image.
    pub(crate) fn scores(&self) -> Option<SparsificationScores> {
        let n = (self.images > 0).then_some(self.images as f64)?;
        let [curve, median_fit] = self.sums.map(|sum| sum.map(|value| value / n));
        Some(SparsificationScores { images: self.images, curve, median_fit })
    }
}

impl Curve {
    /// The curve of one image, of errors with their confidence. Pixels of equal confidence count as if their
    /// order was random.
    fn of(mut errors: Vec<(f64, u8)>) -> Self {
        let mut levels = [(0_usize, 0.0); 256];
        for &(error, confidence) in &errors {
            let level = &mut levels[usize::from(confidence)];
            *level = (level.0 + 1, level.1 + error);
        }
        errors.sort_unstable_by(|one, other| one.0.total_cmp(&other.0));
        let kept = |percent: usize| ((percent * errors.len() + 50) / 100).max(1);
        let certain = |percent| mean_of_most_certain(&levels, kept(percent));
        let mut sum = 0.0;
        let sums: Vec<f64> = errors
            .iter()
            .map(|&(error, _)| {
                sum += error;
                sum
            })
            .collect();
        let oracle = |percent| sums[kept(percent) - 1] / kept(percent) as f64;
        let mean = oracle(100);
        let area = |of: &dyn Fn(usize) -> f64| {
            CURVE.iter().map(|&percent| of(percent) - oracle(percent)).sum::<f64>() / CURVE.len() as f64
        };
        Self {
            abs_rel: mean,
            certain_90: certain(90),
            certain_75: certain(75),
            certain_50: certain(50),
            oracle_90: oracle(90),
            oracle_75: oracle(75),
            oracle_50: oracle(50),
            area: area(&certain),
            area_random: area(&|_| mean),
        }
    }

    fn add(&mut self, other: &Self) {
        let mut values = other.values().into_iter();
        *self = self.map(|value| value + values.next().unwrap_or_default());
    }

    fn map(self, change: impl FnMut(f64) -> f64) -> Self {
        let [abs_rel, certain_90, certain_75, certain_50, oracle_90, oracle_75, oracle_50, area, area_random] =
            self.values().map(change);
        Self {
            abs_rel,
            certain_90,
            certain_75,
            certain_50,
            oracle_90,
            oracle_75,
            oracle_50,
            area,
            area_random,
        }
    }

    fn values(&self) -> [f64; 9] {
        [
            self.abs_rel,
            self.certain_90,
            self.certain_75,
            self.certain_50,
            self.oracle_90,
            self.oracle_75,
            self.oracle_50,
            self.area,
            self.area_random,
        ]
    }
}

/// Mean error of the `count` most certain pixels, from the count and the sum of errors of each confidence.
fn mean_of_most_certain(levels: &[(usize, f64); 256], count: usize) -> f64 {
    let (mut left, mut sum) = (count, 0.0);
    for &(pixels, errors) in levels.iter().rev() {
        let taken = pixels.min(left);
        if taken > 0 {
            sum += errors * taken as f64 / pixels as f64;
            left -= taken;
        }
    }
    sum / count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(got: f64, expected: f64) {
        assert!((got - expected).abs() < 1e-6, "{got}, expected {expected}");
    }

    #[test]
    fn the_curve_of_numbers_worked_out_by_hand() {
        // The same numbers as in the recipe's test.
        let curve = Curve::of(vec![(0.4, 0), (0.1, 255), (0.2, 100), (0.3, 100)]);
        close(curve.certain_50, (0.1 + 0.25) / 2.0);
        close(curve.certain_75, 0.2);
        close(curve.certain_90, 0.25);
        close(curve.oracle_50, 0.15);
        close(curve.oracle_75, 0.2);
        close(curve.area, 5.0 * 0.025 / 20.0);
        close(curve.area_random, (7.0 * 0.15 + 5.0 * 0.1 + 5.0 * 0.05) / 20.0);
    }

    #[test]
    fn a_constant_confidence_is_a_random_order() {
        let errors = (0..1000_u32).map(|i| (f64::from(i * 7919 % 1000) / 1000.0, 7)).collect();
        let curve = Curve::of(errors);
        close(curve.area, curve.area_random);
    }

    #[test]
    fn images_weigh_alike_and_the_fit_removes_their_scale() {
        let mut found = Sparsification::default();
        assert!(found.scores().is_none());
        found.add(&[]);
        found.add(&[(2.0, 1.0, 9), (4.0, 2.0, 9)]);
        found.add(&[(1.0, 1.0, 9); 10]);
        let scores = found.scores().unwrap();
        assert_eq!(scores.images, 2);
        close(scores.curve.abs_rel, 0.5);
        close(scores.median_fit.abs_rel, 0.0);
    }
}
