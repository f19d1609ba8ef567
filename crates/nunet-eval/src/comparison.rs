//! Depth against truth: protocols, meters and stretched depth.

use std::ops::Range;

use nunet_core::depth::DepthKind;
use nunet_types::ImageSize;

use crate::error::EvalError;
use crate::metrics::{DepthMetrics, ImageMean};
use crate::options::Protocol;
use crate::sparsification::Pixel;

/// Smaller predictions would make relative errors meaningless; the usual value in the literature.
const MIN_DEPTH_M: f32 = 1e-3;
/// The usual cap for rooms: truth beyond it is ignored and predictions are clamped to it, as in the code of
/// `BTS`, `AdaBins` and `ZoeDepth`.
#[cfg(test)]
const ROOM_CAP_M: f32 = 10.0;
/// Replaces 0 where a logarithm is taken. Only squared errors of stretched depth are used, and they do not
/// change.
const CLIP: f32 = 1e-7;
/// The smallest range that is stretched to 0..1.
const LEAST_RANGE: f32 = 1e-6;

/// The rows and columns that are compared.
fn crop(protocol: Protocol, size: ImageSize) -> Result<[Range<usize>; 2], EvalError> {
    match protocol {
        Protocol::Full => Ok([0..size.height as usize, 0..size.width as usize]),
        Protocol::Eigen if size == ImageSize::new(640, 480) => Ok([45..471, 41..601]),
        Protocol::Eigen => Err(EvalError::ProtocolSize { size }),
    }
}

/// Metrics of depth, accumulated image by image.
#[derive(Debug, Clone)]
pub(crate) struct Comparison {
    protocol: Protocol,
    /// True depth from here on is not compared, and predictions end here.
    cap_m: f32,
    kind: DepthKind,
    /// Meters under the protocol; empty where the network has none.
    pub(crate) depth: DepthMetrics,
    /// Metrics of each image, averaged over images.
    pub(crate) each: ImageMean,
    /// Whole images, each stretched from its nearest to its farthest point, as the paper did.
    pub(crate) minmax: DepthMetrics,
    /// Pixels of truth under the protocol that lie outside of what is compared.
    pub(crate) beyond: u64,
    /// The truth under the protocol, whether it is compared or not.
    truth: TruthRange,
}

/// The nearest and the farthest truth.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TruthRange {
    /// Meters.
    pub(crate) ends_m: Option<(f32, f32)>,
    /// Whether any was stated in meters, so that no other unit can be stated.
    pub(crate) is_meters: bool,
}

impl TruthRange {
    /// Records the truth of a pixel, NaN = none.
    pub(crate) fn see(&mut self, truth_m: f32) {
        if truth_m.is_finite() {
            let (near, far) = self.ends_m.unwrap_or((truth_m, truth_m));
            self.ends_m = Some((near.min(truth_m), far.max(truth_m)));
        }
    }
}

impl Comparison {
    pub(crate) fn new(protocol: Protocol, cap_m: f32, kind: DepthKind) -> Self {
        let (depth, minmax) = (DepthMetrics::default(), DepthMetrics::default());
        let (each, truth) = (ImageMean::default(), TruthRange::default());
        Self { protocol, cap_m, kind, depth, each, minmax, beyond: 0, truth }
    }

    /// # Errors
    /// A size for which the protocol is not defined.
    pub(crate) fn check_size(&self, image: ImageSize) -> Result<(), EvalError> {
        crop(self.protocol, image).map(drop)
    }

    /// Whether there was truth to compare meters with.
    ///
    /// # Errors
    /// No truth is within the cap, so every metric would be missing.
    pub(crate) fn check_truth(&self) -> Result<(), EvalError> {
        if self.kind != DepthKind::Metric || self.depth.pixels + self.depth.missing > 0 {
            return Ok(());
        }
        let TruthRange { ends_m, is_meters } = self.truth;
        let (near_m, far_m) = ends_m.ok_or(EvalError::NoTruth)?;
        let (from_m, cap_m) = (MIN_DEPTH_M, self.cap_m);
        Err(EvalError::TruthOutOfRange { from_m, cap_m, near_m, far_m, is_meters })
    }

    /// The main metrics: in meters if the network has meters, otherwise of stretched depth.
    pub(crate) fn compared(&self) -> &DepthMetrics {
        if self.kind == DepthKind::Metric { &self.depth } else { &self.minmax }
    }

