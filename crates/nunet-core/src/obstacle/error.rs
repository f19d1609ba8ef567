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
    /// An angle of the mount beyond a whole turn.
    #[error("mount: {what} is {value}, expected -2π to 2π")]
    MountAngle {
        /// The angle.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A camera that is not above the floor.
    #[error("mount: the camera is {height_m} m above the floor, expected more than 0")]
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
