//! The topics of a camera.

use std::fmt;

use nunet_ros2_link::{Delivery, MessageType};

/// A topic of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// Depth at full size.
    Depth,
    /// Its camera.
    DepthCamera,
    /// Every second pixel of every second row of depth.
    HalfDepth,
    /// Its camera.
    HalfDepthCamera,
    /// Class indices.
    Labels,
    /// The confidence of depth.
    Confidence,
    /// The names of the classes.
    LabelInfo,
    /// The organized cloud.
    Points,
    /// Points of obstacles.
    ObstaclePoints,
    /// The distance of obstacles in each direction.
    Scan,
    /// The image as JPEG or PNG.
    Image,
    /// Its camera.
    ImageCamera,
    /// Where the camera is on the robot.
    TfStatic,
    /// Rates, losses, age, scale.
    Diagnostics,
}

/// Frames: a few may be on their way at a time.
const FRAMES: Delivery = Delivery { depth: 5, is_kept: false };
const KEPT: Delivery = Delivery { depth: 1, is_kept: true };

impl Topic {
    /// All topics.
    pub const ALL: [Self; 14] = [
        Self::Depth,
        Self::DepthCamera,
        Self::HalfDepth,
        Self::HalfDepthCamera,
        Self::Labels,
        Self::Confidence,
        Self::LabelInfo,
        Self::Points,
        Self::ObstaclePoints,
        Self::Scan,
        Self::Image,
        Self::ImageCamera,
        Self::TfStatic,
        Self::Diagnostics,
    ];

    /// Those that fit into ordinary networks.
    pub const DEFAULT: [Self; 4] = [Self::HalfDepth, Self::HalfDepthCamera, Self::ObstaclePoints, Self::Scan];

    /// Those of a recording.
    pub const RECORDED: [Self; 10] = [
        Self::Depth,
        Self::DepthCamera,
        Self::Labels,
        Self::Confidence,
        Self::Points,
        Self::ObstaclePoints,
        Self::Scan,
        Self::Image,
        Self::ImageCamera,
        Self::TfStatic,
    ];

    /// Those that are always there.
    pub const ALWAYS: [Self; 2] = [Self::TfStatic, Self::Diagnostics];

    /// The name below `/CAMERA/`; those with a leading slash belong to all cameras.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth/image_raw",
            Self::DepthCamera => "depth/camera_info",
            Self::HalfDepth => "depth/half/image_raw",
            Self::HalfDepthCamera => "depth/half/camera_info",
            Self::Labels => "labels/image_raw",
            Self::Confidence => "labels/confidence",
            Self::LabelInfo => "labels/label_info",
            Self::Points => "depth/points",
            Self::ObstaclePoints => "obstacles/points",
            Self::Scan => "scan",
            Self::Image => "image_raw/compressed",
            Self::ImageCamera => "camera_info",
            Self::TfStatic => "/tf_static",
            Self::Diagnostics => "/diagnostics",
        }
    }

    /// Whether it is below `/CAMERA/`. The other topics belong to all cameras.
    #[must_use]
    pub fn is_of_one_camera(self) -> bool {
        !self.name().starts_with('/')
    }

    /// The full name of the topic of `camera`.
    #[must_use]
    pub fn of_camera(self, camera: &str) -> String {
        let name = self.name();
        if self.is_of_one_camera() { format!("/{camera}/{name}") } else { name.to_owned() }
    }

    /// The type of its messages.
    #[must_use]
    pub fn message_type(self) -> MessageType {
        match self {
            Self::Depth | Self::HalfDepth | Self::Labels | Self::Confidence => MessageType::Image,
            Self::DepthCamera | Self::HalfDepthCamera | Self::ImageCamera => MessageType::CameraInfo,
            Self::LabelInfo => MessageType::LabelInfo,
            Self::Points | Self::ObstaclePoints => MessageType::PointCloud2,
            Self::Scan => MessageType::LaserScan,
            Self::Image => MessageType::CompressedImage,
            Self::TfStatic => MessageType::TfMessage,
            Self::Diagnostics => MessageType::DiagnosticArray,
        }
    }

    /// How its messages are delivered.
    #[must_use]
    pub fn delivery(self) -> Delivery {
        match self {
            Self::LabelInfo | Self::TfStatic => KEPT,
            _ => FRAMES,
        }
    }

    /// Whether the camera has it only if obstacles are found.
    pub(crate) fn needs_obstacles(self) -> bool {
        matches!(self, Self::ObstaclePoints | Self::Scan)
    }

    /// Whether the camera has it only if the model has a confidence.
    pub(crate) fn needs_confidence(self) -> bool {
        self == Self::Confidence
    }

    /// Whether the camera has it only if the model has labels.
    pub(crate) fn needs_labels(self) -> bool {
        matches!(self, Self::Labels | Self::LabelInfo)
    }
}

impl fmt::Display for Topic {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.name())
    }
}
