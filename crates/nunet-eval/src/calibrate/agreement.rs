//! Checks whether observations of a factor agree.
//!
//! Their center is the median, their spread 1.4826 times the median absolute deviation (MAD), which is the
//! standard deviation for a normal distribution and does not depend on outliers. An observation that is
//! farther from the median than three times the spread is an outlier: the Hampel identifier, in the form that
//! Leys et al. recommend (Detecting outliers: Do not use standard deviation around the mean, use absolute
//! deviation around the median, Journal of Experimental Social Psychology 49, 2013). Logarithms of factors
//! are compared, so that twice and half are equally far from one.

use std::fmt;

use super::error::{CalibrateError, MAX_SPREAD, MIN_AGREEING};
use super::kind::ReferenceKind;
use crate::median::median;

/// The ratio of standard deviation and MAD of a normal distribution.
const MAD_TO_DEVIATION: f64 = 1.4826;
/// Outliers are farther away than this many spreads.
const OUTLIER: f64 = 3.0;
/// Observations within this share of the median always agree: the spread of nearly equal ones is almost 0.
const ALWAYS_AGREE: f64 = 0.05;
/// The number of observations that an error names.
const NAMED: usize = 3;

/// The factor in one frame, image or reading.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Observation {
    /// Names it in an error.
    pub(crate) name: String,
    /// True depth over the network's depth.
    pub(crate) factor: f64,
}

/// A factor that observations agree on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// The factor by which the network's meters are multiplied.
    pub factor: f64,
    /// The relative spread of the observations; NaN for a single one.
    pub spread: f64,
    /// How many observations there are.
    pub observations: usize,
    /// How many of them agree.
    pub agreeing: usize,
}

impl fmt::Display for Agreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { factor, spread, observations, agreeing } = self;
        let spread =
            if spread.is_finite() { format!("{:.1} %", 100.0 * spread) } else { "unknown".to_owned() };
        write!(f, "factor {factor:.4}, spread {spread}, agreeing observations: {agreeing} of {observations}")
    }
}

impl Agreement {
    /// The factor of these observations, which were made with a reference of this kind.
    pub(crate) fn of(observations: &[Observation], reference: ReferenceKind) -> Result<Self, CalibrateError> {
        let needed = reference.needed();
        let count = observations.len();
        let logs: Vec<f64> = observations.iter().map(|observation| observation.factor.ln()).collect();
        let Some(middle) = median(logs.clone()).filter(|_| count >= needed) else {
            return Err(CalibrateError::TooFew { got: count, needed, reference });
        };
        let off = |log: &f64| (log - middle).abs();
        let spread = MAD_TO_DEVIATION * median(logs.iter().map(off).collect()).unwrap_or(0.0);
        let reach = (OUTLIER * spread).max(ALWAYS_AGREE);
        let agreeing: Vec<f64> = logs.iter().copied().filter(|log| off(log) <= reach).collect();
        if spread > MAX_SPREAD || (agreeing.len() as f64) < MIN_AGREEING * count as f64 {
            let (agreeing, worst) = (agreeing.len(), worst(observations, middle.exp()));
            return Err(CalibrateError::Inconsistent { spread, observations: count, agreeing, worst });
        }
        let factor = median(agreeing.clone()).unwrap_or(middle).exp();
        let spread = if count > 1 { spread } else { f64::NAN };
        Ok(Self { factor, spread, observations: count, agreeing: agreeing.len() })
    }
}

/// The observations that are farthest from the factor.
fn worst(observations: &[Observation], factor: f64) -> String {
    let mut sorted: Vec<&Observation> = observations.iter().collect();
    let off = |observation: &Observation| (observation.factor / factor).ln().abs();
    sorted.sort_by(|a, b| off(b).total_cmp(&off(a)));
    let named = sorted.iter().take(NAMED).map(|one| format!("{} gives {:.3}", one.name, one.factor));
    named.collect::<Vec<_>>().join(", ")
}

/// The factor with the least mean absolute relative error, given the exact factor of each pixel: their
/// median, weighted by their inverses. `None` without any.
pub(crate) fn least_relative_error(mut factors: Vec<f64>) -> Option<f64> {
    factors.sort_unstable_by(f64::total_cmp);
    let half = factors.iter().map(|factor| 1.0 / factor).sum::<f64>() / 2.0;
    let mut sum = 0.0;
    factors.into_iter().find(|factor| {
        sum += 1.0 / factor;
        sum >= half
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn agreement(factors: &[f64]) -> Result<Agreement, CalibrateError> {
        let observation =
            |(place, &factor): (usize, &f64)| Observation { name: format!("frame {place}"), factor };
        Agreement::of(
            &factors.iter().enumerate().map(observation).collect::<Vec<_>>(),
            ReferenceKind::Readings,
        )
    }

    #[test]
    fn an_outlier_does_not_count() {
        let found = agreement(&[0.80, 0.81, 0.79, 0.80, 0.82, 3.0]).unwrap();
        assert!((found.factor - 0.80).abs() < 1e-9, "{found:?}");
        assert_eq!((found.observations, found.agreeing), (6, 5));
        assert!(found.spread < 0.03, "{found:?}");
    }

    #[test]
    fn equal_observations_agree_although_their_spread_is_nothing() {
        let found = agreement(&[0.5, 0.5, 0.5, 0.51]).unwrap();
        assert_eq!((found.spread, found.agreeing), (0.0, 4));
    }

    #[test]
    fn observations_that_contradict_each_other_are_refused_and_the_worst_are_named() {
        for wrong in [&[0.5, 1.0, 2.0, 0.7, 1.4][..], &[1.0, 1.0, 2.0], &[0.9, 0.9, 0.9, 900.0, 900.0, 900.0]]
        {
            let error = agreement(wrong).unwrap_err();
            let CalibrateError::Inconsistent { worst, .. } = &error else { panic!("{error}") };
            assert!(worst.starts_with("frame "), "{worst}");
        }
    }

    #[test]
    fn an_error_names_what_contradicts() {
        for (factors, expected) in [
            (&[0.5, 1.0, 2.0][..], "their spread is 103 %, expected at most 25 %"),
            (&[0.9, 0.9, 0.9, 0.9, 900.0, 900.0], "4 of 6 agree, expected at least 70 %"),
        ] {
            let text = agreement(factors).unwrap_err().to_string();
            assert!(text.contains(expected), "{text}");
        }
    }

    #[test]
    fn no_other_factor_has_a_smaller_relative_error() {
        let factors = vec![0.5, 0.8, 0.9, 1.0, 1.1, 1.6, 2.5];
        let error = |one: f64| factors.iter().map(|factor| (one / factor - 1.0).abs()).sum::<f64>();
        let found = least_relative_error(factors.clone()).unwrap();
        let least = factors.iter().map(|one| error(*one)).fold(f64::INFINITY, f64::min);
        assert!((error(found) - least).abs() < 1e-12, "{found}");
        assert_eq!(least_relative_error(Vec::new()), None);
    }

    #[test]
    fn fewer_than_needed_are_refused() {
        assert!(matches!(agreement(&[1.0, 1.0]), Err(CalibrateError::TooFew { got: 2, needed: 3, .. })));
        assert!(matches!(agreement(&[]), Err(CalibrateError::TooFew { got: 0, .. })));
        let one = [Observation { name: "a".into(), factor: 0.7 }];
        let found = Agreement::of(&one, ReferenceKind::Point).unwrap();
        assert!((found.factor - 0.7).abs() < 1e-12 && found.spread.is_nan());
    }
}
