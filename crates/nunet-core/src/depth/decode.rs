//! Decoding of network outputs, in place.

use super::DepthError;

/// A linear map of a network's output before it is decoded: `v = scale * output + shift`.
///
/// # Example: monodepth2's sigmoid output, z = 1 / (0.01 + 9.99 output)
/// ```
/// # use nunet_core::depth::{DepthEncoding, DepthError, DepthRange, OutputScale};
/// let output = OutputScale::new(9.99, 0.01)?;
/// let mut values = [1.0, 0.0];
/// let invalid = DepthEncoding::Inverse.decode(&mut values, output, DepthRange::new(0.0, 100.0)?, 1.0);
/// assert!((values[0] - 0.1).abs() < 1e-6 && (values[1] - 100.0).abs() < 1e-4 && invalid == 0);
/// # Ok::<(), DepthError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputScale {
    scale: f32,
    shift: f32,
}

impl OutputScale {
    /// `v = output`.
    pub const IDENTITY: Self = Self { scale: 1.0, shift: 0.0 };

    /// `v = scale * output + shift`.
    ///
    /// # Errors
    /// Numbers that are not finite, and a scale of 0.
    pub fn new(scale: f32, shift: f32) -> Result<Self, DepthError> {
        if scale.is_finite() && shift.is_finite() && scale != 0.0 {
            Ok(Self { scale, shift })
        } else {
            Err(DepthError::OutputScale { scale, shift })
        }
    }

    /// The factor.
    #[must_use]
    pub fn scale(self) -> f32 {
        self.scale
    }

    /// The summand.
    #[must_use]
    pub fn shift(self) -> f32 {
        self.shift
    }
}

impl Default for OutputScale {
    fn default() -> Self {
        Self::IDENTITY
    }
}

/// The depths that a network can measure. Depth outside is not a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthRange {
    min_m: f32,
    max_m: f32,
}

impl DepthRange {
    /// From `min_m` to `max_m`, both included, meters.
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

    /// The smallest depth, meters.
    #[must_use]
    pub fn min_m(self) -> f32 {
        self.min_m
    }

    /// The largest depth, meters.
    #[must_use]
    pub fn max_m(self) -> f32 {
        self.max_m
    }

    /// Replaces each value by its depth times `factor`, or by NaN if the depth is out of range.
    ///
    /// Both comparisons are false for NaN, infinity, and depths that are not positive.
    fn apply(self, values: &mut [f32], factor: f32, depth_m: impl Fn(f32) -> f32) -> u32 {
        let nearest_m = self.min_m.max(f32::MIN_POSITIVE);
        replace_each(values, |v| {
            let z = depth_m(v);
            (z * factor, z >= nearest_m && z <= self.max_m)
        })
    }
}

/// A network's output, which a [`DepthEncoding`](super::DepthEncoding) decodes in place.
pub(super) struct NetworkOutput<'a> {
    pub(super) values: &'a mut [f32],
    pub(super) scale: OutputScale,
    pub(super) range: DepthRange,
    pub(super) focal_factor: f32,
}

impl NetworkOutput<'_> {
    /// Decodes to meters by `depth_m`. Returns the number of values out of range, which become NaN.
    pub(super) fn meters(self, depth_m: impl Fn(f32) -> f32) -> u32 {
        let OutputScale { scale, shift } = self.scale;
        self.range.apply(self.values, self.focal_factor, |value| depth_m(scale * value + shift))
    }

    /// Decodes to depth without a unit; `decoded` returns it and whether it is valid. Returns the number of
    /// invalid values, which become NaN.
    pub(super) fn unitless(self, decoded: impl Fn(f32) -> (f32, bool)) -> u32 {
        let OutputScale { scale, shift } = self.scale;
        replace_each(self.values, |value| decoded(scale * value + shift))
    }
}

