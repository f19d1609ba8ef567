//! Classifies a sample by its height above ground, its distance and its role.

use super::{Ground, ObstacleOptions};
use crate::label_roles::Role;

/// The slope error of a refined ground (0.25 degrees). The expected ground has four times as much.
pub(super) const SLOPE_ERROR: f32 = 0.0044;
/// Samples deeper below the ground than this are missing floor: meters, plus a share of the camera's height.
const DROP_M: f32 = 0.08;
const DROP_SHARE: f32 = 0.08;

/// The class of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SampleKind {
    /// No valid depth, or nothing that counts for the robot.
    Nothing,
    /// Ground that can be driven on.
    Floor,
    /// Part of an obstacle, if its neighbors agree.
    Obstacle,
    /// A window, mirror or screen at the height of the robot.
    Deceptive,
    /// Below the ground.
    Drop,
}

impl SampleKind {
    /// Whether it counts only on a surface.
    #[inline]
    pub(super) fn is_solid(self) -> bool {
        (self == Self::Obstacle) | (self == Self::Deceptive)
    }
}

/// Bounds of heights and distances.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub(super) ground: Ground,
    clearance_m: f32,
    /// By how much the clearance grows per meter of depth.
    slope_error: f32,
    robot_height_m: f32,
    drop_m: f32,
    max_squared: f32,
}

impl Bounds {
    /// For a camera at this height.
    pub(super) fn new(ground: &Ground, options: &ObstacleOptions, camera_height_m: f32) -> Self {
        Self {
            ground: *ground,
            clearance_m: options.clearance_m,
            slope_error: if ground.is_refined { SLOPE_ERROR } else { 4.0 * SLOPE_ERROR },
            robot_height_m: options.robot_height_m,
            drop_m: options.clearance_m.max(DROP_M + DROP_SHARE * camera_height_m),
            max_squared: options.max_range_m * options.max_range_m,
        }
    }

    /// All comparisons with NaN are false, so that a sample without depth shows nothing.
    ///
    /// Later rules override earlier ones, without branches. A `match` would not be vectorized.
    #[inline]
    pub(super) fn kind(&self, height_m: f32, depth_m: f32, range_squared: f32, role: Role) -> SampleKind {
        let error_m = self.slope_error * depth_m;
        let clearance_m = self.clearance_m + error_m;
        let in_reach = range_squared <= self.max_squared;
        let below_top = in_reach & (height_m < self.robot_height_m);
        let is_drop = height_m < -(self.drop_m + error_m);
        let in_way = below_top & (height_m > clearance_m) & (role == Role::Other);
        let is_floor = in_reach & (height_m.abs() <= clearance_m);
        let kind = if is_drop { SampleKind::Drop } else { SampleKind::Nothing };
        let kind = if in_way { SampleKind::Obstacle } else { kind };
        let kind = if is_floor { SampleKind::Floor } else { kind };
        let behind_glass = if below_top { SampleKind::Deceptive } else { SampleKind::Nothing };
        if role == Role::Deceptive { behind_glass } else { kind }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAN: f32 = f32::NAN;

    #[test]
    fn kinds_follow_height_distance_and_role() {
        let bounds = Bounds {
            ground: Ground::EXPECTED,
            clearance_m: 0.05,
            slope_error: 0.01,
            robot_height_m: 1.0,
            drop_m: 0.1,
            max_squared: 25.0,
        };
        use SampleKind::{Deceptive, Drop, Floor, Nothing, Obstacle};
        for (height_m, range_squared, role, expected) in [
            (0.0, 4.0, Role::Other, Floor),
            (0.0, 4.0, Role::Ceiling, Floor),
            (0.0, 26.0, Role::Floor, Nothing),
            (0.06, 4.0, Role::Other, Floor),
            (0.08, 4.0, Role::Other, Obstacle),
            (0.08, 4.0, Role::Floor, Nothing),
            (0.08, 26.0, Role::Other, Nothing),
            (1.1, 4.0, Role::Other, Nothing),
            (-0.1, 4.0, Role::Other, Nothing),
            (-0.2, 4.0, Role::Floor, Drop),
            (-0.2, 90.0, Role::Other, Drop),
            (0.0, 4.0, Role::Deceptive, Deceptive),
            (-0.2, 4.0, Role::Deceptive, Deceptive),
            (1.1, 4.0, Role::Deceptive, Nothing),
            (0.5, 26.0, Role::Deceptive, Nothing),
            (NAN, NAN, Role::Other, Nothing),
            (NAN, NAN, Role::Deceptive, Nothing),
        ] {
            let kind = bounds.kind(height_m, if height_m.is_nan() { NAN } else { 2.0 }, range_squared, role);
            assert_eq!(kind, expected, "{height_m} m, {range_squared} m², {role:?}");
        }
    }
}
