//! Why a mount is refused.

use std::borrow::Cow;

use nunet_types::Hint;

use crate::error_kind::ErrorKind;

/// Why a mount is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MountError {
    /// A number that is not finite.
    #[error("mount: {what} is {value}, expected a finite number")]
    NotFinite {
        /// The number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A camera that is not on a robot.
    #[error("mount: the camera is {} m from the base, expected at most {max_m}", shown(*distance_m))]
    TooFar {
        /// The distance from the origin of the base, meters.
        distance_m: f64,
        /// The largest distance, meters.
        max_m: f64,
    },
    /// An angle beyond a whole turn.
    #[error("mount: {what} is {}, expected -2π to 2π", shown(*value))]
    Angle {
        /// The angle.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A camera that is not above the floor.
    #[error("mount: the camera is {} m above the floor, expected more than 0", shown(*height_m))]
    CameraBelowFloor {
        /// The camera's height, meters.
        height_m: f64,
    },
    /// A camera that cannot see the floor whatever its lens.
    #[error("mount: the camera looks {elevation_deg:.0} degrees up, expected at most {max_deg:.0}")]
    LooksUp {
        /// The elevation of the optical axis, degrees.
        elevation_deg: f64,
        /// The largest elevation, degrees.
        max_deg: f64,
    },
}

/// A number without a long row of digits: 1e300, not 301 digits, and -0.25, not -0.24999999999919661.
fn shown(value: f64) -> String {
    let is_plain = value == 0.0 || (1e-6..1e6).contains(&value.abs());
    if is_plain { ((value * 1e6).round() / 1e6).to_string() } else { format!("{value:e}") }
}

impl MountError {
    /// [`ErrorKind::Argument`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Argument
    }
}

impl Hint for MountError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::NotFinite { .. } => None,
            Self::TooFar { .. } => Some("give the position in meters".into()),
            Self::Angle { .. } => Some("give angles in radians: 90 degrees are 1.571".into()),
            Self::CameraBelowFloor { .. } => {
                Some("give z as the camera's height above the floor, in meters".into())
            }
            Self::LooksUp { .. } => {
                Some("give pitch in radians; positive pitch looks down, negative looks up".into())
            }
        }
    }
}
