//! What a network's number `v` means, undone in place.

use std::fmt;
use std::str::FromStr;

/// What a network's number `v` means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// Metres: z = v.
    Metric,
    /// Inverse metres: z = 1 / v.
    Inverse,
    /// Logarithm of metres: z = exp(v).
    Log,
    /// Nearer or farther, without a unit: kept as it is.
    Relative,
    /// 0 for a picture's nearest point to 1 for its farthest, without a unit: what a network says beyond is its end.
    MinMax,
}

impl Encoding {
    /// All encodings, in the order of the documentation.
    pub const ALL: [Self; 5] = [Self::Metric, Self::Inverse, Self::Log, Self::Relative, Self::MinMax];

    /// The name in a model's metadata.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Metric => "metric",
            Self::Inverse => "inverse",
            Self::Log => "log",
            Self::Relative => "relative",
            Self::MinMax => "minmax",
        }
    }

    /// Whether the decoded numbers are metres.
    #[must_use]
    pub fn is_metric(self) -> bool {
        matches!(self, Self::Metric | Self::Inverse | Self::Log)
    }

    /// Turns the network's numbers into depth, in place, and returns how many of them are no measurement (NaN).
    ///
    /// Metres come out of the metric encodings: what the network says, if it lies in `range`, times `focal_factor`;
    /// the range is the network's, so it is checked before the factor. The encodings without a unit ignore both and
    /// lose nothing but what is not finite.
    pub fn decode(self, values: &mut [f32], range: DepthRange, focal_factor: f32) -> u32 {
        match self {
            Self::Metric => range.apply(values, focal_factor, |v| v),
            Self::Inverse => range.apply(values, focal_factor, |v| 1.0 / v),
            Self::Log => range.apply(values, focal_factor, f32::exp),
            Self::Relative => replace_each(values, |v| (v, v.is_finite())),
            Self::MinMax => replace_each(values, |v| (v.clamp(0.0, 1.0), v.is_finite())),
        }
    }
}

impl fmt::Display for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Encoding {
    type Err = DepthError;

    fn from_str(text: &str) -> Result<Self, DepthError> {
        Self::ALL
            .into_iter()
            .find(|encoding| encoding.name() == text)
            .ok_or_else(|| DepthError::UnknownEncoding { text: text.to_owned() })
    }
}

/// The depths that a network can measure; what lies outside is no measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthRange {
    min_m: f32,
    max_m: f32,
}

impl DepthRange {
    /// From `min_m` to `max_m`, both included, metres.
    ///
    /// # Errors
    /// Numbers that are not finite, a negative minimum, a maximum not above the minimum.
    pub fn new(min_m: f32, max_m: f32) -> Result<Self, DepthError> {
        if min_m.is_finite() && max_m.is_finite() && 0.0 <= min_m && min_m < max_m {
            Ok(Self { min_m, max_m })
        } else {
            Err(DepthError::Range { min_m, max_m })
        }
    }

    /// The nearest depth, metres.
    #[must_use]
    pub fn min_m(self) -> f32 {
        self.min_m
    }

    /// The farthest depth, metres.
    #[must_use]
    pub fn max_m(self) -> f32 {
        self.max_m
    }

    /// Replaces each value by its depth times `factor`, or NaN where the depth is out of range.
    ///
    /// The two comparisons also sort out NaN, infinity, and depths that are not positive.
    fn apply(self, values: &mut [f32], factor: f32, depth_m: impl Fn(f32) -> f32) -> u32 {
        let nearest_m = self.min_m.max(f32::MIN_POSITIVE);
        replace_each(values, |v| {
            let z = depth_m(v);
            (z * factor, z >= nearest_m && z <= self.max_m)
        })
    }
}

/// Replaces each value by what `decoded` makes of it, or NaN where that is no measurement, and counts the latter.
///
/// No branch and no early exit, so that the compiler makes vector instructions of it.
fn replace_each(values: &mut [f32], decoded: impl Fn(f32) -> (f32, bool)) -> u32 {
    let mut invalid = 0;
    for value in values {
        let (depth, valid) = decoded(*value);
        *value = if valid { depth } else { f32::NAN };
        invalid += u32::from(!valid);
    }
    invalid
}

