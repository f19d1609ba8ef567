//! The ROS 2 messages that are read and written, with the fields of their `.msg` files in the same order.
//! Messages that ROS 2 and Foxglove both have begin with the name of one of them.

use std::borrow::Cow;

use nunet_types::SensorRegion;
use serde::{Deserialize, Serialize};
use serde_bytes::Bytes;

use crate::text;

/// `builtin_interfaces/msg/Time`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Time {
    /// Seconds since 1970.
    pub sec: i32,
    /// Nanoseconds within the second.
    pub nanosec: u32,
}

impl Time {
    const NANOS_PER_SEC: i64 = 1_000_000_000;

    /// Nanoseconds since 1970.
    #[must_use]
    pub fn unix_nanos(self) -> i64 {
        i64::from(self.sec) * Self::NANOS_PER_SEC + i64::from(self.nanosec)
    }

    /// The stamp of a time; ROS 2 cannot state one before 1901 or after 2038.
    #[must_use]
    pub fn from_unix_nanos(nanos: i64) -> Self {
        let sec = nanos.div_euclid(Self::NANOS_PER_SEC);
        let nanosec = nanos.rem_euclid(Self::NANOS_PER_SEC) as u32;
        match i32::try_from(sec) {
            Ok(sec) => Self { sec, nanosec },
            Err(_) if sec > 0 => Self { sec: i32::MAX, nanosec },
            Err(_) => Self { sec: i32::MIN, nanosec },
        }
    }
}

/// `std_msgs/msg/Header`
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header<'a> {
    /// Time of capture.
    pub stamp: Time,
    /// The coordinate frame.
    #[serde(borrow, deserialize_with = "text::read")]
    pub frame_id: Cow<'a, str>,
}

/// `sensor_msgs/msg/Image`
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct RosImage<'a> {
    #[serde(borrow)]
    pub(crate) header: Header<'a>,
    pub(crate) height: u32,
    pub(crate) width: u32,
    #[serde(borrow, deserialize_with = "text::read")]
    pub(crate) encoding: Cow<'a, str>,
    pub(crate) is_bigendian: u8,
    pub(crate) step: u32,
    #[serde(borrow)]
    pub(crate) data: &'a Bytes,
}

/// `sensor_msgs/msg/CompressedImage`
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct RosCompressedImage<'a> {
    #[serde(borrow)]
    pub(crate) header: Header<'a>,
    #[serde(borrow, deserialize_with = "text::read")]
    pub(crate) format: Cow<'a, str>,
    #[serde(borrow)]
    pub(crate) data: &'a Bytes,
}

/// `sensor_msgs/msg/RegionOfInterest`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(crate) struct RegionOfInterest {
    pub(crate) x_offset: u32,
    pub(crate) y_offset: u32,
    pub(crate) height: u32,
    pub(crate) width: u32,
    pub(crate) do_rectify: bool,
}

/// `sensor_msgs/msg/CameraInfo`
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct RosCameraInfo<'a> {
    #[serde(borrow)]
    pub(crate) header: Header<'a>,
    pub(crate) height: u32,
    pub(crate) width: u32,
    #[serde(borrow, deserialize_with = "text::read")]
    pub(crate) distortion_model: Cow<'a, str>,
    pub(crate) d: Vec<f64>,
    pub(crate) k: [f64; 9],
    pub(crate) r: [f64; 9],
    pub(crate) p: [f64; 12],
    pub(crate) binning_x: u32,
    pub(crate) binning_y: u32,
    pub(crate) roi: RegionOfInterest,
}

impl RosCameraInfo<'_> {
    /// The part of the sensor that the images show.
    pub(crate) fn region(&self) -> SensorRegion {
        let RegionOfInterest { x_offset, y_offset, width, height, .. } = self.roi;
        let (binning_x, binning_y) = (self.binning_x, self.binning_y);
        SensorRegion { x_offset, y_offset, width, height, binning_x, binning_y }
    }
}

/// `foxglove_msgs/msg/RawImage`; its time and frame have the layout of a header.
#[derive(Debug, PartialEq, Deserialize)]
pub(crate) struct FoxgloveRawImage<'a> {
    #[serde(borrow)]
    pub(crate) header: Header<'a>,
    pub(crate) width: u32,
    pub(crate) height: u32,
    #[serde(borrow, deserialize_with = "text::read")]
    pub(crate) encoding: Cow<'a, str>,
    pub(crate) step: u32,
    #[serde(borrow)]
    pub(crate) data: &'a Bytes,
}

/// `foxglove_msgs/msg/CompressedImage`
#[derive(Debug, PartialEq, Deserialize)]
pub(crate) struct FoxgloveCompressedImage<'a> {
    #[serde(borrow)]
    pub(crate) header: Header<'a>,
    #[serde(borrow)]
    pub(crate) data: &'a Bytes,
    #[serde(borrow, deserialize_with = "text::read")]
    pub(crate) format: Cow<'a, str>,
}

