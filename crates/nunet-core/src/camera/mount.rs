//! Where the camera is on the robot.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::MountError;

/// The steepest view upward, degrees. Beyond it no ordinary lens sees the floor.
const MAX_ELEVATION_DEG: f64 = 80.0;

/// The farthest camera from the base: no robot is that large, and a larger number is no length in meters.
const MAX_DISTANCE_M: f64 = 1000.0;

/// The camera in the leveled base frame of the robot (REP 103: x forward, y left, z up), whose origin is on
/// the floor.
///
/// # Example: 0.25 m above the floor, 4 degrees up
/// ```
/// use nunet_core::camera::Mount;
///
/// let mount = Mount::new([0.1, 0.0, 0.25], [0.0, -4_f64.to_radians(), 0.0])?;
/// let ahead = mount.to_base([0.0, 0.0, 1.0]); // 1 m along the optical axis
/// assert!((ahead[0] - 1.0976).abs() < 1e-4 && (ahead[2] - 0.3198).abs() < 1e-4);
///
/// let error = Mount::new([0.1, 0.0, -0.25], [0.0; 3]).unwrap_err();
/// assert_eq!(error.to_string(), "mount: the camera is -0.25 m above the floor, expected more than 0");
/// # Ok::<(), nunet_core::camera::MountError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    position_m: Vector3<f64>,
    roll_pitch_yaw_rad: [f64; 3],
    base_from_optical: Rotation3<f64>,
}

impl Mount {
    /// From position `[x, y, z]`, meters, and rotation `[roll, pitch, yaw]`, radians about the fixed axes x,
    /// y and z in this order, both of the camera's body frame (x forward). `z` is the height above the floor;
    /// positive pitch looks down.
    ///
    /// # Errors
    /// Numbers that are not finite, a position beyond 1 km, angles beyond a turn, a camera that is not above
    /// the floor, or one that looks up by more than 80 degrees.
    pub fn new(position_m: [f64; 3], roll_pitch_yaw_rad: [f64; 3]) -> Result<Self, MountError> {
        let [x, y, z] = position_m;
        let [roll, pitch, yaw] = roll_pitch_yaw_rad;
        let named = [("x", x), ("y", y), ("z", z), ("roll", roll), ("pitch", pitch), ("yaw", yaw)];
        if let Some((what, value)) = named.into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(MountError::NotFinite { what, value });
        }
        check_pose(position_m, roll_pitch_yaw_rad)?;
        if z <= 0.0 {
            return Err(MountError::CameraBelowFloor { height_m: z });
        }
        #[rustfmt::skip]
        let body_from_optical = Rotation3::from_matrix_unchecked(Matrix3::new(
             0.0,  0.0, 1.0,
            -1.0,  0.0, 0.0,
             0.0, -1.0, 0.0,
        ));
        let base_from_optical = Rotation3::from_euler_angles(roll, pitch, yaw) * body_from_optical;
        let elevation_deg = (base_from_optical * Vector3::z()).z.clamp(-1.0, 1.0).asin().to_degrees();
        if elevation_deg > MAX_ELEVATION_DEG {
            return Err(MountError::LooksUp { elevation_deg, max_deg: MAX_ELEVATION_DEG });
        }
        Ok(Self { position_m: position_m.into(), roll_pitch_yaw_rad, base_from_optical })
    }

    /// The same place with another roll and pitch, as an inertial sensor measures them.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn with_attitude(&self, roll_rad: f64, pitch_rad: f64) -> Result<Self, MountError> {
        Self::new(self.position_m(), [roll_rad, pitch_rad, self.roll_pitch_yaw_rad[2]])
    }

    /// The mount while the base is tilted: the base's roll and pitch, as an inertial sensor measures them,
    /// turn camera and position about the base's origin.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn on_tilted_base(&self, roll_rad: f64, pitch_rad: f64) -> Result<Self, MountError> {
        let [roll, pitch, yaw] = self.roll_pitch_yaw_rad;
        let tilt = Rotation3::from_euler_angles(roll_rad, pitch_rad, 0.0);
        let (roll, pitch, yaw) = (tilt * Rotation3::from_euler_angles(roll, pitch, yaw)).euler_angles();
        Self::new((tilt * self.position_m).into(), [roll, pitch, yaw])
    }

    /// The camera's position, meters.
    #[must_use]
    pub fn position_m(&self) -> [f64; 3] {
        self.position_m.into()
    }

    /// Roll, pitch and yaw, radians.
    #[must_use]
    pub fn roll_pitch_yaw_rad(&self) -> [f64; 3] {
        self.roll_pitch_yaw_rad
    }

    /// The camera's height above the floor, meters.
    #[must_use]
    pub fn height_m(&self) -> f64 {
        self.position_m.z
    }

    /// A point of the camera's optical frame (x right, y down, z forward) in the base frame, meters.
    #[must_use]
    pub fn to_base(&self, optical: [f64; 3]) -> [f64; 3] {
        (self.position_m + self.direction(optical)).into()
    }

    /// A point of the base frame in the camera's optical frame, meters.
    #[must_use]
    pub fn to_optical(&self, base: [f64; 3]) -> [f64; 3] {
        self.base_from_optical.inverse_transform_vector(&(Vector3::from(base) - self.position_m)).into()
    }

    /// A direction of the optical frame in the base frame.
    pub(crate) fn direction(&self, optical: [f64; 3]) -> Vector3<f64> {
        self.base_from_optical * Vector3::from(optical)
    }
}

