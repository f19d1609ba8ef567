//! The errors of a calibration.

use std::borrow::Cow;
use std::path::PathBuf;

use nunet_core::camera::CameraError;
use nunet_core::frame::FrameError;
use nunet_core::pipeline::PipelineError;
use nunet_core::scale::ScaleError;
use nunet_source::SourceError;
use nunet_types::{Hint, ImageSize};

use crate::error::EvalError;

/// Why no factor was found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// Fewer observations than a factor needs.
    #[error("{got} usable observations, expected at least {needed}")]
    TooFew {
        /// Usable observations.
        got: usize,
        /// How many are needed.
        needed: usize,
    },
    /// No single factor explains the observations.
    #[error(
        "the observations contradict each other: {agreeing} of {observations} agree, spread {:.0} %; {worst}",
        100.0 * spread
    )]
    Inconsistent {
        /// Their spread.
        spread: f64,
        /// How many there are.
        observations: usize,
        /// How many agree.
        agreeing: usize,
        /// Those that are farthest from the median.
        worst: String,
    },
    /// A point outside the image.
    #[error("the point {u},{v} is outside the image of {size}")]
    Outside {
        /// Column, pixels.
        u: f64,
        /// Row, pixels.
        v: f64,
        /// The image.
        size: ImageSize,
    },
    /// A distance that is not positive.
    #[error("the distance {distance} is not a number of meters greater than 0")]
    Distance {
        /// The distance.
        distance: f64,
    },
    /// A table of readings that cannot be used.
    #[error("cannot use the readings `{}`: {reason}", path.display())]
    Readings {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// An image or a camera that cannot be used.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// An image with a damaged layout.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The network failed.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The model does not know floor.
    #[error(transparent)]
    Scale(#[from] ScaleError),
    /// A factor out of range.
    #[error("the found factor cannot be right")]
    Factor(#[from] CameraError),
    /// The dataset cannot be used.
    #[error(transparent)]
    Dataset(#[from] EvalError),
}

impl CalibrateError {
    /// Whether the arguments are at fault.
    #[must_use]
    pub fn is_argument(&self) -> bool {
        matches!(self, Self::Outside { .. } | Self::Distance { .. } | Self::Readings { .. } | Self::Scale(_))
    }
}

impl Hint for CalibrateError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::TooFew { .. } => "give more images, and points that have depth".into(),
            Self::Inconsistent { .. } => {
                "check the unit (meters), the points and the mount; measure a static scene".into()
            }
            Self::Outside { .. } => {
                "give column and row in pixels of the camera's images; 0,0 is the top left".into()
            }
            Self::Readings { .. } => {
                "write a CSV table with the columns `image`, `u`, `v` and `distance`: file, pixels, meters"
                    .into()
            }
            Self::Scale(error) => return error.hint(),
            Self::Pipeline(error) => return error.hint(),
            Self::Factor(_) => "check the unit: distances are in meters".into(),
            _ => return None,
        })
    }
}
