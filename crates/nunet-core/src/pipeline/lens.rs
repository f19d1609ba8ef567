//! The camera at the sizes of the network and of its results, and the rays of the latter.

use crate::camera::{Camera, CameraError, Intrinsics, RayTable};
use crate::filter::DecimationOptions;
use crate::model::ModelDescription;

/// Horizontal field of view of a camera of which nothing is known, not even by the model: that of a common webcam.
const ASSUMED_HFOV_RAD: f64 = std::f64::consts::FRAC_PI_3;

/// The camera, known or assumed.
pub(super) struct Lens {
    /// At the size of depth; `None` where the rays are those of an assumed camera.
    pub(super) known: Option<Camera>,
    /// At the size of depth, known or assumed: the one whose rays these are.
    pub(super) camera: Camera,
    /// The known camera's focal length at the network's width, pixels.
    pub(super) network_fx_px: Option<f64>,
    /// Of every pixel of depth.
    pub(super) rays: RayTable,
}

impl Lens {
    pub(super) fn new(
        camera: Option<Camera>,
        description: &ModelDescription,
        (width, height): (u32, u32),
        decimation: Option<DecimationOptions>,
    ) -> Result<Self, CameraError> {
        let reduced = |camera: Camera| match decimation {
            Some(decimation) => camera.binned(decimation.factor()),
            None => camera,
        };
        let at_network = camera.map(|camera| camera.scaled_to(width, height)).transpose()?;
        let known = at_network.map(reduced);
        let camera = match known {
            Some(camera) => camera,
            None => reduced(assumed_camera(description, width, height)?),
        };
        let network_fx_px = at_network.map(|camera| camera.intrinsics.fx_px);
        Ok(Self { known, camera, network_fx_px, rays: RayTable::new(&camera) })
    }
}

/// The training camera, else one of [`ASSUMED_HFOV_RAD`], looking through the middle of the picture.
fn assumed_camera(description: &ModelDescription, width: u32, height: u32) -> Result<Camera, CameraError> {
    let middle = |side: u32| (f64::from(side) - 1.0) / 2.0;
    let (fx, fy) = description.camera.map_or_else(
        || {
            let fx = f64::from(width) / (2.0 * (ASSUMED_HFOV_RAD / 2.0).tan());
            (fx, fx)
        },
        |camera| {
            let scale = |focal: f64, from: u32, to: u32| focal * f64::from(to) / f64::from(from);
            (scale(camera.fx, camera.width, width), scale(camera.fy, camera.height, height))
        },
    );
    Intrinsics::new(fx, fy, middle(width), middle(height), width, height).map(Camera::pinhole)
}