/// Checks that a camera is at most 1 km from the origin of the base, and that roll, pitch and yaw are within
/// a turn of 2π. Larger angles are degrees.
///
/// # Errors
/// It is farther, a coordinate is NaN, or the first angle that is larger.
pub fn check_pose([x, y, z]: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> Result<(), MountError> {
    let distance_m = x.hypot(y).hypot(z);
    if distance_m.is_nan() || distance_m > MAX_DISTANCE_M {
        return Err(MountError::TooFar { distance_m, max_m: MAX_DISTANCE_M });
    }
    let named = [("roll", roll), ("pitch", pitch), ("yaw", yaw)];
    match named.into_iter().find(|(_, value)| value.abs() > TAU) {
        Some((what, value)) => Err(MountError::Angle { what, value }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn kind(position: [f64; 3], rotation: [f64; 3]) -> MountError {
        Mount::new(position, rotation).unwrap_err()
    }

    #[test]
    fn axes_are_those_of_rep_103() {
        let mount = Mount::new([0.1, 0.2, 0.3], [0.0; 3]).unwrap();
        let near = |found: [f64; 3], expected: [f64; 3]| {
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?} {expected:?}");
        };
        near(mount.to_base([0.0, 0.0, 1.0]), [1.1, 0.2, 0.3]);
        near(mount.to_base([1.0, 0.0, 0.0]), [0.1, -0.8, 0.3]);
        near(mount.to_base([0.0, 1.0, 0.0]), [0.1, 0.2, -0.7]);
        let left = Mount::new([0.0, 0.0, 1.0], [0.0, 0.0, FRAC_PI_2]).unwrap();
        near(left.to_base([0.0, 0.0, 1.0]), [0.0, 1.0, 1.0]);
        let down = Mount::new([0.0, 0.0, 1.0], [0.0, FRAC_PI_2, 0.0]).unwrap();
        near(down.to_base([0.0, 0.0, 1.0]), [0.0, 0.0, 0.0]);
        near(mount.to_optical([1.1, -0.8, -0.7]), [1.0, 1.0, 1.0]);
    }

    #[test]
    fn a_tilted_base_moves_and_turns_the_camera() {
        let level = Mount::new([0.2, 0.0, 0.5], [0.0, 0.1, 0.3]).unwrap();
        let tilt = Rotation3::from_euler_angles(0.05, -0.2, 0.0);
        for (tilted, tilt) in [
            (level.on_tilted_base(0.05, -0.2).unwrap(), tilt),
            (level.on_tilted_base(0.0, 0.0).unwrap(), Rotation3::identity()),
        ] {
            for point in [[0.0; 3], [1.0, -0.5, 2.0]] {
                let expected = tilt * Vector3::from(level.to_base(point));
                let found = Vector3::from(tilted.to_base(point));
                assert!((found - expected).norm() < 1e-9, "{found} {expected}");
            }
        }
        assert!(level.on_tilted_base(0.0, -0.2).unwrap().height_m() > level.height_m(), "the front rises");
        let upside_down = level.on_tilted_base(3.0, 0.0).unwrap_err();
        assert!(matches!(upside_down, MountError::CameraBelowFloor { .. }), "{upside_down}");
    }

    #[test]
    fn an_error_prints_no_long_row_of_digits() {
        for (position, rotation, expected) in [
            ([0.0, 0.0, 1e300], [0.0; 3], "mount: the camera is 1e300 m from the base"),
            ([0.0, 0.0, 1.0], [0.0, 1e300, 0.0], "mount: pitch is 1e300, expected -2π to 2π"),
            ([0.0, 0.0, -1e-300], [0.0; 3], "mount: the camera is -1e-300 m above the floor"),
            ([0.0, 0.0, -0.25], [0.0; 3], "mount: the camera is -0.25 m above the floor"),
            ([0.0, 0.0, -0.249_999_999_999_2], [0.0; 3], "mount: the camera is -0.25 m above the floor"),
        ] {
            let text = kind(position, rotation).to_string();
            assert!(text.starts_with(expected), "{text}");
        }
    }

    #[test]
    fn invalid_mounts_are_refused() {
        assert!(matches!(kind([0.0, 0.0, 0.0], [0.0; 3]), MountError::CameraBelowFloor { .. }));
        assert!(matches!(kind([0.0, 0.0, -1.0], [0.0; 3]), MountError::CameraBelowFloor { .. }));
        assert!(matches!(kind([0.0, 0.0, 1.0], [0.0, -FRAC_PI_2, 0.0]), MountError::LooksUp { .. }));
        // Pitch beyond straight down and upside down: what counts is where the axis points.
        assert!(matches!(kind([0.0, 0.0, 1.0], [PI, FRAC_PI_2 * 3.0, 0.0]), MountError::LooksUp { .. }));
        for degrees in [[15.0, 0.0, 0.0], [0.0, 15.0, 0.0], [0.0, 0.0, 90.0], [0.0, 0.0, -90.0]] {
            let error = kind([0.0, 0.0, 1.0], degrees);
            assert!(matches!(error, MountError::Angle { .. }), "{error}");
        }
        assert!(Mount::new([0.0, 0.0, 1.0], [0.0, 0.0, -TAU]).is_ok(), "a whole turn");
        assert!(Mount::new([600.0, 0.0, 800.0], [0.0; 3]).is_ok(), "1 km");
        for far in [[1001.0, 0.0, 1.0], [0.0, -1e300, 1.0], [0.0, 0.0, 1e308]] {
            assert!(matches!(kind(far, [0.0; 3]), MountError::TooFar { .. }), "{far:?}");
        }
        for index in 0..6 {
            let mut numbers = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
            numbers[index] = f64::NAN;
            let [x, y, z, roll, pitch, yaw] = numbers;
            let error = kind([x, y, z], [roll, pitch, yaw]);
            assert!(matches!(error, MountError::NotFinite { .. }), "{error}");
        }
    }
}
