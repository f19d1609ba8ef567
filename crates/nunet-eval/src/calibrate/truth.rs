//! Images with true depth as a reference.

use nunet_source::Frame;

use super::agreement::least_relative_error;
use super::{CalibrateError, Calibrator, ReferenceKind};
use crate::comparison::TruthRange;
use crate::dataset::{Dataset, Truth, refuse_own_depth};
use crate::error::EvalError;
use crate::event::{Event, OnEvent};
use crate::fit::Fit;
use crate::options::EvalOptions;
use crate::reported::Reported;

/// What was found in the images of a dataset.
#[derive(Default)]
struct Found {
    /// Whether any image could be read.
    has_read: bool,
    range: TruthRange,
    reported: Reported,
    /// The last error of an image.
    last: Option<EvalError>,
}

impl Found {
    fn see(&mut self, truth: &Truth) {
        self.has_read = true;
        self.range.is_meters |= truth.is_meters;
        truth.depth_m.iter().for_each(|&meters| self.range.see(meters));
    }

    fn skip(&mut self, id: &str, error: EvalError, on_event: OnEvent<'_>) {
        self.reported.report(id, &error, on_event);
        self.last = Some(error);
    }

    /// Whether any image could be compared, with true depth below the cap.
    fn check(self, cap_m: f32) -> Result<(), CalibrateError> {
        if let Some(source) = self.last.filter(|_| !self.has_read) {
            return Err(EvalError::NothingMeasured { source: source.into() }.into());
        }
        let is_meters = self.range.is_meters;
        match self.range.ends_m {
            Some((near_m, far_m)) if near_m >= cap_m => {
                Err(CalibrateError::TruthTooFar { near_m, far_m, cap_m, is_meters })
            }
            _ => Ok(()),
        }
    }
}

impl Calibrator {
    /// Compares with the true depth of a dataset, one observation per image.
    ///
    /// # Errors
    /// A dataset that cannot be used, a recording of predictions, or no image that can be read. Single images
    /// that cannot be read are reported and counted ([`Calibrator::skipped`]).
    pub fn add_truth(
        &mut self,
        options: &EvalOptions,
        on_event: &mut dyn FnMut(Event<'_>),
    ) -> Result<(), CalibrateError> {
        refuse_own_depth(options)?;
        let mut dataset = Dataset::open(options, &self.pipeline.graph().description().classes, on_event)?;
        on_event(Event::Started { what: "images", count: dataset.ids.len() as u64 });
        let (mut frame, mut found) = (Frame::default(), Found::default());
        self.kind = ReferenceKind::Truth;
        self.skipped += dataset.unpaired;
        for id in &dataset.ids.clone() {
            let image = dataset.image(id, &mut frame, on_event);
            match image.and_then(|()| dataset.truth(id, Some(frame.size))) {
                Ok(truth) => {
                    found.see(&truth);
                    self.predict_and_report(&frame, on_event)?;
                    let factor = self.over_image(&truth.depth_m, options.depth_cap_m);
                    self.observe(format!("image `{id}`"), factor);
                }
                Err(error) => {
                    found.skip(id, error, on_event);
                    self.skipped += 1;
                }
            }
            on_event(Event::Advanced);
        }
        on_event(Event::Finished);
        found.reported.summarize(on_event);
        found.check(options.depth_cap_m)
    }

    /// The factor with the least mean absolute relative error over all pixels with truth below the cap.
    fn over_image(&self, truth_m: &[f32], cap_m: f32) -> Option<f64> {
        let predicted = Fit::new(&self.pipeline).depth(&self.depth_m);
        let pairs = truth_m.iter().zip(&predicted).filter(|(truth, _)| **truth > 0.0 && **truth < cap_m);
        let ratios = pairs.map(|(truth, predicted)| f64::from(truth / predicted));
        least_relative_error(ratios.filter(|ratio| ratio.is_finite() && *ratio > 0.0).collect())
    }
}
