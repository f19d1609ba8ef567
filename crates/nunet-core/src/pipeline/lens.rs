//! The camera at the sizes of the network and of its results, and the rays of the latter.

use std::num::NonZeroU32;

use nunet_types::ImageSize;

use super::PipelineOptions;
use crate::camera::{Camera, CameraError, Intrinsics, RayTable};
use crate::cloud::{CloudError, CloudOptions, CloudPoint, organized_cloud};
use crate::filter::Appearance;
use crate::framing::Framing;
use crate::graph::SerialGraph;
use crate::model::{ModelDescription, TrainingCamera};

/// Horizontal field of view of an unknown camera for a model without a training camera: that of a common
/// webcam.
const ASSUMED_HFOV_RAD: f64 = std::f64::consts::FRAC_PI_3;

/// The camera, known or assumed.
pub(super) struct Lens {
    /// At the size of depth; `None` if the camera is assumed.
    pub(super) known: Option<Camera>,
    /// At the size of depth, known or assumed: the camera of the rays.
    pub(super) camera: Camera,
    /// At the size of the network, known or assumed: the camera of the results before decimation.
    pub(super) at_network: Camera,
    /// The known camera's focal length in the network's image, pixels.
    pub(super) network_fx_px: Option<f64>,
    /// The ray of every pixel of depth.
    rays: RayTable,
    cloud_stride: NonZeroU32,
}

impl Lens {
    /// Also sets the graph's inputs that depend on the camera.
    pub(super) fn new(
        options: &PipelineOptions,
        framing: &Framing,
        graph: &mut SerialGraph,
    ) -> Result<Self, CameraError> {
        let known = options.camera.map(|camera| framing.camera_of_results(&camera)).transpose()?;
        let (at_network, of_input) = match (known, &options.camera) {
            (Some(results), Some(camera)) => (results, framing.camera_of_network(camera)?),
            _ => {
                let ImageSize { width, height } = graph.size();
                let assumed = assumed_camera(graph.description(), width, height)?;
                (framing.results_of_network_camera(&assumed)?, assumed)
            }
        };
        graph.set_camera(&of_input.intrinsics);
        let camera = match options.filters.decimation() {
            Some(decimation) => at_network.decimated(decimation.factor()),
            None => at_network,
        };
        Ok(Self {
            known: known.map(|_| camera),
            camera,
            at_network,
            network_fx_px: known.map(|_| of_input.intrinsics.fx_px),
            rays: RayTable::within_angle(&camera, options.max_ray_angle_rad),
            cloud_stride: options.cloud_stride,
        })
    }

    /// Fills a cloud, if one was requested. Points farther than `max_range_m` have no coordinates.
    pub(super) fn fill_cloud(
        &self,
        depth_m: &[f32],
        appearance: &Appearance<'_>,
        max_range_m: f32,
        cloud: Option<&mut [CloudPoint]>,
    ) -> Result<(), CloudError> {
        let Some(points) = cloud else { return Ok(()) };
        let options = CloudOptions { stride: self.cloud_stride, max_range_m };
        organized_cloud(depth_m, &self.rays, appearance, options, points)
    }
}

/// The training camera, else one of [`ASSUMED_HFOV_RAD`], with its principal point in the middle of the
/// image.
fn assumed_camera(description: &ModelDescription, width: u32, height: u32) -> Result<Camera, CameraError> {
    let middle = |side: u32| (f64::from(side) - 1.0) / 2.0;
    let intrinsics = match description.camera {
        // The network's image may be stretched.
        Some(TrainingCamera { width: w, height: h, fx, fy }) => {
            Intrinsics::new(fx, fy, middle(w), middle(h), w, h)?.scaled_to(width, height)?
        }
        None => {
            let focal = f64::from(width) / (2.0 * (ASSUMED_HFOV_RAD / 2.0).tan());
            Intrinsics::new(focal, focal, middle(width), middle(height), width, height)?
        }
    };
    Ok(Camera::pinhole(intrinsics))
}
