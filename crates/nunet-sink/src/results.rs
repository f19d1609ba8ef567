//! The results of a frame that outputs receive.

use nunet_core::camera::Camera;
use nunet_core::cloud::CloudPoint;
use nunet_core::depth::Scale;
use nunet_core::obstacle::Obstacles;
use nunet_types::{ImageSize, PixelRect};

/// The results of a frame: slices of shared memory, or of a buffer of the subcommand.
#[derive(Debug, Clone, Copy)]
pub struct Results<'a> {
    /// The unit of depth and its scale; the factor is 0 for depth without a unit.
    pub scale: Scale,
    /// Width and height of depth, labels and confidence, pixels.
    pub size: ImageSize,
    /// `[H, W]`, NaN = no measurement.
    pub depth: &'a [f32],
    /// `[H, W]`, class indices; `None` if they were not computed.
    pub labels: Option<&'a [u8]>,
    /// `[H, W]`, 255 = certain; `None` if nothing needs it or the model has none.
    pub confidence: Option<&'a [u8]>,
    /// Width and height of the cloud, points.
    pub cloud_size: ImageSize,
    /// Organized points; `None` if they were not computed.
    pub cloud: Option<&'a [CloudPoint]>,
    /// The camera at the size of depth, if it is known.
    pub camera: Option<Camera>,
    /// The part of the image that the results cover, pixels of the image.
    pub view: PixelRect,
    /// Obstacles; `None` if they were not computed.
    pub obstacles: Option<&'a Obstacles>,
    /// The coordinate frame of obstacles.
    pub obstacle_frame: &'static str,
    /// Roll and pitch of the robot's base that turned the mount, radians; `None` if it counts as level.
    pub roll_pitch_rad: Option<[f32; 2]>,
}
