//! Depth against truth: protocols, metres and stretched depth.

use anyhow::bail;

use super::metrics::{DepthMetrics, PictureMean};
use crate::cli::ProtocolArg;

/// Predictions below would make relative errors meaningless; the field's figure.
const MIN_DEPTH_M: f32 = 1e-3;
/// The cap of all protocols here: truth beyond is no truth, and predictions end there, as in the code of `BTS`, `AdaBins`
/// and `ZoeDepth`.
const MAX_DEPTH_M: f32 = 10.0;
/// What is left of 0 where a logarithm is taken; squared errors, all that is read of stretched depth, do not notice.
const CLIP: f32 = 1e-7;
/// The least range that is stretched to 0..1.
const LEAST_RANGE: f32 = 1e-6;

impl ProtocolArg {
    /// The pixels that are compared: rows, columns.
    fn crop(self, (width, height): (u32, u32)) -> anyhow::Result<[std::ops::Range<usize>; 2]> {
        match self {
            Self::Full => Ok([0..height as usize, 0..width as usize]),
            Self::Eigen if (width, height) == (640, 480) => Ok([45..471, 41..601]),
            Self::Eigen => {
                bail!(
                    "protocol `eigen` is for pictures of 640x480, this one is {width}x{height}\nhint: --protocol full"
                )
            }
        }
    }
}

/// Figures of depth gathered picture by picture.
#[derive(Debug, Clone)]
pub(super) struct Comparison {
    protocol: ProtocolArg,
    kind: Kind,
    /// Metres under the protocol; empty where the network has none.
    pub(super) depth: DepthMetrics,
    /// Of each picture by itself.
    pub(super) each: PictureMean,
    /// Whole pictures, each stretched from its nearest to its farthest point, as the paper did.
    pub(super) minmax: DepthMetrics,
    /// Pixels of truth under the protocol that lie outside of what is compared.
    pub(super) beyond: u64,
    /// The nearest and the farthest truth under the protocol, metres, whether it is compared or not.
    truth_m: Option<(f32, f32)>,
}

/// What predictions are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Metres.
    Metric,
    /// Stretched to 0..1 already.
    MinMax,
    /// Without a unit.
    Relative,
}

impl Comparison {
    pub(super) fn new(protocol: ProtocolArg, kind: Kind) -> Self {
        let (depth, minmax) = (DepthMetrics::default(), DepthMetrics::default());
        Self { protocol, kind, depth, each: PictureMean::default(), minmax, beyond: 0, truth_m: None }
    }

    /// Whether there was truth to compare metres with.
    ///
    /// # Errors
    /// There was none within the cap, so that every figure would be missing.
    pub(super) fn check_truth(&self) -> anyhow::Result<()> {
        if self.kind != Kind::Metric || self.depth.pixels + self.depth.missing > 0 {
            return Ok(());
        }
        let Some((near, far)) = self.truth_m else {
            bail!(
                "no picture has true depth where depth is compared\nhint: 0 and NaN mean none; --window and --protocol leave parts out"
            );
        };
        bail!(
            "no true depth lies between {MIN_DEPTH_M} and {MAX_DEPTH_M} m, where depth is compared: it is {near} to {far} m\n\
             hint: --depth-scale METRES says what a unit of the depth pictures is"
        )
    }

    /// What is compared: metres where there are any.
    pub(super) fn compared(&self) -> &DepthMetrics {
        if self.kind == Kind::Metric { &self.depth } else { &self.minmax }
    }

    /// The share of the truth under the protocol that is not compared because it lies too far, or too near.
    pub(super) fn share_beyond(&self) -> f64 {
        let all = self.depth.pixels + self.depth.missing + self.beyond;
        self.beyond as f64 / all.max(1) as f64
    }

    /// What predictions are.
    pub(super) fn kind(&self) -> Kind {
        self.kind
    }

    /// Counts one picture and gives its own figures.
    pub(super) fn add(
        &mut self,
        predicted: &[f32],
        truth_m: &[f32],
        size: (u32, u32),
    ) -> anyhow::Result<Self> {
        let mut alone = Self::new(self.protocol, self.kind);
        let [rows, columns] = self.protocol.crop(size)?;
        if self.kind == Kind::Metric {
            let capped = |depth_m: f32| depth_m.clamp(MIN_DEPTH_M, MAX_DEPTH_M);
            let is_compared = |depth_m: f32| MIN_DEPTH_M < depth_m && depth_m < MAX_DEPTH_M;
            let width = size.0 as usize;
            let lines = predicted.chunks_exact(width).zip(truth_m.chunks_exact(width));
            for (predicted, truth) in lines.take(rows.end).skip(rows.start) {
                for (&p, &t) in predicted.iter().zip(truth).take(columns.end).skip(columns.start) {
                    alone.depth.add(capped(p), if is_compared(t) { t } else { f32::NAN });
                    alone.beyond += u64::from(t.is_finite() && !is_compared(t));
                    alone.see(t);
                }
            }
        }
        let guess = match self.kind {
            Kind::MinMax => predicted.iter().map(|p| p.clamp(0.0, 1.0)).collect(),
            Kind::Metric | Kind::Relative => stretched(predicted, truth_m),
        };
        for (&p, &t) in guess.iter().zip(&stretched(truth_m, truth_m)) {
            alone.minmax.add(positive(p), positive(t));
        }
        self.depth.merge(&alone.depth);
        self.each.add(alone.depth.figures());
        self.minmax.merge(&alone.minmax);
        self.beyond += alone.beyond;
        for end in alone.truth_m.map_or([f32::NAN; 2], |(near, far)| [near, far]) {
            self.see(end);
        }
        Ok(alone)
    }

