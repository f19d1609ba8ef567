//! What counts as an obstacle, and how it is reported.

use std::borrow::Cow;

use nunet_types::{MAX_OBSTACLE_POINTS, MAX_SECTORS, shortest};

use super::ObstacleError;

/// What counts as an obstacle, and how it is reported.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObstacleOptions {
    /// Height above the ground that the robot can drive over, meters.
    pub clearance_m: f32,
    /// Height above the ground that the robot can drive under, meters.
    pub robot_height_m: f32,
    /// Obstacles farther from the base's origin are ignored, meters.
    pub max_range_m: f32,
    /// Directions over the camera's field of view, 1 to [`MAX_SECTORS`].
    pub sectors: usize,
    /// Obstacle points at most, 1 to [`MAX_OBSTACLE_POINTS`].
    pub max_points: usize,
    /// The steepest ground, degrees. A steeper one is not ground.
    pub max_slope_deg: f32,
    /// How long an obstacle is remembered that leaves the image at the bottom, seconds; 0 for not at all.
    pub hold_s: f32,
}

impl Default for ObstacleOptions {
    fn default() -> Self {
        Self {
            clearance_m: 0.05,
            robot_height_m: 1.8,
            max_range_m: 5.0,
            sectors: 72,
            max_points: MAX_OBSTACLE_POINTS,
            max_slope_deg: 10.0,
            hold_s: 0.0,
        }
    }
}

impl ObstacleOptions {
    /// Checks all values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), ObstacleError> {
        let Self { clearance_m, robot_height_m, max_range_m, sectors, max_points, max_slope_deg, hold_s } =
            *self;
        let count = |limit: usize| Cow::Owned(format!("1 to {limit}"));
        let checks: [(&str, f64, bool, Cow<'static, str>); 7] = [
            ("clearance", shortest(clearance_m), within(clearance_m, 0.005, 0.5), "0.005 to 0.5 m".into()),
            (
                "robot height",
                shortest(robot_height_m),
                within(robot_height_m, 0.05, 10.0) && robot_height_m > clearance_m,
                "0.05 to 10 m and more than the clearance".into(),
            ),
            ("range", shortest(max_range_m), within(max_range_m, 0.5, 50.0), "0.5 to 50 m".into()),
            ("number of sectors", sectors as f64, (1..=MAX_SECTORS).contains(&sectors), count(MAX_SECTORS)),
            (
                "number of obstacle points",
                max_points as f64,
                (1..=MAX_OBSTACLE_POINTS).contains(&max_points),
                count(MAX_OBSTACLE_POINTS),
            ),
            ("slope", shortest(max_slope_deg), within(max_slope_deg, 0.0, 30.0), "0 to 30 degrees".into()),
            ("hold", shortest(hold_s), within(hold_s, 0.0, 10.0), "0 to 10 s".into()),
        ];
        match checks.into_iter().find(|(_, _, fits, _)| !fits) {
            Some((option, value, _, expected)) => Err(ObstacleError::Option { option, value, expected }),
            None => Ok(()),
        }
    }
}

/// False for NaN.
fn within(value: f32, min: f32, max: f32) -> bool {
    (min..=max).contains(&value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_allowed_and_each_value_is_checked() {
        let fine = ObstacleOptions::default();
        assert_eq!(fine.check(), Ok(()));
        for wrong in [
            ObstacleOptions { clearance_m: -0.1, ..fine },
            ObstacleOptions { clearance_m: f32::NAN, ..fine },
            ObstacleOptions { robot_height_m: 0.05, clearance_m: 0.05, ..fine },
            ObstacleOptions { max_range_m: f32::INFINITY, ..fine },
            ObstacleOptions { sectors: 0, ..fine },
            ObstacleOptions { sectors: MAX_SECTORS + 1, ..fine },
            ObstacleOptions { max_points: 0, ..fine },
            ObstacleOptions { max_points: MAX_OBSTACLE_POINTS + 1, ..fine },
            ObstacleOptions { max_slope_deg: 31.0, ..fine },
            ObstacleOptions { hold_s: -1.0, ..fine },
        ] {
            assert!(matches!(wrong.check(), Err(ObstacleError::Option { .. })), "{wrong:?}");
        }
    }

    #[test]
    fn a_wrong_value_is_shown_as_it_was_written() {
        let fine = ObstacleOptions::default();
        for (wrong, value) in [
            (ObstacleOptions { robot_height_m: 0.05, ..fine }, 0.05),
            (ObstacleOptions { clearance_m: 0.6, ..fine }, 0.6),
            (ObstacleOptions { max_range_m: 0.3, ..fine }, 0.3),
            (ObstacleOptions { max_slope_deg: 30.1, ..fine }, 30.1),
            (ObstacleOptions { hold_s: 10.1, ..fine }, 10.1),
            (ObstacleOptions { sectors: 20_000_001, ..fine }, 20_000_001.0),
        ] {
            let error = wrong.check().unwrap_err();
            assert!(matches!(error, ObstacleError::Option { value: shown, .. } if shown == value), "{error}");
        }
    }
}