/// Replaces each value by what `decoded` returns for it, or by NaN if that is invalid, and counts the latter.
///
/// No branch and no early exit, so that the compiler can vectorize it.
fn replace_each(values: &mut [f32], decoded: impl Fn(f32) -> (f32, bool)) -> u32 {
    let mut invalid = 0;
    for value in values {
        let (depth, valid) = decoded(*value);
        *value = if valid { depth } else { f32::NAN };
        invalid += u32::from(!valid);
    }
    invalid
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::DepthEncoding;
    use proptest::prelude::*;

    const NAN: f32 = f32::NAN;

    fn range() -> DepthRange {
        DepthRange::new(0.5, 10.0).unwrap()
    }

    fn decode(encoding: DepthEncoding, values: &[f32], factor: f32) -> (Vec<f32>, u32) {
        let mut values = values.to_vec();
        let invalid = encoding.decode(&mut values, OutputScale::IDENTITY, range(), factor);
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
    fn meters_are_kept_and_depth_outside_the_range_is_nan() {
        let (depth, invalid) =
            decode(DepthEncoding::Metric, &[0.5, 0.499, 10.0, 10.001, -1.0, NAN, f32::INFINITY], 1.0);
        assert_same(&depth, &[0.5, NAN, 10.0, NAN, NAN, NAN, NAN]);
        assert_eq!(invalid, 5);
    }

    #[test]
    fn inverse_meters_are_inverted_and_infinity_is_nan() {
        let (depth, invalid) =
            decode(DepthEncoding::Inverse, &[0.5, 2.0, 0.25, 0.0, -0.5, f32::INFINITY, 0.01], 1.0);
        assert_same(&depth, &[2.0, 0.5, 4.0, NAN, NAN, NAN, NAN]);
        assert_eq!(invalid, 4);
    }

    #[test]
    fn logarithms_are_exponentiated() {
        let e = std::f32::consts::E;
        let (depth, invalid) =
            decode(DepthEncoding::Log, &[0.0, 1.0, -1.0, 90.0, f32::NEG_INFINITY, NAN], 1.0);
        assert_same(&depth, &[1.0, e, NAN, NAN, NAN, NAN]);
        assert_eq!(invalid, 4);
    }

    #[test]
    fn values_without_a_unit_are_nan_only_where_they_are_not_finite() {
        let numbers = [0.0, -3.0, 0.5, 1000.0, NAN, f32::INFINITY];
        let (depth, invalid) = decode(DepthEncoding::Relative, &numbers, 2.0);
        assert_same(&depth, &[0.0, -3.0, 0.5, 1000.0, NAN, NAN]);
        assert_eq!(invalid, 2);
        let (depth, invalid) = decode(DepthEncoding::MinMax, &numbers, 2.0);
        assert_same(&depth, &[0.0, 0.0, 0.5, 1.0, NAN, NAN]);
        assert_eq!(invalid, 2);
    }

    #[test]
    fn relative_inverse_depth_is_larger_where_the_output_is_smaller() {
        let numbers = [0.5, 4.0, 0.0, -2.0, NAN, f32::INFINITY, 1e-42];
        let (depth, invalid) = decode(DepthEncoding::RelativeInverse, &numbers, 2.0);
        assert_same(&depth, &[2.0, 0.25, NAN, NAN, NAN, NAN, NAN]);
        assert_eq!(invalid, 5);
    }

    #[test]
    fn scale_and_shift_come_before_the_encoding() {
        let output = OutputScale::new(2.0, -1.0).unwrap();
        for (encoding, expected) in [
            (DepthEncoding::Metric, [3.0, NAN]),
            (DepthEncoding::Inverse, [NAN, NAN]),
            (DepthEncoding::Log, [NAN, NAN]),
            (DepthEncoding::Relative, [3.0, -1.0]),
            (DepthEncoding::RelativeInverse, [1.0 / 3.0, NAN]),
            (DepthEncoding::MinMax, [1.0, 0.0]),
        ] {
            let mut values = [2.0, 0.0];
            encoding.decode(&mut values, output, range(), 1.0);
            assert_same(&values, &expected);
        }
        let mut monodepth2 = [0.019_019_02, 0.191_191_2];
        let output = OutputScale::new(9.99, 0.01).unwrap();
        DepthEncoding::Inverse.decode(&mut monodepth2, output, range(), 1.0);
        assert!(
            (monodepth2[0] - 5.0).abs() < 1e-3 && (monodepth2[1] - 0.52083).abs() < 1e-3,
            "{monodepth2:?}"
        );
    }

    #[test]
    fn a_scale_of_zero_or_without_a_number_is_refused() {
        for (scale, shift) in [(0.0, 1.0), (NAN, 0.0), (1.0, f32::INFINITY)] {
            assert!(OutputScale::new(scale, shift).is_err(), "{scale} {shift}");
        }
    }

    #[test]
    fn the_range_is_checked_before_the_focal_factor() {
        let (depth, invalid) = decode(DepthEncoding::Metric, &[0.5, 8.0, 0.25], 2.0);
        assert_same(&depth, &[1.0, 16.0, NAN]);
        assert_eq!(invalid, 1);
    }

    #[test]
    fn zero_is_nan_even_if_the_range_begins_there() {
        let mut values = [0.0, -0.0, 0.001];
        let invalid = DepthEncoding::Metric.decode(
            &mut values,
            OutputScale::IDENTITY,
            DepthRange::new(0.0, 1.0).unwrap(),
            1.0,
        );
        assert_same(&values, &[NAN, NAN, 0.001]);
        assert_eq!(invalid, 2);
    }

    #[test]
    fn an_empty_range_is_refused() {
        for (min_m, max_m) in [(1.0, 1.0), (2.0, 1.0), (-1.0, 1.0), (NAN, 1.0), (0.0, f32::INFINITY)] {
            assert!(DepthRange::new(min_m, max_m).is_err(), "{min_m} {max_m}");
        }
    }

    proptest! {
        #[test]
        fn the_count_is_that_of_nan_and_the_rest_is_in_the_range(
            bits in prop::collection::vec(any::<u32>(), 0..100), which in 0usize..3,
        ) {
            let values: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
            let (depth, invalid) = decode(DepthEncoding::ALL[which], &values, 1.0);
            prop_assert_eq!(depth.iter().filter(|z| z.is_nan()).count(), invalid as usize);
            prop_assert!(depth.iter().all(|z| z.is_nan() || (0.5..=10.0).contains(z)));
        }
    }
}
