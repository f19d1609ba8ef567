//! Types of messages.

/// A type of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum MessageType {
    /// An image that is not compressed.
    Image,
    /// A JPEG or PNG file.
    CompressedImage,
    /// A calibration.
    CameraInfo,
    /// Points.
    PointCloud2,
    /// Distances in directions.
    LaserScan,
    /// Names of classes.
    LabelInfo,
    /// Transforms.
    TfMessage,
    /// The state of a node.
    DiagnosticArray,
}

impl MessageType {
    /// Such as `sensor_msgs/msg/Image`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Image => "sensor_msgs/msg/Image",
            Self::CompressedImage => "sensor_msgs/msg/CompressedImage",
            Self::CameraInfo => "sensor_msgs/msg/CameraInfo",
            Self::PointCloud2 => "sensor_msgs/msg/PointCloud2",
            Self::LaserScan => "sensor_msgs/msg/LaserScan",
            Self::LabelInfo => "vision_msgs/msg/LabelInfo",
            Self::TfMessage => "tf2_msgs/msg/TFMessage",
            Self::DiagnosticArray => "diagnostic_msgs/msg/DiagnosticArray",
        }
    }

    /// The hash of the type's definition (REP 2016), SHA-256 over the description of all its fields.
    #[must_use]
    pub const fn hash(self) -> &'static str {
        match self {
            Self::Image => "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
            Self::CompressedImage => {
                "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"
            }
            Self::CameraInfo => "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
            Self::PointCloud2 => "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
            Self::LaserScan => "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
            Self::LabelInfo => "RIHS01_3d37df4015cdf660cc851c51897f2acd957e1ca6205ba0a99aebffb9406b0783",
            Self::TfMessage => "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
            Self::DiagnosticArray => {
                "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"
            }
        }
    }
}
