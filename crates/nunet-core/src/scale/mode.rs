//! The source of the factor.

use crate::camera::Mount;

/// The source of the factor.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum ScaleMode {
    /// The calibrated factor, else the ratio of this camera's focal length to the training camera's, else 1.
    #[default]
    Auto,
    /// The network's meters, unchanged.
    Off,
    /// Measured on the floor. Until the first measurement as [`Self::Auto`].
    Floor(Mount),
}
