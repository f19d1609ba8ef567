//! Metrics of depth and of labels over all pixels of all images, and those of depth as the mean over images.
//!
//! Published tables use either: `FastDepth`, `BTS` and `AdaBins` average over images, which gives a smaller
//! RMSE.

use serde::Serialize;

/// The ratio of prediction and truth within which a pixel counts for delta 1; its powers for 2 and 3.
const DELTA: f64 = 1.25;
/// The label of a pixel without a true label.
pub const IGNORE: u8 = 255;

/// Sums over pixels from which the scores are computed.
#[derive(Debug, Clone, Default)]
pub struct DepthMetrics {
    squared: f64,
    log: f64,
    log_squared: f64,
    log_absolute: f64,
    relative: f64,
    squared_relative: f64,
    within: [u64; 3],
    /// Pixels with truth and prediction.
    pub pixels: u64,
    /// Pixels with truth but without prediction. They are in no other metric.
    pub missing: u64,
}

impl DepthMetrics {
    /// Counts one pixel: positive numbers of one unit, NaN = none.
    pub fn add(&mut self, predicted: f32, truth: f32) {
        if !truth.is_finite() {
            return;
        }
        if !predicted.is_finite() {
            self.missing += 1;
            return;
        }
        let (p, t) = (f64::from(predicted), f64::from(truth));
        let (e, d) = (p - t, p.ln() - t.ln());
        let ratio = d.abs().exp();
        self.squared += e * e;
        self.log += d;
        self.log_squared += d * d;
        self.log_absolute += d.abs();
        self.relative += e.abs() / t;
        self.squared_relative += e * e / t;
        for (within, bound) in self.within.iter_mut().zip([DELTA, DELTA.powi(2), DELTA.powi(3)]) {
            *within += u64::from(ratio < bound);
        }
        self.pixels += 1;
    }

    /// Adds the pixels of another one.
    pub fn merge(&mut self, other: &Self) {
        self.squared += other.squared;
        self.log += other.log;
        self.log_squared += other.log_squared;
        self.log_absolute += other.log_absolute;
        self.relative += other.relative;
        self.squared_relative += other.squared_relative;
        for (within, more) in self.within.iter_mut().zip(other.within) {
            *within += more;
        }
        self.pixels += other.pixels;
        self.missing += other.missing;
    }

    /// The scores; `None` before the first pixel.
    pub fn scores(&self) -> Option<DepthScores> {
        let n = (self.pixels > 0).then_some(self.pixels as f64)?;
        let log = self.log / n;
        let [delta1, delta2, delta3] = self.within.map(|within| within as f64 / n);
        Some(DepthScores {
            mse: self.squared / n,
            rmse: (self.squared / n).sqrt(),
            rmse_log: (self.log_squared / n).sqrt(),
            log10: self.log_absolute / n / std::f64::consts::LN_10,
            abs_rel: self.relative / n,
            sq_rel: self.squared_relative / n,
            silog: 100.0 * (self.log_squared / n - log * log).max(0.0).sqrt(),
            delta1,
            delta2,
            delta3,
        })
    }
}

/// Scores of depth, after Eigen et al., "Depth map prediction from a single image", 2014; `silog` as in
/// KITTI's benchmark. p is the prediction, t the truth, d = ln p - ln t.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct DepthScores {
    /// mean((p - t)^2)
    pub mse: f64,
    /// Root of `mse`.
    pub rmse: f64,
    /// sqrt(mean(d^2))
    pub rmse_log: f64,
    /// mean(|log10 p - log10 t|)
    pub log10: f64,
    /// mean(|p - t| / t)
    pub abs_rel: f64,
    /// mean((p - t)^2 / t)
    pub sq_rel: f64,
    /// 100 sqrt(mean(d^2) - mean(d)^2)
    pub silog: f64,
    /// Share of pixels with max(p / t, t / p) < 1.25
    pub delta1: f64,
    /// ... < 1.25^2
    pub delta2: f64,
    /// ... < 1.25^3
    pub delta3: f64,
}

