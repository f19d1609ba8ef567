//! The lens of most cameras: radial, tangential, thin prism and tilt distortion.

use nalgebra::{Matrix2, Matrix3, Point2, Vector2};
use nunet_types::DistortionModel;

use super::CameraError;
use super::coefficients::{MAX_COEFFICIENTS, checked};
use super::lens_model::{LensModel, RosModel};
use super::roots::{TOLERANCE, first_sign_change, inverse_of_rising};

/// A point this many focal lengths from the axis is at 89.94 degrees: no lens of this kind sees it.
const MAX_RADIUS: f64 = 1e3;

/// Newton's method doubles the digits with each step; the start is good to a few thousandths.
const MAX_STEPS: usize = 30;

/// A step that does not reduce the error is halved this often, then given up.
const MAX_HALVINGS: usize = 12;

/// Where Newton's method starts for a point beyond what radial distortion alone can reach, as a fraction of
/// `max_radius`. Not at its end, where the derivative is zero.
const START_FRACTION: f64 = 0.9;

/// Brown-Conrady distortion with up to 14 coefficients, in the form and the order of OpenCV.
///
/// A point `(x, y)` at depth 1, `r² = x² + y²`, appears at
///
/// ```text
/// radial = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
/// x' = x radial + 2 p1 x y + p2 (r² + 2 x²) + s1 r² + s2 r⁴
/// y' = y radial + p1 (r² + 2 y²) + 2 p2 x y + s3 r² + s4 r⁴
/// ```
///
/// and, if the sensor is tilted, is then mapped by a homography (`tilt_x`, `tilt_y`, radians).
///
/// Source: D. C. Brown, *Decentering distortion of lenses*, 1966; in this form the documentation of OpenCV's
/// module calib3d, "Detailed Description". ROS calls it `plumb_bob` (5 coefficients) and
/// `rational_polynomial` (8).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrownConrady {
    coefficients: [f64; MAX_COEFFICIENTS],
    /// Beyond it the distorted radius falls again: the formula is not valid there.
    max_radius: f64,
}

impl BrownConrady {
    /// `k1 k2 p1 p2`, then optionally `k3`, `k4 k5 k6`, `s1 s2 s3 s4`, `tilt_x tilt_y`: 4, 5, 8, 12 or 14
    /// numbers.
    ///
    /// # Errors
    /// Another count, a coefficient that is not finite or out of range.
    pub fn new(coefficients: &[f64]) -> Result<Self, CameraError> {
        let name = DistortionModel::BrownConrady.name();
        let coefficients = checked(name, coefficients, Self::COEFFICIENT_NAMES, Self::COUNTS)?;
        Ok(Self { coefficients, max_radius: max_radius(&coefficients) })
    }

    /// `k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tilt_x tilt_y`; those that were not given are 0.
    #[must_use]
    pub fn coefficients(&self) -> &[f64; MAX_COEFFICIENTS] {
        &self.coefficients
    }

    /// The inverse of [`Self::distort_untilted`].
    ///
    /// First the radial part alone is inverted, a function of one variable with an exact range. From there
    /// Newton's method in two variables removes the tangential and prism parts, which are small. A step that
    /// does not reduce the error, or leaves the range, is halved. OpenCV's fixed point iteration was
    /// rejected: it does not converge for a strong barrel distortion.
    fn undistort_untilted(&self, target: Point2<f64>) -> Option<Point2<f64>> {
        let radius = target.coords.norm();
        let start = inverse_of_rising(|r| self.distorted_radius(r), radius, self.max_radius)
            .unwrap_or(START_FRACTION * self.max_radius);
        let mut point = if radius > 0.0 { target * (start / radius) } else { target };
        for _ in 0..MAX_STEPS {
            let (distorted, jacobian) = self.distort_untilted(point);
            let error = target - distorted;
            if error.norm() <= TOLERANCE * (1.0 + radius) {
                return (jacobian.determinant() > 0.0).then_some(point);
            }
            point = self.damped_step(point, jacobian.try_inverse()? * error, target, error.norm())?;
        }
        None
    }

    /// `point` after `step`, halved until the error is smaller than `error` and the point is within
    /// `max_radius`.
    fn damped_step(
        &self,
        point: Point2<f64>,
        mut step: Vector2<f64>,
        target: Point2<f64>,
        error: f64,
    ) -> Option<Point2<f64>> {
        for _ in 0..MAX_HALVINGS {
            let next = point + step;
            let in_range = next.coords.norm() <= self.max_radius;
            if in_range && (target - self.distort_untilted(next).0).norm() < error {
                return Some(next);
            }
            step *= 0.5;
        }
        None
    }

    /// The radius `r` after radial distortion alone, and its derivative.
    fn distorted_radius(&self, r: f64) -> (f64, f64) {
        let (factor, slope) = self.radial(r * r);
        (r * factor, factor + 2.0 * r * r * slope)
    }