    /// Takes note of a pixel's truth, NaN = none.
    fn see(&mut self, truth_m: f32) {
        if truth_m.is_finite() {
            let (near, far) = self.truth_m.unwrap_or((truth_m, truth_m));
            self.truth_m = Some((near.min(truth_m), far.max(truth_m)));
        }
    }
}

/// 0 lifted off the logarithm's edge; NaN stays NaN.
fn positive(stretched: f32) -> f32 {
    if stretched < CLIP { CLIP } else { stretched }
}

/// Depth stretched to 0..1 over the pixels whose truth is known, NaN elsewhere.
pub(super) fn stretched(depth: &[f32], truth: &[f32]) -> Vec<f32> {
    let known = depth.iter().zip(truth).filter(|(depth, truth)| depth.is_finite() && truth.is_finite());
    let (near, far) = known.fold((f32::INFINITY, f32::NEG_INFINITY), |(near, far), (&depth, _)| {
        (near.min(depth), far.max(depth))
    });
    let range = (far - near).max(LEAST_RANGE);
    let stretch =
        |(&depth, truth): (&f32, &f32)| if truth.is_finite() { (depth - near) / range } else { f32::NAN };
    depth.iter().zip(truth).map(stretch).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (3, 1);

    #[test]
    fn stretching_knows_only_pixels_with_truth() {
        let truth = [1.0, f32::NAN, 3.0];
        let found = stretched(&[2.0, 100.0, 6.0], &truth);
        assert_eq!((found[0], found[2]), (0.0, 1.0));
        assert!(found[1].is_nan());
    }

    #[test]
    fn a_prediction_of_another_scale_has_no_stretched_error_but_one_in_metres() {
        let mut comparison = Comparison::new(ProtocolArg::Full, Kind::Metric);
        let alone = comparison.add(&[2.0, 4.0, 6.0], &[1.0, 2.0, 3.0], SIZE).unwrap();
        assert!(alone.minmax.figures().unwrap().mse < 1e-12);
        let figures = comparison.depth.figures().unwrap();
        assert!((figures.abs_rel - 1.0).abs() < 1e-6, "{figures:?}");
    }

    #[test]
    fn truth_beyond_ten_metres_is_none_and_predictions_end_there() {
        let mut comparison = Comparison::new(ProtocolArg::Full, Kind::Metric);
        comparison.add(&[50.0, 0.0, f32::NAN], &[9.0, 1.0, 1.0], SIZE).unwrap();
        comparison.add(&[2.0, 2.0, 2.0], &[12.0, 10.0, 1e-3], SIZE).unwrap();
        let figures = comparison.depth.figures().unwrap();
        // 50 m are taken for 10 m where there are 9, and 0 m for a millimetre where there is 1 m; no other pixel counts.
        assert!((figures.mse - (1.0 + 0.999 * 0.999) / 2.0).abs() < 1e-6, "{figures:?}");
        assert_eq!((comparison.depth.pixels, comparison.depth.missing), (2, 1));
        assert_eq!((comparison.beyond, comparison.share_beyond()), (3, 0.5));
        let each = comparison.each.figures().unwrap();
        assert!(
            (each.mse - figures.mse).abs() < 1e-12,
            "a picture without a pixel counts for nothing: {each:?}"
        );
        assert!(comparison.check_truth().is_ok());
    }

    #[test]
    fn truth_of_another_scale_is_told_with_the_scale_that_it_seems_to_have() {
        let mut comparison = Comparison::new(ProtocolArg::Full, Kind::Metric);
        assert!(comparison.check_truth().unwrap_err().to_string().starts_with("no picture has true depth"));
        comparison.add(&[1.0; 3], &[1250.0, f32::NAN, 4000.0], SIZE).unwrap();
        let error = comparison.check_truth().unwrap_err().to_string();
        assert!(
            error.contains(
                "between 0.001 and 10 m, where depth is compared: it is 1250 to 4000 m\nhint: --depth-scale"
            ),
            "{error}"
        );
        comparison.add(&[1.0; 3], &[f32::NAN, f32::NAN, 4.0], SIZE).unwrap();
        assert!(comparison.check_truth().is_ok(), "one pixel is enough");
        assert!(Comparison::new(ProtocolArg::Full, Kind::Relative).check_truth().is_ok(), "it has no metres");
    }

    #[test]
    fn eigens_crop_is_for_pictures_of_vga_alone() {
        let error =
            Comparison::new(ProtocolArg::Eigen, Kind::Metric).add(&[1.0; 3], &[1.0; 3], SIZE).unwrap_err();
        assert!(error.to_string().contains("640x480, this one is 3x1"), "{error}");
    }

    #[test]
    fn eigens_crop_has_426_rows_of_560_columns() {
        let depth = vec![1.0; 640 * 480];
        let mut comparison = Comparison::new(ProtocolArg::Eigen, Kind::Metric);
        comparison.add(&depth, &depth, (640, 480)).unwrap();
        assert_eq!(comparison.depth.pixels, 426 * 560);
        assert_eq!(comparison.minmax.pixels, 640 * 480);
    }
}
