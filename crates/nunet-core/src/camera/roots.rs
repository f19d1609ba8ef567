//! Sign changes of polynomials, and the inverse of a rising function.

use std::iter::once;

/// The highest degree in use: that of the rational model's derivative.
const MAX_DEGREE: usize = 6;

/// An interval of doubles cannot be halved more often.
const MAX_HALVINGS: usize = 200;

/// Newton's method doubles the digits with each step; this many suffice for bisection alone.
const MAX_STEPS: usize = 100;

/// The largest error of an inverse, in focal lengths: about 1e-9 pixels.
pub(super) const TOLERANCE: f64 = 1e-12;

/// The first place between 0 and `end` where a polynomial changes its sign; `end` if it does not.
///
/// `polynomial` has the constant first and at most [`MAX_DEGREE`] + 1 coefficients.
pub(super) fn first_sign_change(polynomial: &[f64], end: f64) -> f64 {
    sign_changes(polynomial, end).iter().next().unwrap_or(end)
}

/// Places in rising order.
struct Places {
    values: [f64; MAX_DEGREE],
    count: usize,
}

impl Places {
    fn iter(&self) -> impl Iterator<Item = f64> {
        self.values.into_iter().take(self.count)
    }
}

/// All places between 0 and `end` where a polynomial changes its sign.
///
/// Between two extrema a polynomial changes its sign at most once, and its extrema are where its derivative
/// changes sign; so this recurses over the derivatives. Unlike a search on a grid it misses no pair of close
/// roots. Nothing is allocated, because a lens is built from every frame header.
fn sign_changes(polynomial: &[f64], end: f64) -> Places {
    let mut found = Places { values: [0.0; MAX_DEGREE], count: 0 };
    if polynomial.len() < 2 {
        return found;
    }
    let mut derivative = [0.0; MAX_DEGREE];
    for (power, coefficient) in polynomial.iter().enumerate().skip(1) {
        derivative[power - 1] = power as f64 * coefficient;
    }
    let extrema = sign_changes(&derivative[..polynomial.len() - 1], end);
    let mut low = 0.0;
    for high in extrema.iter().chain(once(end)) {
        if (value(polynomial, low) < 0.0) != (value(polynomial, high) < 0.0) {
            found.values[found.count] = bisect(polynomial, low, high);
            found.count += 1;
        }
        low = high;
    }
    found
}

/// Horner's scheme.
fn value(polynomial: &[f64], at: f64) -> f64 {
    polynomial.iter().rev().fold(0.0, |sum, coefficient| sum * at + coefficient)
}

fn bisect(polynomial: &[f64], mut low: f64, mut high: f64) -> f64 {
    let negative_at_low = value(polynomial, low) < 0.0;
    for _ in 0..MAX_HALVINGS {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if (value(polynomial, middle) < 0.0) == negative_at_low {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// Where a function that rises from 0 at 0 to `end` has the value `target`; `None` beyond its value at `end`.
///
/// `function` returns value and derivative. Newton's method, with bisection where a step would leave the
/// bracket.
pub(super) fn inverse_of_rising(function: impl Fn(f64) -> (f64, f64), target: f64, end: f64) -> Option<f64> {
    if !(0.0..=function(end).0).contains(&target) {
        return None;
    }
    let (mut low, mut high) = (0.0, end);
    let mut place = target.min(end);
    for _ in 0..MAX_STEPS {
        let (value, slope) = function(place);
        let error = value - target;
        if error.abs() <= TOLERANCE * (1.0 + target) {
            return Some(place);
        }
        if error > 0.0 {
            high = place;
        } else {
            low = place;
        }
        let newton = place - error / slope;
        place = if low < newton && newton < high { newton } else { 0.5 * (low + high) };
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_polynomial_without_a_root_in_the_interval_keeps_its_sign_to_the_end() {
        assert_eq!(first_sign_change(&[1.0, 0.0, 1.0], 10.0), 10.0);
        assert_eq!(first_sign_change(&[1.0, -0.05], 10.0), 10.0);
        assert_eq!(first_sign_change(&[1.0], 10.0), 10.0);
    }

    #[test]
    fn two_close_roots_are_both_found() {
        // (u - 2) (u - 2.000001)
        let first = first_sign_change(&[4.000_002, -4.000_001, 1.0], 1e6);
        assert!((first - 2.0).abs() < 1e-8, "{first}");
    }

    #[test]
    fn a_target_that_is_not_reached_has_no_inverse() {
        let sine = |x: f64| x.sin_cos();
        assert_eq!(inverse_of_rising(sine, 1.001, std::f64::consts::FRAC_PI_2), None);
        assert_eq!(inverse_of_rising(sine, -0.1, std::f64::consts::FRAC_PI_2), None);
        assert_eq!(inverse_of_rising(sine, f64::NAN, std::f64::consts::FRAC_PI_2), None);
    }

    proptest! {
        #[test]
        fn the_first_of_six_known_roots_is_found(mut roots in proptest::array::uniform6(0.1..50.0f64)) {
            roots.sort_by(f64::total_cmp);
            prop_assume!(roots[1] - roots[0] > 0.1);
            let mut polynomial = vec![1.0];
            for root in roots {
                // Times (1 - u / root), so that it is 1 at 0.
                let mut product = vec![0.0; polynomial.len() + 1];
                for (power, coefficient) in polynomial.iter().enumerate() {
                    product[power] += coefficient;
                    product[power + 1] -= coefficient / root;
                }
                polynomial = product;
            }
            let found = first_sign_change(&polynomial, 1e6);
            prop_assert!((found - roots[0]).abs() < 1e-5 * roots[0], "{found} of {roots:?}");
        }

        #[test]
        fn a_rising_function_is_inverted(x in 0.0..1.5f64) {
            let back = inverse_of_rising(|x| x.sin_cos(), x.sin(), std::f64::consts::FRAC_PI_2).unwrap();
            prop_assert!((back - x).abs() < 1e-10);
        }
    }
}
