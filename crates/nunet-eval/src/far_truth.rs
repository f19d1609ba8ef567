//! What to do about true depth that is too far to be compared.

use std::borrow::Cow;

/// The hint for depth that is stated in meters, but too far for them.
pub const NOT_METERS: &str = "convert the depth to meters, which floating-point depth must have (REP 118); if these are \
                              millimeters, store them as integers (16UC1, PNG)";

/// A cap that would include depth up to `far_m` meters. Depth at the cap itself is not compared, so the cap
/// is larger. `None` if `far_m` is farther than any depth camera or lidar of a robot measures: then the unit
/// is wrong.
#[must_use]
pub fn cap_for(far_m: f32) -> Option<f32> {
    const FARTHEST_M: f32 = 300.0;
    (far_m <= FARTHEST_M).then(|| far_m.floor() + 1.0)
}

/// The hint for depth of up to `far_m` meters, which may be stated in meters.
pub(crate) fn hint(far_m: f32, is_meters: bool) -> Cow<'static, str> {
    match cap_for(far_m) {
        Some(cap_m) => format!("compare up to a larger distance: {cap_m} m").into(),
        None if is_meters => NOT_METERS.into(),
        None => "check the unit of the depth images".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distance_that_no_sensor_sees_is_another_unit() {
        assert_eq!((cap_for(42.5), cap_for(4000.0)), (Some(43.0), None));
    }
}
