//! The options of a pipeline.

use std::num::NonZeroU32;

use crate::camera::Camera;
use crate::filter::FilterOptions;
use crate::framing::AspectMode;
use crate::scale::ScaleMode;

/// The largest angle of a cloud's rays to the optical axis by default: 85 degrees. Only wide fisheyes reach
/// it. Beyond it a point's position depends mostly on the error of the calibration: at 89.9 degrees a depth
/// of 1 m is 573 m away.
pub const MAX_RAY_ANGLE_RAD: f64 = 85.0 / 180.0 * std::f64::consts::PI;

/// The options of a pipeline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PipelineOptions {
    /// The camera; without one, points and meters are those of an assumed camera
    /// ([`Pipeline::set_camera`](super::Pipeline::set_camera)).
    pub camera: Option<Camera>,
    /// What is done with images of another aspect ratio than the network's.
    pub aspect: AspectMode,
    /// The source of the factor by which the network's meters are multiplied.
    pub scale: ScaleMode,
    /// The factor that was measured for this camera and model
    /// ([`Pipeline::set_calibrated_factor`](super::Pipeline)).
    pub calibrated_factor: Option<f32>,
    /// The cloud has each n-th column and row of the depth map.
    pub cloud_stride: NonZeroU32,
    /// Filters of the depth map.
    pub filters: FilterOptions,
    /// Points of the cloud farther from the camera have no coordinates, meters (the network's unit if it has
    /// none). `None` for the model's maximum depth times the scale factor.
    pub max_range_m: Option<f32>,
    /// Points of the cloud at a larger angle to the optical axis have no coordinates, radians.
    pub max_ray_angle_rad: f64,
}

impl Default for PipelineOptions {
    fn default() -> Self {
        Self {
            camera: None,
            aspect: AspectMode::default(),
            scale: ScaleMode::Auto,
            calibrated_factor: None,
            cloud_stride: NonZeroU32::MIN,
            filters: FilterOptions::default(),
            max_range_m: None,
            max_ray_angle_rad: MAX_RAY_ANGLE_RAD,
        }
    }
}
