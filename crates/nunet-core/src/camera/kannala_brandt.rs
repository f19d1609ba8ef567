//! The fisheye model: the distance from the image center is a function of the angle to the axis.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Point2;
use nunet_types::DistortionModel;

use super::CameraError;
use super::coefficients::{MAX_COEFFICIENTS, checked};
use super::lens_model::{LensModel, RosModel};
use super::roots::{first_sign_change, inverse_of_rising};

/// Kannala-Brandt distortion with four coefficients, in the form of OpenCV's fisheye model.
///
/// A point at the angle `θ` to the optical axis appears in the same direction from the center, at the
/// distance
///
/// ```text
/// θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)
/// ```
///
/// Directions at 90 degrees and more have no point at depth 1, so pixels that see them have no ray.
///
/// Source: J. Kannala and S. S. Brandt, *A generic camera model and calibration method for conventional,
/// wide-angle, and fish-eye lenses*, 2006, equation 6, whose first coefficient goes into the focal length; in
/// this form the documentation of OpenCV's `cv::fisheye`. ROS calls it `equidistant`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KannalaBrandt {
    coefficients: [f64; 4],
    /// Radians; beyond it the polynomial falls again, or the direction is behind the camera.
    max_angle: f64,
}

impl KannalaBrandt {
    /// `k1 k2 k3 k4`. Four zeros are an equidistant fisheye, not a pinhole.
    ///
    /// # Errors
    /// Another count, a coefficient that is not finite or out of range.
    pub fn new(coefficients: &[f64]) -> Result<Self, CameraError> {
        let name = DistortionModel::KannalaBrandt.name();
        let [k1, k2, k3, k4, ..] = checked(name, coefficients, Self::COEFFICIENT_NAMES, Self::COUNTS)?;
        let slope = [1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4];
        let max_angle = first_sign_change(&slope, FRAC_PI_2 * FRAC_PI_2).sqrt();
        Ok(Self { coefficients: [k1, k2, k3, k4], max_angle })
    }

    /// `k1 k2 k3 k4`, followed by zeros.
    #[must_use]
    pub fn coefficients(&self) -> [f64; MAX_COEFFICIENTS] {
        let mut all = [0.0; MAX_COEFFICIENTS];
        all[..self.coefficients.len()].copy_from_slice(&self.coefficients);
        all
    }

    /// The distance from the center of a point at `angle` to the axis, and its derivative.
    fn distorted_radius(&self, angle: f64) -> (f64, f64) {
        let [k1, k2, k3, k4] = self.coefficients;
        let u = angle * angle;
        let factor = 1.0 + u * (k1 + u * (k2 + u * (k3 + u * k4)));
        let slope = 1.0 + u * (3.0 * k1 + u * (5.0 * k2 + u * (7.0 * k3 + u * 9.0 * k4)));
        (angle * factor, slope)
    }
}

impl LensModel for KannalaBrandt {
    const COEFFICIENT_NAMES: &'static [&'static str] = &["k1", "k2", "k3", "k4"];
    const COUNTS: &'static [usize] = &[4];
    const ZEROS_DISTORT: bool = true;
    const ROS_MODELS: &'static [RosModel] = &[RosModel {
        name: "equidistant",
        aliases: &["fisheye", "kannala_brandt"],
        kalibr: Some("pinhole-equi"),
        counts: &[4],
        unnamed_counts: &[],
        written_counts: &[4],
    }];

    fn from_coefficients(coefficients: &[f64]) -> Result<Self, CameraError> {
        Self::new(coefficients)
    }

    fn all_coefficients(&self) -> [f64; MAX_COEFFICIENTS] {
        self.coefficients()
    }

    fn distort(&self, point: Point2<f64>) -> Option<Point2<f64>> {
        let radius = point.coords.norm();
        let angle = radius.atan();
        if angle > self.max_angle {
            return None;
        }
        // At the center both are 0.
        Some(if radius > 0.0 { point * (self.distorted_radius(angle).0 / radius) } else { point })
    }

    fn undistort(&self, distorted: Point2<f64>) -> Option<Point2<f64>> {
        let radius = distorted.coords.norm();
        let angle = inverse_of_rising(|angle| self.distorted_radius(angle), radius, self.max_angle)?;
        if angle >= FRAC_PI_2 {
            return None;
        }
        Some(if radius > 0.0 { distorted * (angle.tan() / radius) } else { distorted })
    }

    /// The distortion is the same in all directions.
    fn transformed(&self, _vector: &dyn Fn([f64; 2]) -> [f64; 2]) -> Result<Self, CameraError> {
        Ok(*self)
    }
}
