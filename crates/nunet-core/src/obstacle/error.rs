//! What prevents obstacles from being computed.

use std::borrow::Cow;

use nunet_types::Hint;

use crate::error_kind::ErrorKind;

/// What prevents obstacles from being computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ObstacleError {
    /// A number of the mount that is not finite.
    #[error("mount: {what} is {value}, expected a finite number")]
    MountNotFinite {
        /// The number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A camera that is not on a robot.
    #[error("mount: the camera is {} m from the base, expected at most {max_m}", shown(*distance_m))]
    MountTooFar {
        /// The distance from the origin of the base, meters.
        distance_m: f64,
        /// The largest distance, meters.
        max_m: f64,
    },
    /// An angle of the mount beyond a whole turn.
    #[error("mount: {what} is {}, expected -2π to 2π", shown(*value))]
    MountAngle {
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
    /// An option out of range.
    #[error("{option} is {value}, expected {expected}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        expected: Cow<'static, str>,
    },
    /// A buffer of another size than the camera's image.
    #[error("the {buffer} map has {got} pixels, expected {expected} for a camera of {width}x{height}")]
    Size {
        /// The buffer.
        buffer: &'static str,
        /// Pixels given.
        got: usize,
        /// Pixels needed.
        expected: usize,
        /// Width of the camera's image, pixels.
        width: u32,
        /// Height of the camera's image, pixels.
        height: u32,
    },
}

/// A number without a long row of zeros: 1e300, not 301 digits.
fn shown(value: f64) -> String {
    let is_plain = value == 0.0 || (1e-6..1e6).contains(&value.abs());
    if is_plain { value.to_string() } else { format!("{value:e}") }
}

impl ObstacleError {
    /// [`ErrorKind::Buffer`] for a wrong size, [`ErrorKind::Argument`] for all others.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Size { .. } => ErrorKind::Buffer,
            _ => ErrorKind::Argument,
        }
    }
}

impl Hint for ObstacleError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::MountTooFar { .. } => Some("give the position in meters".into()),
            Self::MountAngle { .. } => Some("give angles in radians: 90 degrees are 1.571".into()),
            Self::CameraBelowFloor { .. } => {
                Some("give z as the camera's height above the floor, in meters".into())
            }
            Self::LooksUp { .. } => {
                Some("give pitch in radians; positive pitch looks down, negative looks up".into())
            }
            _ => None,
        }
    }
}
