//! The topics of a camera.

use std::fmt;

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

/// How messages of a topic are delivered. All are reliable; subscribers that ask for less get less.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Delivery {
    /// Messages that are kept until all subscribers have confirmed them.
    pub depth: u32,
    /// Whether a late subscriber gets the last message (transient local).
    pub is_kept: bool,
}

/// Frames: a few may be on their way at a time.
const FRAMES: Delivery = Delivery { depth: 5, is_kept: false };
const KEPT: Delivery = Delivery { depth: 1, is_kept: true };

impl Topic {
    /// All topics.
    pub const ALL: [Self; 13] = [
        Self::Depth,
        Self::DepthCamera,
        Self::HalfDepth,
        Self::HalfDepthCamera,
        Self::Labels,
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

    /// The full name of the topic of `camera`.
    #[must_use]
    pub fn of_camera(self, camera: &str) -> String {
        let name = self.name();
        if name.starts_with('/') { name.to_owned() } else { format!("/{camera}/{name}") }
    }

    /// The type of its messages, such as `sensor_msgs/msg/Image`.
    #[must_use]
    pub fn type_name(self) -> &'static str {
        match self {
            Self::Depth | Self::HalfDepth | Self::Labels => "sensor_msgs/msg/Image",
            Self::DepthCamera | Self::HalfDepthCamera | Self::ImageCamera => "sensor_msgs/msg/CameraInfo",
            Self::LabelInfo => "vision_msgs/msg/LabelInfo",
            Self::Points | Self::ObstaclePoints => "sensor_msgs/msg/PointCloud2",
            Self::Scan => "sensor_msgs/msg/LaserScan",
            Self::Image => "sensor_msgs/msg/CompressedImage",
            Self::TfStatic => "tf2_msgs/msg/TFMessage",
            Self::Diagnostics => "diagnostic_msgs/msg/DiagnosticArray",
        }
    }

    /// The hash of the type's definition (REP 2016), SHA-256 over the description of all its fields.
    #[must_use]
    pub fn type_hash(self) -> &'static str {
        match self {
            Self::Depth | Self::HalfDepth | Self::Labels => {
                "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
            }
            Self::DepthCamera | Self::HalfDepthCamera | Self::ImageCamera => {
                "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275"
            }
            Self::LabelInfo => "RIHS01_3d37df4015cdf660cc851c51897f2acd957e1ca6205ba0a99aebffb9406b0783",
            Self::Points | Self::ObstaclePoints => {
                "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"
            }
            Self::Scan => "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
            Self::Image => "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
            Self::TfStatic => "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
            Self::Diagnostics => "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
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

    /// What the camera must have; `None` if it always has it.
    pub(crate) fn needs_obstacles(self) -> bool {
        matches!(self, Self::ObstaclePoints | Self::Scan)
    }

    pub(crate) fn needs_labels(self) -> bool {
        matches!(self, Self::Labels | Self::LabelInfo)
    }
}

impl fmt::Display for Topic {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.name())
    }
}
