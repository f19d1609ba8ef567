//! The range of factors of depth.

use super::CameraError;

/// The smallest accepted factor of depth. Smaller ones are caused by wrong units.
pub const MIN_SCALE_FACTOR: f32 = 0.05;
/// The largest accepted factor of depth.
pub const MAX_SCALE_FACTOR: f32 = 20.0;

/// Checks a factor of depth, which a calibration gives.
///
/// # Errors
/// A factor that is not finite or out of range.
pub fn check_scale_factor(factor: f64) -> Result<f32, CameraError> {
    // Compared as `f32`: 0.05 as `f64` is less than 0.05 as `f32`.
    let rounded = factor as f32;
    if (MIN_SCALE_FACTOR..=MAX_SCALE_FACTOR).contains(&rounded) {
        Ok(rounded)
    } else {
        Err(CameraError::ScaleFactor { factor, min: MIN_SCALE_FACTOR, max: MAX_SCALE_FACTOR })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_that_no_camera_needs_are_refused() {
        assert_eq!([0.05, 0.83, 20.0].map(check_scale_factor), [Ok(0.05), Ok(0.83), Ok(20.0)]);
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY, 1000.0, 0.001] {
            assert!(check_scale_factor(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_error_has_four_digits_unless_they_would_be_in_range() {
        for (factor, shown) in [
            (129.331_533_561_327_64, "129.3"),
            (0.001, "0.001"),
            (-1.0, "-1"),
            (1000.0, "1000"),
            (20.0001, "20.0001"),
            (f64::NAN, "NaN"),
            (f64::INFINITY, "inf"),
        ] {
            let error = check_scale_factor(factor).unwrap_err().to_string();
            assert!(error.contains(&format!(" {shown},")), "{error}");
        }
    }
}