/// `foxglove_msgs/msg/CameraCalibration`
#[derive(Debug, PartialEq, Deserialize)]
pub(crate) struct FoxgloveCameraCalibration<'a> {
    #[serde(borrow)]
    pub(crate) header: Header<'a>,
    pub(crate) width: u32,
    pub(crate) height: u32,
    #[serde(borrow, deserialize_with = "text::read")]
    pub(crate) distortion_model: Cow<'a, str>,
    pub(crate) d: Vec<f64>,
    pub(crate) k: [f64; 9],
    pub(crate) r: [f64; 9],
    pub(crate) p: [f64; 12],
}

/// `sensor_msgs/msg/PointField`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(crate) struct PointField {
    pub(crate) name: &'static str,
    pub(crate) offset: u32,
    pub(crate) datatype: u8,
    pub(crate) count: u32,
}

impl PointField {
    pub(crate) const UINT8: u8 = 2;
    pub(crate) const FLOAT32: u8 = 7;
}

/// `sensor_msgs/msg/PointCloud2`
#[derive(Debug, PartialEq, Serialize)]
pub(crate) struct PointCloud2<'a> {
    pub(crate) header: Header<'a>,
    pub(crate) height: u32,
    pub(crate) width: u32,
    pub(crate) fields: &'a [PointField],
    pub(crate) is_bigendian: bool,
    pub(crate) point_step: u32,
    pub(crate) row_step: u32,
    pub(crate) data: &'a Bytes,
    pub(crate) is_dense: bool,
}

/// `sensor_msgs/msg/LaserScan`
#[derive(Debug, PartialEq, Serialize)]
pub(crate) struct LaserScan<'a> {
    pub(crate) header: Header<'a>,
    pub(crate) angle_min: f32,
    pub(crate) angle_max: f32,
    pub(crate) angle_increment: f32,
    pub(crate) time_increment: f32,
    pub(crate) scan_time: f32,
    pub(crate) range_min: f32,
    pub(crate) range_max: f32,
    pub(crate) ranges: Cow<'a, [f32]>,
    pub(crate) intensities: Cow<'a, [f32]>,
}

/// `sensor_msgs/msg/Imu`
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Imu<'a> {
    #[serde(borrow)]
    pub(crate) header: Header<'a>,
    /// Quaternion x, y, z, w.
    pub(crate) orientation: [f64; 4],
    pub(crate) orientation_covariance: [f64; 9],
    pub(crate) angular_velocity: [f64; 3],
    pub(crate) angular_velocity_covariance: [f64; 9],
    pub(crate) linear_acceleration: [f64; 3],
    pub(crate) linear_acceleration_covariance: [f64; 9],
}

/// `geometry_msgs/msg/TransformStamped`, with its transform's fields in place.
#[derive(Debug, PartialEq, Serialize)]
pub(crate) struct TransformStamped<'a> {
    pub(crate) header: Header<'a>,
    pub(crate) child_frame_id: Cow<'a, str>,
    /// Meters.
    pub(crate) translation: [f64; 3],
    /// Quaternion x, y, z, w.
    pub(crate) rotation: [f64; 4],
}

/// `tf2_msgs/msg/TFMessage`
#[derive(Debug, PartialEq, Serialize)]
pub(crate) struct TfMessage<'a> {
    pub(crate) transforms: Vec<TransformStamped<'a>>,
}

/// A type's name and its definition with those of all nested types, in MCAP's `ros2msg` encoding.
pub(crate) struct Schema {
    pub(crate) name: &'static str,
    pub(crate) text: &'static str,
}

macro_rules! schema {
    ($constant:ident, $name:literal, $file:literal) => {
        pub(crate) const $constant: Schema =
            Schema { name: $name, text: include_str!(concat!("schemas/", $file)) };
    };
}

schema!(IMAGE, "sensor_msgs/msg/Image", "Image.msg");
schema!(COMPRESSED_IMAGE, "sensor_msgs/msg/CompressedImage", "CompressedImage.msg");
schema!(CAMERA_INFO, "sensor_msgs/msg/CameraInfo", "CameraInfo.msg");
schema!(POINT_CLOUD, "sensor_msgs/msg/PointCloud2", "PointCloud2.msg");
schema!(IMU, "sensor_msgs/msg/Imu", "Imu.msg");
schema!(LASER_SCAN, "sensor_msgs/msg/LaserScan", "LaserScan.msg");
schema!(TF_MESSAGE, "tf2_msgs/msg/TFMessage", "TFMessage.msg");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_go_to_nanoseconds_and_back() {
        for nanos in [0, 1, 999_999_999, 1_700_000_000_123_456_789, -1, -1_500_000_000] {
            assert_eq!(Time::from_unix_nanos(nanos).unix_nanos(), nanos);
        }
    }

    #[test]
    fn times_that_ros_cannot_state_are_its_nearest() {
        assert_eq!(Time::from_unix_nanos(i64::MAX).sec, i32::MAX);
        assert_eq!(Time::from_unix_nanos(i64::MIN).sec, i32::MIN);
    }
}