/// What is wrong with the description of a network's depth.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DepthError {
    /// The name of an encoding is none of ours.
    #[error("`{text}` is no depth encoding\nhint: one of metric, inverse, log, relative, minmax")]
    UnknownEncoding {
        /// What was written.
        text: String,
    },
    /// No depth lies in the range.
    #[error(
        "depth range `{min_m}` to `{max_m}` m; it must be finite, start at 0 or more, and end above its start"
    )]
    Range {
        /// The nearest depth, metres.
        min_m: f32,
        /// The farthest depth, metres.
        max_m: f32,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NAN: f32 = f32::NAN;

    fn range() -> DepthRange {
        DepthRange::new(0.5, 10.0).unwrap()
    }

    fn decode(encoding: Encoding, values: &[f32], factor: f32) -> (Vec<f32>, u32) {
        let mut values = values.to_vec();
        let invalid = encoding.decode(&mut values, range(), factor);
        (values, invalid)
    }

    fn assert_same(got: &[f32], expected: &[f32]) {
        assert_eq!(got.len(), expected.len());
        for (got, expected) in got.iter().zip(expected) {
            let close = (got - expected).abs() <= 1e-6 * expected.abs();
            assert!(close || (got.is_nan() && expected.is_nan()), "{got} is not {expected}");
        }
    }

    #[test]
    fn metres_are_kept_and_what_lies_outside_the_range_is_nan() {
        let (depth, invalid) =
            decode(Encoding::Metric, &[0.5, 0.499, 10.0, 10.001, -1.0, NAN, f32::INFINITY], 1.0);
        assert_same(&depth, &[0.5, NAN, 10.0, NAN, NAN, NAN, NAN]);
        assert_eq!(invalid, 5);
    }

    #[test]
    fn inverse_metres_are_inverted_and_infinity_is_no_depth() {
        let (depth, invalid) =
            decode(Encoding::Inverse, &[0.5, 2.0, 0.25, 0.0, -0.5, f32::INFINITY, 0.01], 1.0);
        assert_same(&depth, &[2.0, 0.5, 4.0, NAN, NAN, NAN, NAN]);
        assert_eq!(invalid, 4);
    }

    #[test]
    fn logarithms_are_raised() {
        let e = std::f32::consts::E;
        let (depth, invalid) = decode(Encoding::Log, &[0.0, 1.0, -1.0, 90.0, f32::NEG_INFINITY, NAN], 1.0);
        assert_same(&depth, &[1.0, e, NAN, NAN, NAN, NAN]);
        assert_eq!(invalid, 4);
    }

    #[test]
    fn numbers_without_a_unit_lose_only_what_is_not_finite() {
        let numbers = [0.0, -3.0, 0.5, 1000.0, NAN, f32::INFINITY];
        let (depth, invalid) = decode(Encoding::Relative, &numbers, 2.0);
        assert_same(&depth, &[0.0, -3.0, 0.5, 1000.0, NAN, NAN]);
        assert_eq!(invalid, 2);
        let (depth, invalid) = decode(Encoding::MinMax, &numbers, 2.0);
        assert_same(&depth, &[0.0, 0.0, 0.5, 1.0, NAN, NAN]);
        assert_eq!(invalid, 2);
    }

    #[test]
    fn the_range_is_checked_before_the_focal_factor() {
        let (depth, invalid) = decode(Encoding::Metric, &[0.5, 8.0, 0.25], 2.0);
        assert_same(&depth, &[1.0, 16.0, NAN]);
        assert_eq!(invalid, 1);
    }

    #[test]
    fn zero_is_no_depth_even_where_the_range_begins_there() {
        let mut values = [0.0, -0.0, 0.001];
        let invalid = Encoding::Metric.decode(&mut values, DepthRange::new(0.0, 1.0).unwrap(), 1.0);
        assert_same(&values, &[NAN, NAN, 0.001]);
        assert_eq!(invalid, 2);
    }

    #[test]
    fn a_range_that_holds_no_depth_is_refused() {
        for (min_m, max_m) in [(1.0, 1.0), (2.0, 1.0), (-1.0, 1.0), (NAN, 1.0), (0.0, f32::INFINITY)] {
            assert!(DepthRange::new(min_m, max_m).is_err(), "{min_m} {max_m}");
        }
    }

    #[test]
    fn names_are_read_as_they_are_written() {
        for encoding in Encoding::ALL {
            assert_eq!(encoding.to_string().parse(), Ok(encoding));
        }
        let error = "metres".parse::<Encoding>().unwrap_err();
        assert_eq!(
            error.to_string(),
            "`metres` is no depth encoding\nhint: one of metric, inverse, log, relative, minmax"
        );
    }

    proptest! {
        #[test]
        fn what_is_counted_is_nan_and_the_rest_lies_in_the_range(
            bits in prop::collection::vec(any::<u32>(), 0..100), which in 0usize..3,
        ) {
            let values: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
            let (depth, invalid) = decode(Encoding::ALL[which], &values, 1.0);
            prop_assert_eq!(depth.iter().filter(|z| z.is_nan()).count(), invalid as usize);
            prop_assert!(depth.iter().all(|z| z.is_nan() || (0.5..=10.0).contains(z)));
        }
    }
}
