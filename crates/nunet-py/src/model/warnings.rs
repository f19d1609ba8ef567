//! Warnings about depth that relies on assumptions. A model issues each of them once.

use std::sync::atomic::{AtomicBool, Ordering};

use nunet_core::depth::ScaleSource;
use nunet_types::ImageSize;
use pyo3::prelude::*;

use crate::error::warn_with_hint;

/// Aspect ratios that differ by less than this share count as equal: sizes are whole numbers.
const MAX_ASPECT_DIFFERENCE: f64 = 0.01;

/// Which warnings were issued.
pub(super) struct Warnings {
    network_size: ImageSize,
    no_camera: AtomicBool,
    aspect: AtomicBool,
    factor: AtomicBool,
}

impl Warnings {
    pub(super) fn new(network_size: ImageSize) -> Self {
        Self { network_size, no_camera: false.into(), aspect: false.into(), factor: false.into() }
    }

    /// Warns about a missing camera and a stretched image.
    pub(super) fn issue(&self, py: Python<'_>, scale: ScaleSource, image_size: ImageSize) -> PyResult<()> {
        if scale == ScaleSource::AssumedCamera && first(&self.no_camera) {
            warn_with_hint(
                py,
                "no camera was given: depth in meters assumes the focal length of the training camera",
                "pass `camera=nunet_py.Camera(...)` or a calibration, `nunet_py.Camera.from_yaml(path)`",
            )?;
        }
        if is_stretched(image_size, self.network_size) && first(&self.aspect) {
            let network_size = self.network_size;
            warn_with_hint(
                py,
                &format!(
                    "images of {image_size} are stretched to {network_size}: another aspect ratio makes depth less accurate"
                ),
                &format!("crop the images to the aspect ratio of {network_size}"),
            )?;
        }
        Ok(())
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
}

fn first(issued: &AtomicBool) -> bool {
    !issued.swap(true, Ordering::Relaxed)
}

fn is_stretched(image: ImageSize, network: ImageSize) -> bool {
    let aspect = |size: ImageSize| f64::from(size.width) / f64::from(size.height);
    (aspect(image) / aspect(network) - 1.0).abs() > MAX_ASPECT_DIFFERENCE
}
