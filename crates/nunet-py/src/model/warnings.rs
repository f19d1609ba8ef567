//! What a model warns of, once: depth that rests on a guess.

use std::sync::atomic::{AtomicBool, Ordering};

use nunet_core::depth::ScaleSource;
use pyo3::prelude::*;

use crate::error::warn;

/// Aspect ratios that differ by less than this share count as equal: sizes are whole numbers.
const MAX_ASPECT_DIFFERENCE: f64 = 0.01;

/// Which warnings were issued.
pub(super) struct Warnings {
    network_size: (u32, u32),
    no_camera: AtomicBool,
    aspect: AtomicBool,
}

impl Warnings {
    pub(super) fn new(network_size: (u32, u32)) -> Self {
        Self { network_size, no_camera: AtomicBool::new(false), aspect: AtomicBool::new(false) }
    }

    /// Warns of a missing camera, and of an image that is stretched.
    pub(super) fn issue(&self, py: Python<'_>, scale: ScaleSource, image_size: (u32, u32)) -> PyResult<()> {
        if scale == ScaleSource::AssumedCamera && first(&self.no_camera) {
            warn(
                py,
                "no camera was given: depth in meters assumes the focal length of the training camera\n\
                 hint: pass `camera=nunet_py.Camera(...)` or a calibration, `nunet_py.Camera.from_yaml(path)`",
            )?;
        }
        if is_stretched(image_size, self.network_size) && first(&self.aspect) {
            let ((width, height), (image_width, image_height)) = (self.network_size, image_size);
            warn(
                py,
                &format!(
                    "images of {image_width}x{image_height} are stretched to {width}x{height}: another aspect ratio \
                     makes depth less accurate\nhint: crop the images to the aspect ratio of {width}x{height}"
                ),
            )?;
        }
        Ok(())
    }
}

fn first(issued: &AtomicBool) -> bool {
    !issued.swap(true, Ordering::Relaxed)
}

fn is_stretched(image: (u32, u32), network: (u32, u32)) -> bool {
    let aspect = |(width, height): (u32, u32)| f64::from(width) / f64::from(height);
    (aspect(image) / aspect(network) - 1.0).abs() > MAX_ASPECT_DIFFERENCE
}
