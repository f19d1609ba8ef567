//! Encodes ROS 2 messages for recordings and live topics: CDR with its header of four bytes.
//!
//! Recordings and live outputs use the same code, so that their bytes are equal.

use serde::Serialize;
use serde_bytes::Bytes;

use crate::CameraDescription;
use crate::attitude;
use crate::cdr;
use crate::frame_record::{CloudRecord, EncodedImage};
use crate::messages::{
    CAMERA_INFO, COMPRESSED_IMAGE, IMAGE, IMU, LASER_SCAN, POINT_CLOUD, RosCompressedImage, RosImage, Schema,
    TF_MESSAGE, TfMessage,
};
pub use crate::messages::{Header, Time};
use crate::mount::CameraMount;
use crate::obstacles::ObstacleMapRecord;

/// The content of one message, without its header.
#[derive(Debug, Clone, Copy)]
pub enum RosMessage<'a> {
    /// `sensor_msgs/msg/Image`, rows without padding.
    Image(ImagePixels<'a>),
    /// `sensor_msgs/msg/CompressedImage`
    CompressedImage(EncodedImage<'a>),
    /// `sensor_msgs/msg/CameraInfo`
    CameraInfo(&'a CameraDescription),
    /// `sensor_msgs/msg/PointCloud2`, organized.
    Cloud(CloudRecord<'a>),
    /// `sensor_msgs/msg/PointCloud2` with `height` and `label`.
    ObstaclePoints(&'a ObstacleMapRecord<'a>),
    /// `sensor_msgs/msg/LaserScan`
    Scan(&'a ObstacleMapRecord<'a>),
    /// `sensor_msgs/msg/Imu`: roll and pitch of the frame of the header, radians.
    Attitude([f32; 2]),
    /// `tf2_msgs/msg/TFMessage`: from `base_link` to the frame of the header.
    TfStatic(CameraMount),
}

/// The pixels of an uncompressed image.
#[derive(Debug, Clone, Copy)]
pub struct ImagePixels<'a> {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// One of `sensor_msgs/image_encodings`.
    pub encoding: &'static str,
    /// Bytes of one pixel.
    pub pixel_bytes: u32,
    /// Little-endian, rows from the top.
    pub data: &'a [u8],
}

impl RosMessage<'_> {
    pub(crate) fn schema(&self) -> &'static Schema {
        match self {
            Self::Image(_) => &IMAGE,
            Self::CompressedImage(_) => &COMPRESSED_IMAGE,
            Self::CameraInfo(_) => &CAMERA_INFO,
            Self::Cloud(_) | Self::ObstaclePoints(_) => &POINT_CLOUD,
            Self::Scan(_) => &LASER_SCAN,
            Self::Attitude(_) => &IMU,
            Self::TfStatic(_) => &TF_MESSAGE,
        }
    }

    /// Encodes the message into `out`, which is emptied first.
    ///
    /// # Errors
    /// A text or an array is longer than CDR can state.
    pub fn encode(&self, header: &Header<'_>, out: &mut Vec<u8>) -> Result<(), String> {
        let header = header.clone();
        match *self {
            Self::Image(ImagePixels { width, height, encoding, pixel_bytes, data }) => {
                let (encoding, step) = (encoding.into(), width * pixel_bytes);
                let data = Bytes::new(data);
                encode(&RosImage { header, height, width, encoding, is_bigendian: 0, step, data }, out)
            }
            Self::CompressedImage(EncodedImage { format, data }) => {
                encode(&RosCompressedImage { header, format: format.into(), data: Bytes::new(data) }, out)
            }
            Self::CameraInfo(camera) => encode(&camera.ros_message(header), out),
            Self::Cloud(cloud) => encode(&cloud.message(header), out),
            Self::ObstaclePoints(obstacles) => encode(&obstacles.cloud(header), out),
            Self::Scan(obstacles) => encode(&obstacles.scan(header), out),
            Self::Attitude(roll_pitch_rad) => encode(&attitude::message(roll_pitch_rad, header), out),
            Self::TfStatic(mount) => encode(&TfMessage { transforms: vec![mount.transform(&header)] }, out),
        }
    }
}

/// The definition of a type of messages with all types that it contains (`ros2msg`), as recordings embed it;
/// `None` for types that recordings do not have.
#[must_use]
pub fn definition(type_name: &str) -> Option<&'static str> {
    let all = [&IMAGE, &COMPRESSED_IMAGE, &CAMERA_INFO, &POINT_CLOUD, &LASER_SCAN, &IMU, &TF_MESSAGE];
    all.into_iter().find(|schema| schema.name == type_name).map(|schema| schema.text)
}

/// Encodes any message whose fields are those of its `.msg` file, in their order.
///
/// # Errors
/// A text or an array is longer than CDR can state.
pub fn encode<T: Serialize>(message: &T, out: &mut Vec<u8>) -> Result<(), String> {
    cdr::encode(message, out)
}
