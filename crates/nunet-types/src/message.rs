//! What a shared-memory message carries.

use crate::pixel_format::PixelFormat;
use crate::vocabulary::vocabulary;

/// The bytes of a coordinate frame's name that fit into the header of a message.
pub const MAX_FRAME_ID: usize = 64;

/// The default coordinate frame of a camera.
#[must_use]
pub fn default_frame_id(camera: &str) -> String {
    format!("{camera}_optical_frame")
}

vocabulary! {
    /// What a service carries; the last part of its name.
    Topic as "topic" {
        /// The camera's image, in the encoding of a pixel format.
        Rgb = 0 "rgb",
        /// The depth map: `[height, width]`, `f32`, NaN where there is no measurement.
        Depth = 1 "depth",
        /// The class of each pixel: `[height, width]`, `u8`.
        Labels = 2 "labels",
        /// The organized point cloud: `[height, width]` points of 16 bytes.
        Cloud = 3 "cloud",
        /// Obstacles around the robot, by direction and as points: one obstacle record.
        Obstacles = 4 "obstacles",
        /// The daemon's counts and latencies: one stats record.
        Stats = 5 "stats",
        /// The confidence of depth: `[height, width]`, `u8`, 255 = certain, 0 where there is no measurement.
        Confidence = 6 "confidence",
        /// The attitude of the robot's base, from an inertial sensor, for the daemon: one attitude record.
        Attitude = 7 "attitude",
    }
}

vocabulary! {
    /// How the bytes of a payload are laid out.
    Encoding as "encoding" {
        /// `[height, width, 3]` bytes: red, green, blue.
        Rgb8 = 0 "rgb8",
        /// `[height, width, 3]` bytes: blue, green, red.
        Bgr8 = 1 "bgr8",
        /// `[height, width]` bytes of brightness.
        Mono8 = 2 "mono8",
        /// `[height, width / 2, 4]` bytes: Y0, U, Y1, V.
        Yuyv = 3 "yuyv",
        /// `[height, width]` bytes of Y, then `[height / 2, width / 2, 2]` of U, V.
        Nv12 = 4 "nv12",
        /// `[height, width]` little-endian `f32`.
        DepthF32 = 5 "depth_f32",
        /// `[height, width]` class indices.
        LabelsU8 = 6 "labels_u8",
        /// `[height, width]` points of 16 bytes.
        Points = 7 "points",
        /// One stats record.
        StatsRecord = 8 "stats_record",
        /// One obstacle record.
        ObstacleRecord = 9 "obstacle_record",
        /// `[height, width]` bytes, 255 = certain.
        ConfidenceU8 = 10 "confidence_u8",
        /// One attitude record.
        AttitudeRecord = 11 "attitude_record",
    }
}

impl Encoding {
    /// The pixel format of an image; `None` for a payload that is not an image.
    #[must_use]
    pub const fn pixel_format(self) -> Option<PixelFormat> {
        match self {
            Self::Rgb8 => Some(PixelFormat::Rgb8),
            Self::Bgr8 => Some(PixelFormat::Bgr8),
            Self::Mono8 => Some(PixelFormat::Mono8),
            Self::Yuyv => Some(PixelFormat::Yuyv),
            Self::Nv12 => Some(PixelFormat::Nv12),
            Self::DepthF32 | Self::LabelsU8 | Self::ConfidenceU8 | Self::Points => None,
            Self::StatsRecord | Self::ObstacleRecord | Self::AttitudeRecord => None,
        }
    }

    /// Bytes of one element of a `[height, width]` result; `None` for an image and a record.
    #[must_use]
    pub const fn element_bytes(self) -> Option<u32> {
        match self {
            Self::DepthF32 => Some(4),
            Self::LabelsU8 | Self::ConfidenceU8 => Some(1),
            Self::Points => Some(16),
            Self::Rgb8 | Self::Bgr8 | Self::Mono8 | Self::Yuyv | Self::Nv12 => None,
            Self::StatsRecord | Self::ObstacleRecord | Self::AttitudeRecord => None,
        }
    }
}

impl From<PixelFormat> for Encoding {
    fn from(format: PixelFormat) -> Self {
        match format {
            PixelFormat::Rgb8 => Self::Rgb8,
            PixelFormat::Bgr8 => Self::Bgr8,
            PixelFormat::Mono8 => Self::Mono8,
            PixelFormat::Yuyv => Self::Yuyv,
            PixelFormat::Nv12 => Self::Nv12,
        }
    }
}

vocabulary! {
    /// The clock that `capture_nanos` was read from.
    Clock as "capture_clock" {
        /// `CLOCK_MONOTONIC` of this machine.
        Monotonic = 0 "monotonic",
        /// Nanoseconds since 1970-01-01 UTC.
        Unix = 1 "unix",
        /// The position in a recording.
        Media = 2 "media",
    }
}

vocabulary! {
    /// The id of an event on `nunet/CAMERA/wake`.
    Wake as "wake" {
        /// The camera published an image (`rgb`).
        Image = 0 "image",
        /// The daemon published a frame: `depth` and everything that belongs to it.
        Depth = 1 "depth",
        /// A publisher started. Sent by iceoryx2 itself.
        PublisherStarted = 2 "publisher_started",
        /// A publisher closed normally. Sent by iceoryx2 itself.
        PublisherClosed = 3 "publisher_closed",
        /// A dead publisher was found. Sent by iceoryx2 itself when any process cleans up after it.
        PublisherDied = 4 "publisher_died",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_format_and_its_encoding_have_the_same_name_and_number() {
        for &format in PixelFormat::ALL {
            let encoding = Encoding::from(format);
            assert_eq!((encoding.name(), encoding as u32), (format.name(), format as u32));
            assert_eq!(encoding.pixel_format(), Some(format));
        }
        let images = Encoding::ALL.iter().filter_map(|encoding| encoding.pixel_format()).count();
        assert_eq!(images, PixelFormat::ALL.len());
    }

    #[test]
    fn a_payload_is_an_image_or_has_elements_or_is_a_record() {
        for &encoding in Encoding::ALL {
            let kinds = [
                encoding.pixel_format().is_some(),
                encoding.element_bytes().is_some(),
                encoding.name().ends_with("_record"),
            ];
            assert_eq!(kinds.into_iter().filter(|kind| *kind).count(), 1, "{encoding}");
        }
    }
}