/// Scores of each image by itself, averaged over the images that have any.
#[derive(Debug, Clone, Default)]
pub(crate) struct ImageMean {
    sums: [f64; 10],
    images: u64,
}

impl ImageMean {
    /// Counts one image; `None` had no pixel to compare.
    pub(crate) fn add(&mut self, scores: Option<DepthScores>) {
        let Some(scores) = scores else { return };
        for (sum, (_, value)) in self.sums.iter_mut().zip(scores.named()) {
            *sum += value;
        }
        self.images += 1;
    }

    /// The scores; `None` before the first image.
    pub(crate) fn scores(&self) -> Option<DepthScores> {
        let n = (self.images > 0).then_some(self.images as f64)?;
        let [mse, rmse, rmse_log, log10, abs_rel, sq_rel, silog, delta1, delta2, delta3] =
            self.sums.map(|sum| sum / n);
        Some(DepthScores { mse, rmse, rmse_log, log10, abs_rel, sq_rel, silog, delta1, delta2, delta3 })
    }
}

impl DepthScores {
    /// The fields, in their order.
    pub const NAMES: [&'static str; 10] =
        ["mse", "rmse", "rmse_log", "log10", "abs_rel", "sq_rel", "silog", "delta1", "delta2", "delta3"];

    /// Names and values, in the order of the fields.
    pub fn named(&self) -> [(&'static str, f64); 10] {
        let Self { mse, rmse, rmse_log, log10, abs_rel, sq_rel, silog, delta1, delta2, delta3 } = *self;
        let values = [mse, rmse, rmse_log, log10, abs_rel, sq_rel, silog, delta1, delta2, delta3];
        std::array::from_fn(|index| (Self::NAMES[index], values[index]))
    }
}

/// The confusion matrix.
#[derive(Debug, Clone)]
pub struct LabelMetrics {
    classes: usize,
    /// `[truth][predicted]`, the last column is for numbers that are not a class.
    confusion: Vec<u64>,
}

/// Scores of labels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LabelScores {
    /// Mean over the classes that were seen or predicted of hit / (truth + predicted - hit).
    pub miou: f64,
    /// Share of pixels with the right class.
    pub accuracy: f64,
    /// Pixels that were compared.
    pub pixels: u64,
}

impl LabelMetrics {
    /// Nothing counted yet.
    #[must_use]
    pub fn new(classes: usize) -> Self {
        Self { classes, confusion: vec![0; classes * (classes + 1)] }
    }

    /// Counts one image; pixels whose truth is [`IGNORE`] are skipped.
    pub fn add(&mut self, predicted: &[u8], truth: &[u8]) {
        for (&predicted, &truth) in predicted.iter().zip(truth) {
            let at = usize::from(truth) * (self.classes + 1) + usize::from(predicted).min(self.classes);
            if truth != IGNORE
                && let Some(count) = self.confusion.get_mut(at)
            {
                *count += 1;
            }
        }
    }

