//! Checks that all lens models make on their coefficients.

use super::CameraError;

/// The most coefficients of a lens model: OpenCV's longest, and the room in the frame header.
pub const MAX_COEFFICIENTS: usize = 14;

/// Rational models reach some hundreds. Beyond this, powers of a coefficient would overflow.
const MAX_COEFFICIENT: f64 = 1e6;

/// The largest tilt. At 90 degrees (1.571) there is no image.
const MAX_TILT_RAD: f64 = 1.5;

/// Checks the coefficients of a model that has one of `counts` coefficients, called `names`, and fills them
/// up with zeros.
pub(super) fn checked(
    model: &'static str,
    coefficients: &[f64],
    names: &[&'static str],
    counts: &'static [usize],
) -> Result<[f64; MAX_COEFFICIENTS], CameraError> {
    if !counts.contains(&coefficients.len()) {
        return Err(CameraError::CoefficientCount { model, got: coefficients.len(), expected: counts });
    }
    for (&name, &value) in names.iter().zip(coefficients) {
        let limit = if name.starts_with("tilt") { MAX_TILT_RAD } else { MAX_COEFFICIENT };
        if !value.is_finite() || value.abs() > limit {
            return Err(CameraError::Coefficient { name, value, limit });
        }
    }
    let mut all = [0.0; MAX_COEFFICIENTS];
    all[..coefficients.len()].copy_from_slice(coefficients);
    Ok(all)
}
