//! Values that the user writes as a word or as numbers.

use serde::Deserialize;

/// A topic that `--publish` names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Publish {
    /// The depth map; always published.
    Depth,
    /// Class indices.
    Labels,
    /// The confidence of depth, if the model has one.
    Confidence,
    /// The organized point cloud.
    Cloud,
    /// Obstacles around the robot; needs the camera's mount.
    Obstacles,
}

impl Publish {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Depth, Self::Labels, Self::Confidence, Self::Cloud, Self::Obstacles];

    /// Those that are published by default.
    pub const DEFAULT: [Self; 4] = [Self::Depth, Self::Labels, Self::Confidence, Self::Cloud];

    /// As the user writes it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Labels => "labels",
            Self::Confidence => "confidence",
            Self::Cloud => "cloud",
            Self::Obstacles => "obstacles",
        }
    }
}

/// How log lines are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogOptions {
    /// 0: info, 1: debug, 2 and more: trace with a span per frame.
    pub verbose: u8,
    /// Errors only.
    pub quiet: bool,
    /// One JSON object per line.
    pub json: bool,
}
