//! How a pipeline is built.

use std::num::NonZeroU32;

use crate::camera::Camera;
use crate::filter::FilterOptions;

/// The largest angle of a cloud's rays to the optical axis by default: 85 degrees. Only wide fisheyes reach it. Beyond it
/// a point's position depends mostly on the error of the calibration: at 89.9 degrees a depth of 1 m is 573 m away.
pub const MAX_RAY_ANGLE_RAD: f64 = 85.0 / 180.0 * std::f64::consts::PI;

/// Correction for the focal length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Focal {
    /// Multiply meters by the ratio of this camera's focal length to the training camera's, if both are known.
    #[default]
    Auto,
    /// Take the network's meters unchanged.
    Off,
}

/// How a pipeline is built.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PipelineOptions {
    /// The camera; without one, points and meters are those of an assumed camera
    /// ([`Pipeline::set_camera`](super::Pipeline::set_camera)).
    pub camera: Option<Camera>,
    /// Correction for the focal length.
    pub focal: Focal,
    /// The cloud has each n-th column and row of the depth map.
    pub cloud_stride: NonZeroU32,
    /// Filters of the depth map.
    pub filters: FilterOptions,
    /// Points of the cloud farther from the camera have no coordinates, meters (the network's unit if it has none). `None`
    /// for the model's maximum depth, corrected for the focal length.
    pub max_range_m: Option<f32>,
    /// Points of the cloud at a larger angle to the optical axis have no coordinates, radians.
    pub max_ray_angle_rad: f64,
}

impl Default for PipelineOptions {
    fn default() -> Self {
        Self {
            camera: None,
            focal: Focal::Auto,
            cloud_stride: NonZeroU32::MIN,
            filters: FilterOptions::default(),
            max_range_m: None,
            max_ray_angle_rad: MAX_RAY_ANGLE_RAD,
        }
    }
}