    /// The share of the truth under the protocol that is not compared because it is too far or too near.
    pub(crate) fn share_beyond(&self) -> f64 {
        let all = self.depth.pixels + self.depth.missing + self.beyond;
        self.beyond as f64 / all.max(1) as f64
    }

    /// The farthest truth under the protocol, whether it is compared or not.
    pub(crate) fn farthest_m(&self) -> Option<f32> {
        self.truth.ends_m.map(|(_, far)| far)
    }

    /// Records that an image's truth is stated in meters.
    pub(crate) fn see_meters(&mut self) {
        self.truth.is_meters = true;
    }

    /// Whether any truth is stated in meters.
    pub(crate) fn is_meters(&self) -> bool {
        self.truth.is_meters
    }

    /// The cap, meters.
    pub(crate) fn cap_m(&self) -> f32 {
        self.cap_m
    }

    /// What predictions are.
    pub(crate) fn kind(&self) -> DepthKind {
        self.kind
    }

    /// Counts one image, `[H, W]` in meters (predictions as [`DepthKind`] states), and returns its own
    /// metrics.
    ///
    /// # Errors
    /// The protocol is for images of another size.
    pub(crate) fn add(
        &mut self,
        predicted: &[f32],
        truth_m: &[f32],
        size: ImageSize,
    ) -> Result<Self, EvalError> {
        let mut alone = Self::new(self.protocol, self.cap_m, self.kind);
        let [rows, columns] = crop(self.protocol, size)?;
        if self.kind == DepthKind::Metric {
            let capped = |depth_m: f32| depth_m.clamp(MIN_DEPTH_M, self.cap_m);
            let is_compared = |depth_m: f32| MIN_DEPTH_M < depth_m && depth_m < self.cap_m;
            let width = size.width as usize;
            let lines = predicted.chunks_exact(width).zip(truth_m.chunks_exact(width));
            for (predicted, truth) in lines.take(rows.end).skip(rows.start) {
                for (&p, &t) in predicted.iter().zip(truth).take(columns.end).skip(columns.start) {
                    alone.depth.add(capped(p), if is_compared(t) { t } else { f32::NAN });
                    alone.beyond += u64::from(t.is_finite() && !is_compared(t));
                    alone.truth.see(t);
                }
            }
        }
        let guess = match self.kind {
            DepthKind::MinMax => predicted.iter().map(|p| p.clamp(0.0, 1.0)).collect(),
            DepthKind::Metric | DepthKind::Relative => stretched(predicted, truth_m),
        };
        for (&p, &t) in guess.iter().zip(&stretched(truth_m, truth_m)) {
            alone.minmax.add(positive(p), positive(t));
        }
        self.depth.merge(&alone.depth);
        self.each.add(alone.depth.scores());
        self.minmax.merge(&alone.minmax);
        self.beyond += alone.beyond;
        for end in alone.truth.ends_m.map_or([f32::NAN; 2], |(near, far)| [near, far]) {
            self.truth.see(end);
        }
        Ok(alone)
    }

    /// Prediction, truth and confidence of the pixels of an image that are compared in meters.
    ///
    /// # Errors
    /// The protocol is for images of another size.
    pub(crate) fn pixels(
        &self,
        predicted: &[f32],
        truth_m: &[f32],
        confidence: &[u8],
        size: ImageSize,
    ) -> Result<Vec<Pixel>, EvalError> {
        let [rows, columns] = crop(self.protocol, size)?;
        if self.kind != DepthKind::Metric {
            return Ok(Vec::new());
        }
        let width = size.width as usize;
        let places = rows.flat_map(|row| columns.clone().map(move |column| row * width + column));
        let pixel = |place: usize| {
            let (p, t) = (predicted[place].clamp(MIN_DEPTH_M, self.cap_m), truth_m[place]);
            let is_compared = p.is_finite() && MIN_DEPTH_M < t && t < self.cap_m;
            is_compared.then_some((p, t, confidence[place]))
        };
        Ok(places.filter_map(pixel).collect())
    }
}

/// Replaces 0, which has no logarithm; NaN stays NaN.
fn positive(stretched: f32) -> f32 {
    if stretched < CLIP { CLIP } else { stretched }
}

