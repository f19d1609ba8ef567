//! What all lens models ask of their coefficients.

use super::CameraError;

/// Coefficients that a lens model may have: OpenCV's longest, and the room of a message's header.
pub const MAX_COEFFICIENTS: usize = 14;

/// Rational models reach some hundreds; what is beyond this is no lens, and its powers would not be finite.
const MAX_COEFFICIENT: f64 = 1e6;

/// A sensor tilted by 90 degrees (1.571) would be seen from its edge.
const MAX_TILT_RAD: f64 = 1.5;

/// The coefficients with zeros behind them, of a model that takes `counts` of the `names`.
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
