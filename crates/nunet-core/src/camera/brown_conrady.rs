//! The lens of most cameras: rings pulled in or out, and small errors of centring, of parallelism and of tilt.

use nalgebra::{Matrix2, Matrix3, Point2, Vector2};

use super::CameraError;
use super::coefficients::{MAX_COEFFICIENTS, checked};
use super::roots::{TOLERANCE, first_sign_change, inverse_of_rising};

const NAMES: [&str; MAX_COEFFICIENTS] =
    ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tilt_x", "tilt_y"];

/// A ray farther out than this many focal lengths is 89.94 degrees from the axis: no lens of this kind sees it.
const MAX_RADIUS: f64 = 1e3;

/// Newton's method doubles the digits with each step; the start is good to some thousandths.
const MAX_STEPS: usize = 30;

/// A step that does not come nearer is halved this often, then given up.
const MAX_HALVINGS: usize = 12;

/// Where Newton's method starts for a point that the rings alone do not reach, as part of their reach. Not at its end,
/// where the slope is zero.
const START_OF_THE_UNREACHED: f64 = 0.9;

/// Brown-Conrady distortion with up to 14 coefficients, in the form and the order of OpenCV.
///
/// A ray `(x, y)` at depth 1, `r² = x² + y²`, is thrown on
///
/// ```text
/// x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶) + 2 p1 x y + p2 (r² + 2 x²) + s1 r² + s2 r⁴
/// y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶) + p1 (r² + 2 y²) + 2 p2 x y + s3 r² + s4 r⁴
/// ```
///
/// and, where the sensor is tilted, from there through a homography (`tilt_x`, `tilt_y`, radians).
///
/// Source: D. C. Brown, *Decentering distortion of lenses*, 1966; in this form the documentation of OpenCV's module
/// calib3d, "Detailed Description". ROS calls it `plumb_bob` (5 coefficients) and `rational_polynomial` (8).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrownConrady {
    coefficients: [f64; MAX_COEFFICIENTS],
    /// Rays farther out are folded back over nearer ones: the formula means nothing there.
    max_radius: f64,
}

impl BrownConrady {
    /// `k1 k2 p1 p2`, then optionally `k3`, `k4 k5 k6`, `s1 s2 s3 s4`, `tilt_x tilt_y`: 4, 5, 8, 12 or 14 numbers.
    ///
    /// # Errors
    /// Another count, a coefficient that is not finite or beyond any lens.
    pub fn new(coefficients: &[f64]) -> Result<Self, CameraError> {
        let coefficients = checked("brown_conrady", coefficients, &NAMES, &[4, 5, 8, 12, 14])?;
        Ok(Self { coefficients, max_radius: max_radius(&coefficients) })
    }

    /// `k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tilt_x tilt_y`; what was not given is 0.
    #[must_use]
    pub fn coefficients(&self) -> &[f64; MAX_COEFFICIENTS] {
        &self.coefficients
    }

    /// Where the lens throws a ray; `None` for one that it folds back.
    pub(super) fn thrown(&self, ray: Point2<f64>) -> Option<Point2<f64>> {
        if ray.coords.norm() > self.max_radius {
            return None;
        }
        let (bent, slope) = self.bent(ray);
        if slope.determinant() <= 0.0 {
            return None;
        }
        match self.tilt() {
            Some(tilt) => seen_through(&tilt, bent),
            None => Some(bent),
        }
    }

    /// The ray that the lens throws on `seen`; `None` where it throws none.
    pub(super) fn ray(&self, seen: Point2<f64>) -> Option<Point2<f64>> {
        match self.tilt() {
            Some(tilt) => self.unbent(seen_through(&tilt.try_inverse()?, seen)?),
            None => self.unbent(seen),
        }
    }

    /// Newton's method from the answer for the rings alone, which is always found; what remains is small.
    ///
    /// OpenCV's fixed point iteration was rejected: it does not converge where a barrel is strong.
    fn unbent(&self, target: Point2<f64>) -> Option<Point2<f64>> {
        let radius = target.coords.norm();
        let start = inverse_of_rising(|r| self.ring(r), radius, self.max_radius)
            .unwrap_or(START_OF_THE_UNREACHED * self.max_radius);
        let mut ray = if radius > 0.0 { target * (start / radius) } else { target };
        for _ in 0..MAX_STEPS {
            let (bent, slope) = self.bent(ray);
            let error = target - bent;
            if error.norm() <= TOLERANCE * (1.0 + radius) {
                return (slope.determinant() > 0.0).then_some(ray);
            }
            ray = self.nearer(ray, slope.try_inverse()? * error, target, error.norm())?;
        }
        None
    }

