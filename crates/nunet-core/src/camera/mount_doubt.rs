//! Mounts that are possible, but probably a mistake.

use std::borrow::Cow;
use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt;

use nunet_types::Hint;

/// Angles are often written with few digits: 3.15 for half a turn.
const ROUNDING_RAD: f64 = 0.01;

/// How far an optical frame's angles may be from those of a camera that looks ahead, radians.
const OPTICAL_REACH_RAD: f64 = 0.5;

/// Why the angles of a mount are probably a mistake, although a camera can have them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum MountDoubt {
    /// An angle beyond those that every rotation can be written with: probably degrees.
    Degrees {
        /// The angle.
        what: &'static str,
        /// Its value, radians.
        value: f64,
        /// The largest angle that is needed.
        most: f64,
    },
    /// Roll and yaw near -π/2, as those of the optical frame of a camera that looks ahead.
    OpticalFrame {
        /// Radians.
        roll: f64,
        /// Radians.
        yaw: f64,
    },
}

impl MountDoubt {
    /// The first doubt about `[roll, pitch, yaw]`, radians. A few degrees that are taken as radians are often
    /// beyond what is needed; larger ones are refused by [`Mount::new`](super::Mount::new).
    #[must_use]
    pub fn of([roll, pitch, yaw]: [f64; 3]) -> Option<Self> {
        let named = [("roll", roll, PI), ("pitch", pitch, FRAC_PI_2), ("yaw", yaw, PI)];
        let large = named.into_iter().find(|(_, value, most)| value.abs() > most + ROUNDING_RAD);
        let is_near = |angle: f64, other: f64| (angle - other).abs() < OPTICAL_REACH_RAD;
        match large {
            Some((what, value, most)) => Some(Self::Degrees { what, value, most }),
            None if is_near(roll, -FRAC_PI_2) && is_near(pitch, 0.0) && is_near(yaw, -FRAC_PI_2) => {
                Some(Self::OpticalFrame { roll, yaw })
            }
            None => None,
        }
    }
}

impl fmt::Display for MountDoubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Degrees { what, value, most } => {
                write!(
                    f,
                    "mount: {what} is {value} rad, but -{most:.2} to {most:.2} describes every direction"
                )
            }
            Self::OpticalFrame { roll, yaw } => write!(
                f,
                "mount: roll is {roll} rad and yaw is {yaw} rad, as of a camera's optical frame, but the mount is \
                 that of its body frame (x forward)"
            ),
        }
    }
}

impl Hint for MountDoubt {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::Degrees { .. } => {
                "if the angles are in degrees, convert them to radians: 90 degrees are 1.571".into()
            }
            Self::OpticalFrame { .. } => {
                "give the pose of the body frame, such as `camera_link` in tf2: ahead, its roll and yaw are 0"
                    .into()
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_that_no_rotation_needs_are_probably_degrees() {
        for usual in [[0.0; 3], [3.15, 1.56, -PI], [-PI, -1.58, 3.15], [1.0; 3]] {
            assert_eq!(MountDoubt::of(usual), None, "{usual:?}");
        }
        for (angles, name) in
            [([4.0, 0.0, 0.0], "roll"), ([0.0, -5.0, 0.0], "pitch"), ([0.0, 0.0, 6.0], "yaw")]
        {
            let Some(doubt @ MountDoubt::Degrees { what, .. }) = MountDoubt::of(angles) else {
                panic!("{angles:?}")
            };
            assert_eq!(what, name);
            assert!(doubt.hint().is_some_and(|hint| hint.contains("radians")), "{doubt}");
        }
    }

    #[test]
    fn the_optical_frame_of_a_camera_that_looks_ahead_is_recognized() {
        let quarter = -FRAC_PI_2;
        for optical in [[quarter, 0.0, quarter], [quarter - 0.3, 0.0, quarter], [quarter, 0.1, quarter + 0.4]]
        {
            let doubt = MountDoubt::of(optical).unwrap();
            assert!(matches!(doubt, MountDoubt::OpticalFrame { .. }), "{doubt}");
            assert!(doubt.hint().is_some_and(|hint| hint.contains("camera_link")), "{doubt}");
        }
        // Cameras that look to the right, and those that lie on their side.
        for body in [[0.0, 0.1, quarter], [quarter, 0.0, 0.0], [-quarter, 0.0, quarter], [0.0, 0.0, 0.0]] {
            assert_eq!(MountDoubt::of(body), None, "{body:?}");
        }
    }
}
