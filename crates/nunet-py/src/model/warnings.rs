//! Warnings about depth that relies on assumptions. A model issues each of them once.

use std::fmt::Display;
use std::sync::atomic::{AtomicBool, Ordering};

use nunet_core::depth::ScaleSource;
use nunet_core::framing::{AspectMismatch, Framing};
use nunet_types::Hint;
use pyo3::prelude::*;

use crate::error::warn_with_hint;
use crate::image::ImageArgument;

/// Which warnings were issued.
#[derive(Default)]
pub(super) struct Warnings {
    no_camera: AtomicBool,
    aspect: AtomicBool,
    factor: AtomicBool,
    measured_aspect: AtomicBool,
    dim: AtomicBool,
}

impl Warnings {
    /// Warns of a missing camera, and of an image that is cropped or stretched.
    pub(super) fn issue(&self, py: Python<'_>, scale: ScaleSource, framing: &Framing) -> PyResult<()> {
        if scale == ScaleSource::AssumedCamera && first(&self.no_camera) {
            warn_with_hint(
                py,
                "no camera was given: depth in meters assumes the focal length of the training camera",
                "pass `camera=nunet_py.Camera(...)` or a calibration, `nunet_py.Camera.from_yaml(path)`",
            )?;
        }
        if let Some(notice) = framing.notice().filter(|_| first(&self.aspect)) {
            warn_with_hint(py, &notice, "pass `Model(..., aspect=\"letterbox\")` to see the whole image")?;
        }
        Ok(())
    }

    /// Warns of a file of 16 bits that uses only the lower ones.
    pub(super) fn issue_of_image(&self, py: Python<'_>, image: &ImageArgument<'_>) -> PyResult<()> {
        let ImageArgument::File(file) = image else { return Ok(()) };
        warn_of(py, file.dim.as_ref(), &self.dim)
    }

    /// Warns about a factor that is ignored because it was measured with another model.
    pub(super) fn issue_of_factor(&self, py: Python<'_>, is_used: bool) -> PyResult<()> {
        if !is_used && first(&self.factor) {
            warn_with_hint(
                py,
                "the camera's scale is ignored: it was measured with another model",
                "run `nunetd calibrate` with this model",
            )?;
        }
        Ok(())
    }

    /// Warns of a factor that was measured with another aspect mode.
    pub(super) fn issue_of_measured_aspect(
        &self,
        py: Python<'_>,
        mismatch: Option<&AspectMismatch>,
    ) -> PyResult<()> {
        warn_of(py, mismatch, &self.measured_aspect)
    }
}

/// Warns with the text and the hint of a notice.
fn warn_of(py: Python<'_>, notice: Option<&(impl Display + Hint)>, issued: &AtomicBool) -> PyResult<()> {
    match notice.filter(|_| first(issued)) {
        Some(notice) => warn_with_hint(py, &notice.to_string(), &notice.hint().unwrap_or_default()),
        None => Ok(()),
    }
}

fn first(issued: &AtomicBool) -> bool {
    !issued.swap(true, Ordering::Relaxed)
}