    /// The ray after the step, or after as much of it as comes nearer to the target within the lens's range.
    fn nearer(
        &self,
        ray: Point2<f64>,
        mut step: Vector2<f64>,
        target: Point2<f64>,
        error: f64,
    ) -> Option<Point2<f64>> {
        for _ in 0..MAX_HALVINGS {
            let next = ray + step;
            if next.coords.norm() <= self.max_radius && (target - self.bent(next).0).norm() < error {
                return Some(next);
            }
            step *= 0.5;
        }
        None
    }

    /// Where the rings alone throw a ray of radius `r`, and the slope of that.
    fn ring(&self, r: f64) -> (f64, f64) {
        let (factor, slope) = self.radial(r * r);
        (r * factor, factor + 2.0 * r * r * slope)
    }

    /// The factor of a ring of `u` = r², and its slope over `u`.
    fn radial(&self, u: f64) -> (f64, f64) {
        let [k1, k2, _, _, k3, k4, k5, k6, ..] = self.coefficients;
        let (above, below) = (1.0 + u * (k1 + u * (k2 + u * k3)), 1.0 + u * (k4 + u * (k5 + u * k6)));
        let (above_slope, below_slope) =
            (k1 + u * (2.0 * k2 + u * 3.0 * k3), k4 + u * (2.0 * k5 + u * 3.0 * k6));
        let factor = above / below;
        (factor, (above_slope - factor * below_slope) / below)
    }

    /// Everything but the tilt, and the matrix of its slopes.
    fn bent(&self, ray: Point2<f64>) -> (Point2<f64>, Matrix2<f64>) {
        let [_, _, p1, p2, _, _, _, _, s1, s2, s3, s4, ..] = self.coefficients;
        let (x, y) = (ray.x, ray.y);
        let u = x * x + y * y;
        let (factor, slope) = self.radial(u);
        let bent = Point2::new(
            x * factor + 2.0 * p1 * x * y + p2 * (u + 2.0 * x * x) + u * (s1 + u * s2),
            y * factor + p1 * (u + 2.0 * y * y) + 2.0 * p2 * x * y + u * (s3 + u * s4),
        );
        let (prism_x, prism_y) = (2.0 * (s1 + 2.0 * u * s2), 2.0 * (s3 + 2.0 * u * s4));
        let across = 2.0 * (x * y * slope + p1 * x + p2 * y);
        #[rustfmt::skip]
        let slopes = Matrix2::new(
            factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + x * prism_x, across + y * prism_x,
            across + x * prism_y, factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + y * prism_y,
        );
        (bent, slopes)
    }

    /// The homography of a tilted sensor; `None` for one that stands straight.
    fn tilt(&self) -> Option<Matrix3<f64>> {
        let [.., tilt_x, tilt_y] = self.coefficients;
        if tilt_x == 0.0 && tilt_y == 0.0 {
            return None;
        }
        let ((sin_x, cos_x), (sin_y, cos_y)) = (tilt_x.sin_cos(), tilt_y.sin_cos());
        #[rustfmt::skip]
        let about_x = Matrix3::new(
            1.0,  0.0,   0.0,
            0.0,  cos_x, sin_x,
            0.0, -sin_x, cos_x,
        );
        #[rustfmt::skip]
        let about_y = Matrix3::new(
            cos_y, 0.0, -sin_y,
            0.0,   1.0,  0.0,
            sin_y, 0.0,  cos_y,
        );
        let turned = about_y * about_x;
        #[rustfmt::skip]
        let projected = Matrix3::new(
            turned.m33, 0.0,        -turned.m13,
            0.0,        turned.m33, -turned.m23,
            0.0,        0.0,         1.0,
        );
        Some(projected * turned)
    }
}

/// A point of the plane through a homography; `None` where it ends behind the plane.
fn seen_through(homography: &Matrix3<f64>, point: Point2<f64>) -> Option<Point2<f64>> {
    let seen = homography * point.to_homogeneous();
    (seen.z > 0.0).then(|| (seen.xy() / seen.z).into())
}

/// The radius until which rings farther out are thrown farther out.
///
/// `r N(r²) / D(r²)` rises while `N D + 2 u (N' D - N D')` is positive (`u = r²`, the quotient rule), and until `D`
/// has a root. Both are polynomials of `u`.
fn max_radius(coefficients: &[f64; MAX_COEFFICIENTS]) -> f64 {
    let [k1, k2, _, _, k3, k4, k5, k6, ..] = *coefficients;
    let (above, below) = ([1.0, k1, k2, k3], [1.0, k4, k5, k6]);
    let mut slope = [0.0; 7];
    for (i, n) in above.into_iter().enumerate() {
        for (j, d) in below.into_iter().enumerate() {
            slope[i + j] += n * d * (1.0 + 2.0 * (i as f64 - j as f64));
        }
    }
    let end = MAX_RADIUS * MAX_RADIUS;
    first_sign_change(&slope, end).min(first_sign_change(&below, end)).sqrt()
}
