//! What the numbers of a depth map mean.

use crate::vocabulary::vocabulary;

vocabulary! {
    /// The unit of a depth map or a cloud.
    Units as "units" {
        /// The payload is not a distance.
        None = 0 "none",
        /// Meters.
        Metre = 1 "metre",
        /// No unit: larger values are farther.
        Relative = 2 "relative",
    }
}

vocabulary! {
    /// Where the scale of a distance comes from.
    ScaleSource as "scale_source" {
        /// The network's own meters, unchanged.
        Metric = 0 "metric",
        /// The network's meters times the ratio of this camera's focal length to the training camera's.
        FocalScaled = 1 "focal_scaled",
        /// The network's meters, unchanged, because this camera's focal length is unknown.
        AssumedCamera = 2 "assumed_camera",
        /// There is no scale.
        Relative = 3 "relative",
        /// The network's meters times a factor that was measured for this camera.
        Calibrated = 4 "calibrated",
        /// The network's meters times a factor that follows from the floor and the camera's height above it.
        Floor = 5 "floor",
    }
}

vocabulary! {
    /// How much of the network ran for this frame.
    Quality as "quality" {
        /// Every stage.
        Full = 0 "full",
        /// The labels come from an earlier frame.
        ReusedLabels = 1 "reused_labels",
    }
}

impl Default for Quality {
    /// Every stage ran.
    fn default() -> Self {
        Self::Full
    }
}
