//! The hint of any error of this crate, for front ends that walk a chain of errors.

use std::borrow::Cow;
use std::error::Error;

use nunet_types::Hint;

use crate::camera::{CalibrationError, CameraError, MountError};
use crate::depth::DepthError;
use crate::filter::FilterError;
use crate::frame::FrameError;
use crate::graph::{GraphError, ManifestError, RuntimeError, UnknownProvider, WiringError};
use crate::model::{ModelError, SelfTestMismatch, SidecarError};
use crate::obstacle::ObstacleError;
use crate::pipeline::PipelineError;
use crate::scale::ScaleError;

/// The hint of `error` if it is of this crate's and has one. Does not follow `source`.
///
/// # Example: print an error with its hint
/// ```
/// use nunet_core::camera::IntrinsicsSpec;
///
/// let error = "500,500,320".parse::<IntrinsicsSpec>().unwrap_err();
/// assert_eq!(error.to_string(), "expected 4 intrinsics, got 3: `500,500,320`");
/// assert_eq!(nunet_core::hint_of(&error).unwrap(), "write `fx,fy,cx,cy` or `fx,fy,cx,cy@WxH`");
/// ```
#[must_use]
pub fn hint_of(error: &(dyn Error + 'static)) -> Option<Cow<'static, str>> {
    as_hint(error)?.hint()
}

/// `error` as a [`Hint`] if it is of this crate. Does not follow `source`.
#[must_use]
pub fn as_hint<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a dyn Hint> {
    fn of<'a, E: Hint + Error + 'static>(error: &'a (dyn Error + 'static)) -> Option<&'a dyn Hint> {
        // `thiserror` puts a boxed source into the chain as a box.
        let boxed = || error.downcast_ref::<Box<E>>().map(|error| &**error);
        error.downcast_ref::<E>().or_else(boxed).map(|error| -> &dyn Hint { error })
    }
    let known = [
        of::<FrameError>,
        of::<CameraError>,
        of::<CalibrationError>,
        of::<MountError>,
        of::<DepthError>,
        of::<ModelError>,
        of::<SidecarError>,
        of::<WiringError>,
        of::<ManifestError>,
        of::<RuntimeError>,
        of::<UnknownProvider>,
        of::<GraphError>,
        of::<SelfTestMismatch>,
        of::<FilterError>,
        of::<ObstacleError>,
        of::<ScaleError>,
        of::<PipelineError>,
    ];
    known.iter().find_map(|of| of(error))
}