    /// The radial factor at `u` = r², and its derivative by `u`.
    fn radial(&self, u: f64) -> (f64, f64) {
        let [k1, k2, _, _, k3, k4, k5, k6, ..] = self.coefficients;
        let (above, below) = (1.0 + u * (k1 + u * (k2 + u * k3)), 1.0 + u * (k4 + u * (k5 + u * k6)));
        let (above_slope, below_slope) =
            (k1 + u * (2.0 * k2 + u * 3.0 * k3), k4 + u * (2.0 * k5 + u * 3.0 * k6));
        let factor = above / below;
        (factor, (above_slope - factor * below_slope) / below)
    }

    /// Radial, tangential and prism distortion of a point, and their Jacobian.
    fn distort_untilted(&self, point: Point2<f64>) -> (Point2<f64>, Matrix2<f64>) {
        let [_, _, p1, p2, _, _, _, _, s1, s2, s3, s4, ..] = self.coefficients;
        let (x, y) = (point.x, point.y);
        let u = x * x + y * y;
        let (factor, slope) = self.radial(u);
        let distorted = Point2::new(
            x * factor + 2.0 * p1 * x * y + p2 * (u + 2.0 * x * x) + u * (s1 + u * s2),
            y * factor + p1 * (u + 2.0 * y * y) + 2.0 * p2 * x * y + u * (s3 + u * s4),
        );
        let (prism_x, prism_y) = (2.0 * (s1 + 2.0 * u * s2), 2.0 * (s3 + 2.0 * u * s4));
        let across = 2.0 * (x * y * slope + p1 * x + p2 * y);
        #[rustfmt::skip]
        let jacobian = Matrix2::new(
            factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + x * prism_x, across + y * prism_x,
            across + x * prism_y, factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + y * prism_y,
        );
        (distorted, jacobian)
    }

    /// The homography of a tilted sensor; `None` without tilt.
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

impl LensModel for BrownConrady {
    const COEFFICIENT_NAMES: &'static [&'static str] =
        &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tilt_x", "tilt_y"];
    const COUNTS: &'static [usize] = &[4, 5, 8, 12, 14];
    const ZEROS_DISTORT: bool = false;
    /// `rational_polynomial` has eight coefficients in ROS's documentation. ROS's tools also pass OpenCV's
    /// shorter and longer models under that name, and a shorter one is the same model with zeros.
    const ROS_MODELS: &'static [RosModel] = &[
        RosModel {
            name: "plumb_bob",
            aliases: &["radtan", "brown_conrady"],
            kalibr: Some("pinhole-radtan"),
            counts: &[4, 5],
            unnamed_counts: &[4, 5],
            written_counts: &[5],
        },
        RosModel {
            name: "rational_polynomial",
            aliases: &[],
            kalibr: None,
            counts: Self::COUNTS,
            unnamed_counts: &[8, 12, 14],
            written_counts: &[8, 12, 14],
        },
    ];

    fn from_coefficients(coefficients: &[f64]) -> Result<Self, CameraError> {
        Self::new(coefficients)
    }

    fn all_coefficients(&self) -> [f64; MAX_COEFFICIENTS] {
        self.coefficients
    }

    fn distort(&self, point: Point2<f64>) -> Option<Point2<f64>> {
        if point.coords.norm() > self.max_radius {
            return None;
        }
        let (untilted, jacobian) = self.distort_untilted(point);
        if jacobian.determinant() <= 0.0 {
            return None;
        }
        match self.tilt() {
            Some(tilt) => apply_homography(&tilt, untilted),
            None => Some(untilted),
        }
    }

    fn undistort(&self, distorted: Point2<f64>) -> Option<Point2<f64>> {
        match self.tilt() {
            Some(tilt) => self.undistort_untilted(apply_homography(&tilt.try_inverse()?, distorted)?),
            None => self.undistort_untilted(distorted),
        }
    }

    /// Radial coefficients do not change. Tangential coefficients (`p2 p1`) and those of the thin prism
    /// (`s1 s3`, `s2 s4`) are vectors of the image plane.
    fn transformed(&self, vector: &dyn Fn([f64; 2]) -> [f64; 2]) -> Result<Self, CameraError> {
        let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tilt_x, tilt_y] = self.coefficients;
        if (tilt_x, tilt_y) != (0.0, 0.0) {
            return Err(CameraError::TiltedSensor);
        }
        let [p2, p1] = vector([p2, p1]);
        let [s1, s3] = vector([s1, s3]);
        let [s2, s4] = vector([s2, s4]);
        Self::new(&[k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, 0.0, 0.0])
    }
}

/// Maps a point by a homography; `None` for a point behind the plane.
fn apply_homography(homography: &Matrix3<f64>, point: Point2<f64>) -> Option<Point2<f64>> {
    let seen = homography * point.to_homogeneous();
    (seen.z > 0.0).then(|| (seen.xy() / seen.z).into())
}

/// The radius up to which the distorted radius rises.
///
/// `r N(r²) / D(r²)` rises while `N D + 2 u (N' D - N D')` is positive (`u = r²`, the quotient rule), and
/// until `D` has a root. Both are polynomials of `u`.
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
