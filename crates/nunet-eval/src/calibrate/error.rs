//! The errors of a calibration.

use std::borrow::Cow;
use std::path::PathBuf;

use nunet_core::camera::{CalibrationError, CameraError};
use nunet_core::frame::FrameError;
use nunet_core::pipeline::PipelineError;
use nunet_core::scale::ScaleError;
use nunet_source::{SourceError, SourceErrorKind};
use nunet_types::{Hint, ImageSize, PixelRect, counted};

use super::kind::ReferenceKind;
use crate::error::{EvalError, EvalErrorKind};
use crate::far_truth;

/// The largest spread of observations that have one factor.
pub(super) const MAX_SPREAD: f64 = 0.25;
/// The share of observations that must agree.
pub(super) const MIN_AGREEING: f64 = 0.7;

/// Why no factor was found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// Fewer observations than a factor needs.
    #[error("{}, expected at least {needed}", counted(*got, "usable observation"))]
    TooFew {
        /// Usable observations.
        got: usize,
        /// How many are needed.
        needed: usize,
        /// What the network's depth was compared with.
        reference: ReferenceKind,
    },
    /// No single factor explains the observations.
    #[error(
        "the observations contradict each other: {}; {worst}",
        contradiction(*spread, *agreeing, *observations)
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
    /// A point of the image that the network does not see.
    #[error("the point {u},{v} is outside {view}, the part of the image that the network sees")]
    OutsideView {
        /// Column, pixels.
        u: f64,
        /// Row, pixels.
        v: f64,
        /// The part of the image.
        view: PixelRect,
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
    /// An image of a reading that cannot be read.
    #[error("line {line} of `{}`", table.display())]
    ImageOfReading {
        /// The table.
        table: PathBuf,
        /// The first line with this image.
        line: u64,
        /// Why not.
        source: Box<EvalError>,
    },
    /// A calibration file of a camera that is not known.
    #[error("no calibration can be written: the intrinsics are unknown")]
    NoIntrinsics,
    /// A calibration file that the factor cannot be added to.
    #[error("cannot write the calibration `{}`", path.display())]
    Calibration {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: CalibrationError,
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
    /// All true depth of a dataset is too far to be compared.
    #[error("the true depth is {near_m} to {far_m} m, expected some below {cap_m} m")]
    TruthTooFar {
        /// The nearest true depth.
        near_m: f32,
        /// The farthest true depth.
        far_m: f32,
        /// Depth is compared up to here.
        cap_m: f32,
        /// Whether the dataset states meters (floating point), so that no other unit can be stated.
        is_meters: bool,
    },
    /// A factor out of range.
    #[error("the found factor cannot be right: {0}")]
    Factor(CameraError),
    /// The dataset cannot be used.
    #[error(transparent)]
    Dataset(#[from] EvalError),
}

/// Which of the two limits is exceeded.
fn contradiction(spread: f64, agreeing: usize, observations: usize) -> String {
    if spread > MAX_SPREAD {
        format!("their spread is {:.0} %, expected at most {:.0} %", 100.0 * spread, 100.0 * MAX_SPREAD)
    } else {
        format!("{agreeing} of {observations} agree, expected at least {:.0} %", 100.0 * MIN_AGREEING)
    }
}

impl CalibrateError {
    /// What kind of failure it is.
    #[must_use]
    pub fn kind(&self) -> EvalErrorKind {
        match self {
            Self::Outside { .. }
            | Self::OutsideView { .. }
            | Self::Distance { .. }
            | Self::Readings { .. }
            | Self::NoIntrinsics
            | Self::Calibration { .. }
            | Self::Scale(_) => EvalErrorKind::Argument,
            Self::TooFew { .. } | Self::Inconsistent { .. } | Self::TruthTooFar { .. } | Self::Factor(_) => {
                EvalErrorKind::Truth
            }
            Self::Source(error) if error.kind() == SourceErrorKind::Argument => EvalErrorKind::Argument,
            Self::Source(_) | Self::Frame(_) | Self::ImageOfReading { .. } => EvalErrorKind::Image,
            Self::Pipeline(_) => EvalErrorKind::Model,
            Self::Dataset(error) => error.kind(),
        }
    }
}

impl From<CameraError> for CalibrateError {
    /// Not as the cause, whose hint is for a factor that the user passed.
    fn from(error: CameraError) -> Self {
        Self::Factor(error)
    }
}

impl Hint for CalibrateError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::TooFew { got, reference, .. } => reference.hint(*got).into(),
            Self::Inconsistent { .. } => {
                "check the unit (meters), the points and the mount; measure a static scene".into()
            }
            Self::Outside { .. } => {
                "give column and row in pixels of the camera's images; 0,0 is the top left".into()
            }
            Self::OutsideView { .. } => "choose a point in this part, or pad the images (letterbox)".into(),
            Self::Readings { .. } => {
                "write a CSV table with the columns `image` (a JPEG or PNG file, relative to the table), `u`, `v` \
                 (pixels) and `distance` (meters)"
                    .into()
            }
            Self::NoIntrinsics => {
                "give the intrinsics or a calibration, or write no file: the factor is printed then".into()
            }
            // The cause has a hint.
            Self::Calibration { .. } | Self::ImageOfReading { .. } => return None,
            Self::TruthTooFar { far_m, is_meters, .. } => far_truth::hint(*far_m, *is_meters),
            Self::Factor(_) => "check the unit: distances are in meters".into(),
            Self::Distance { .. } => "measure from the camera straight to the point, in meters".into(),
            // Transparent: these are not in the chain of causes themselves.
            Self::Source(error) => return error.hint(),
            Self::Frame(error) => return error.hint(),
            Self::Pipeline(error) => return error.hint(),
            Self::Scale(error) => return error.hint(),
            Self::Dataset(error) => return error.hint(),
        })
    }

    fn is_usage(&self) -> bool {
        self.kind() == EvalErrorKind::Argument
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kind_and_the_hint_are_those_of_the_error_inside() {
        let wrong = || SourceError::bad_arguments("no such topic").with_hint("name a topic");
        for error in [CalibrateError::from(wrong()), EvalError::from(wrong()).into()] {
            assert_eq!(
                (error.kind(), error.hint().as_deref()),
                (EvalErrorKind::Argument, Some("name a topic"))
            );
        }
        let missing = EvalError::NotADataset { path: "none".into(), missing: "rgb" };
        let hint = missing.hint();
        assert!(hint.is_some());
        let error = CalibrateError::from(missing);
        assert_eq!((error.kind(), error.hint()), (EvalErrorKind::Argument, hint));
        let bad = CalibrateError::from(SourceError::bad_frame("cut off"));
        assert_eq!(bad.kind(), EvalErrorKind::Image);
    }

    #[test]
    fn too_few_observations_have_a_hint_for_their_reference() {
        let hint = |reference| {
            let error = CalibrateError::TooFew { got: 0, needed: 3, reference };
            error.hint().unwrap().into_owned()
        };
        for (reference, named) in [
            (ReferenceKind::Point, "point"),
            (ReferenceKind::Floor, "z (meters), roll and pitch (radians) of the mount"),
            (ReferenceKind::Readings, "points"),
            (ReferenceKind::Truth, "true depth greater than 0"),
        ] {
            assert!(hint(reference).contains(named), "{}", hint(reference));
        }
    }

    #[test]
    fn a_factor_out_of_range_has_one_hint() {
        let error = CalibrateError::from(CameraError::ScaleFactor { factor: 500.0, min: 0.05, max: 20.0 });
        assert!(error.hint().is_some() && std::error::Error::source(&error).is_none(), "{error}");
    }
}