/// Depth stretched to 0..1 over the pixels whose truth is known, NaN elsewhere.
pub(crate) fn stretched(depth: &[f32], truth: &[f32]) -> Vec<f32> {
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

    const SIZE: ImageSize = ImageSize::new(3, 1);

    #[test]
    fn stretching_uses_only_pixels_with_truth() {
        let truth = [1.0, f32::NAN, 3.0];
        let found = stretched(&[2.0, 100.0, 6.0], &truth);
        assert_eq!((found[0], found[2]), (0.0, 1.0));
        assert!(found[1].is_nan());
    }

    #[test]
    fn a_prediction_of_another_scale_has_no_stretched_error_but_one_in_meters() {
        let mut comparison = Comparison::new(Protocol::Full, ROOM_CAP_M, DepthKind::Metric);
        let alone = comparison.add(&[2.0, 4.0, 6.0], &[1.0, 2.0, 3.0], SIZE).unwrap();
        assert!(alone.minmax.scores().unwrap().mse < 1e-12);
        let scores = comparison.depth.scores().unwrap();
        assert!((scores.abs_rel - 1.0).abs() < 1e-6, "{scores:?}");
    }

    #[test]
    fn truth_beyond_ten_meters_is_not_compared_and_predictions_are_clamped() {
        let mut comparison = Comparison::new(Protocol::Full, ROOM_CAP_M, DepthKind::Metric);
        comparison.add(&[50.0, 0.0, f32::NAN], &[9.0, 1.0, 1.0], SIZE).unwrap();
        comparison.add(&[2.0, 2.0, 2.0], &[12.0, 10.0, 1e-3], SIZE).unwrap();
        let scores = comparison.depth.scores().unwrap();
        // 50 m are taken for 10 m where there are 9, and 0 m for a millimeter where there is 1 m; no other
        // pixel counts.
        assert!((scores.mse - (1.0 + 0.999 * 0.999) / 2.0).abs() < 1e-6, "{scores:?}");
        assert_eq!((comparison.depth.pixels, comparison.depth.missing), (2, 1));
        assert_eq!((comparison.beyond, comparison.share_beyond()), (3, 0.5));
        let each = comparison.each.scores().unwrap();
        assert!(
            (each.mse - scores.mse).abs() < 1e-12,
            "an image without a pixel counts for nothing: {each:?}"
        );
        assert!(comparison.check_truth().is_ok());
    }

    #[test]
    fn truth_of_another_scale_is_reported_with_its_range() {
        let mut comparison = Comparison::new(Protocol::Full, ROOM_CAP_M, DepthKind::Metric);
        assert!(matches!(comparison.check_truth(), Err(EvalError::NoTruth)));
        comparison.add(&[1.0; 3], &[1250.0, f32::NAN, 4000.0], SIZE).unwrap();
        let Err(EvalError::TruthOutOfRange { cap_m, near_m, far_m, .. }) = comparison.check_truth() else {
            panic!("truth beyond the cap counts")
        };
        assert_eq!((cap_m, near_m, far_m), (ROOM_CAP_M, 1250.0, 4000.0));
        comparison.add(&[1.0; 3], &[f32::NAN, f32::NAN, 4.0], SIZE).unwrap();
        assert!(comparison.check_truth().is_ok(), "one pixel is enough");
        assert!(
            Comparison::new(Protocol::Full, ROOM_CAP_M, DepthKind::Relative).check_truth().is_ok(),
            "it has no meters"
        );
    }

    #[test]
    fn truth_up_to_a_larger_cap_is_compared_on_request() {
        let mut comparison = Comparison::new(Protocol::Full, 80.0, DepthKind::Metric);
        comparison.add(&[60.0, 200.0, 10.0], &[30.0, 79.0, 81.0], SIZE).unwrap();
        assert_eq!((comparison.depth.pixels, comparison.beyond), (2, 1));
        let scores = comparison.depth.scores().unwrap();
        assert!((scores.mse - (900.0 + 1.0) / 2.0).abs() < 1e-3, "predictions end at 80 m: {scores:?}");
    }

    #[test]
    fn eigens_crop_is_for_vga_images_only() {
        let added =
            Comparison::new(Protocol::Eigen, ROOM_CAP_M, DepthKind::Metric).add(&[1.0; 3], &[1.0; 3], SIZE);
        assert!(matches!(added, Err(EvalError::ProtocolSize { size: SIZE })));
    }

    #[test]
    fn eigens_crop_has_426_rows_of_560_columns() {
        let depth = vec![1.0; 640 * 480];
        let mut comparison = Comparison::new(Protocol::Eigen, ROOM_CAP_M, DepthKind::Metric);
        comparison.add(&depth, &depth, ImageSize::new(640, 480)).unwrap();
        assert_eq!(comparison.depth.pixels, 426 * 560);
        assert_eq!(comparison.minmax.pixels, 640 * 480);
    }
}