    /// The scores; `None` before the first pixel.
    pub fn scores(&self) -> Option<LabelScores> {
        let total: u64 = self.confusion.iter().sum();
        let columns = self.classes + 1;
        let row = |class: usize| self.confusion.iter().skip(class * columns).take(columns);
        let column = |class: usize| self.confusion.iter().skip(class).step_by(columns);
        let hit = |class: usize| self.confusion.get(class * columns + class).copied().unwrap_or_default();
        let union = |class: usize| row(class).sum::<u64>() + column(class).sum::<u64>() - hit(class);
        let seen: Vec<_> = (0..self.classes).filter(|&class| union(class) > 0).collect();
        let iou: f64 = seen.iter().map(|&class| hit(class) as f64 / union(class) as f64).sum();
        let right: u64 = (0..self.classes).map(hit).sum();
        (total > 0).then(|| LabelScores {
            miou: iou / seen.len() as f64,
            accuracy: right as f64 / total as f64,
            pixels: total,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two pixels, 1 m taken for 2 m and 4 m taken for 3 m, by hand.
    #[test]
    fn scores_of_two_pixels_are_those_computed_by_hand() {
        let mut metrics = DepthMetrics::default();
        for (predicted, truth) in [(2.0, 1.0), (3.0, 4.0), (5.0, f32::NAN), (f32::NAN, 1.0)] {
            metrics.add(predicted, truth);
        }
        assert_eq!((metrics.pixels, metrics.missing), (2, 1));
        let (near, far) = (2_f64.ln(), 0.75_f64.ln());
        let mean_square = (near * near + far * far) / 2.0;
        let expected = [
            ("mse", 1.0),
            ("rmse", 1.0),
            ("rmse_log", mean_square.sqrt()),
            ("log10", (2_f64.log10() - 0.75_f64.log10()) / 2.0),
            ("abs_rel", (1.0 + 0.25) / 2.0),
            ("sq_rel", (1.0 + 0.25) / 2.0),
            ("silog", 100.0 * (near - far) / 2.0),
            ("delta1", 0.0),
            ("delta2", 0.5), // 4 / 3 < 1.5625
            ("delta3", 0.5),
        ];
        for ((name, value), (expected_name, by_hand)) in
            metrics.scores().unwrap().named().iter().zip(expected)
        {
            assert_eq!(*name, expected_name);
            assert!((value - by_hand).abs() < 1e-12, "{name}: {value} instead of {by_hand}");
        }
    }

    #[test]
    fn two_halves_merge_to_the_whole() {
        let pixels = [(2.0, 1.0), (3.0, 4.0), (1.5, 1.4)];
        let of = |pixels: &[(f32, f32)]| {
            let mut metrics = DepthMetrics::default();
            pixels.iter().for_each(|&(predicted, truth)| metrics.add(predicted, truth));
            metrics
        };
        let mut merged = of(&pixels[..1]);
        merged.merge(&of(&pixels[1..]));
        let whole = of(&pixels).scores().unwrap().named();
        for ((name, whole), (_, merged)) in whole.iter().zip(merged.scores().unwrap().named()) {
            assert!((whole - merged).abs() < 1e-12, "{name}");
        }
    }

    #[test]
    fn the_mean_over_images_weighs_small_ones_like_large_ones() {
        let of = |pixels: &[(f32, f32)]| {
            let mut metrics = DepthMetrics::default();
            pixels.iter().for_each(|&(predicted, truth)| metrics.add(predicted, truth));
            metrics.scores()
        };
        let mut mean = ImageMean::default();
        assert!(mean.scores().is_none());
        for image in [of(&[(2.0, 1.0); 3]), of(&[(4.0, 4.0)]), of(&[])] {
            mean.add(image);
        }
        let scores = mean.scores().unwrap();
        assert_eq!((scores.rmse, scores.abs_rel, scores.delta1), (0.5, 0.5, 0.5));
    }

    #[test]
    fn a_prediction_outside_the_classes_is_wrong_and_counts_for_no_class() {
        let mut labels = LabelMetrics::new(3);
        labels.add(&[4, 1, 1], &[0, 1, 1]);
        let scores = labels.scores().unwrap();
        assert_eq!((scores.miou, scores.accuracy), (0.5, 2.0 / 3.0));
    }

    #[test]
    fn nothing_counted_has_no_scores() {
        assert!(DepthMetrics::default().scores().is_none());
        assert_eq!(LabelMetrics::new(3).scores(), None);
    }

    #[test]
    fn classes_neither_seen_nor_predicted_do_not_count() {
        let mut labels = LabelMetrics::new(4);
        labels.add(&[0, 0, 1, 1, 2], &[0, 1, 1, 1, IGNORE]);
        // class 0: 1 of 2, class 1: 2 of 3, classes 2 and 3 are neither.
        let scores = labels.scores().unwrap();
        assert!((scores.miou - (0.5 + 2.0 / 3.0) / 2.0).abs() < 1e-12);
        assert!((scores.accuracy - 0.75).abs() < 1e-12);
    }
}
