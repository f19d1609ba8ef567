//! Warnings about depth that relies on assumptions. A model issues each of them once.

use std::sync::atomic::{AtomicBool, Ordering};

use nunet_core::depth::ScaleSource;
use nunet_core::framing::{AspectMismatch, Framing};
use nunet_types::Hint as _;
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
        match &file.dim {
            Some(dim) if first(&self.dim) => {
                warn_with_hint(py, &dim.to_string(), &dim.hint().unwrap_or_default())
            }
            _ => Ok(()),
        }
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
        match mismatch.filter(|_| first(&self.measured_aspect)) {
            Some(mismatch) => warn_with_hint(py, &mismatch.to_string(), &mismatch.hint().unwrap_or_default()),
            None => Ok(()),
        }
    }
}

fn first(issued: &AtomicBool) -> bool {
    !issued.swap(true, Ordering::Relaxed)
}
