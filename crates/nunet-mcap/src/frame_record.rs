//! The recorded data of a frame.

use std::collections::BTreeMap;

use crate::CameraDescription;
use crate::messages::{Header, PointCloud2, PointField};
use crate::mount::CameraMount;
use serde_bytes::Bytes;

/// The cloud's points: 16 bytes, with color and label at the offsets that ROS tools expect.
const POINT_FIELDS: [PointField; 5] = [
    PointField { name: "x", offset: 0, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "y", offset: 4, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "z", offset: 8, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "rgb", offset: 12, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "label", offset: 15, datatype: PointField::UINT8, count: 1 },
];
const POINT_BYTES: u32 = 16;

/// The settings of a recording.
#[derive(Debug, Clone)]
pub struct WriterOptions {
    /// First part of the topics' names.
    pub camera: String,
    /// Coordinate frame of images, depth and cloud: the camera's optical frame.
    pub frame_id: String,
    /// The pose of the camera on the robot.
    pub mount: Option<CameraMount>,
    /// Facts about the recording as a whole: model, provider, and so on.
    pub about: BTreeMap<String, String>,
    /// Overwrite an existing file.
    pub force: bool,
}

/// A JPEG or PNG file in memory.
#[derive(Debug, Clone, Copy)]
pub struct EncodedImage<'a> {
    /// `jpeg` or `png`.
    pub format: &'a str,
    /// The file.
    pub data: &'a [u8],
}

/// The scale of a depth map.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ScaleRecord {
    /// The unit, spelled as in shared memory: `metre`.
    pub units: &'static str,
    /// Where the scale comes from, spelled as in shared memory: `focal_scaled`.
    pub source: &'static str,
    /// Factor by which the network's meters were multiplied; 0 for relative depth.
    pub factor: f32,
    /// Nanoseconds since the factor was measured; 0 for one that does not change.
    pub age_nanos: i64,
}

/// The scale is written again if the factor changed by this share.
const CHANGED_FACTOR: f32 = 0.01;

impl ScaleRecord {
    /// Whether `other` is so similar that it need not be written again.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        let difference = (self.factor - other.factor).abs();
        (self.units, self.source) == (other.units, other.source)
            && difference <= CHANGED_FACTOR * other.factor
    }

    /// As metadata.
    pub(crate) fn entries(&self) -> [(&'static str, String); 4] {
        [
            ("units", self.units.to_owned()),
            ("scale_source", self.source.to_owned()),
            ("scale_factor", self.factor.to_string()),
            ("scale_age_s", (self.age_nanos as f64 / 1e9).to_string()),
        ]
    }
}

/// A depth map, `[height][width]`, NaN = none.
#[derive(Debug, Clone, Copy)]
pub struct DepthRecord<'a> {
    /// The unit and the scale.
    pub scale: ScaleRecord,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Little-endian `f32`, rows from the top.
    pub bytes: &'a [u8],
}

/// An organized cloud: `x y z` as `f32`, then bytes `b g r label`.
#[derive(Debug, Clone, Copy)]
pub struct CloudRecord<'a> {
    /// Points.
    pub width: u32,
    /// Points.
    pub height: u32,
    /// 16 bytes per point, rows from the top.
    pub bytes: &'a [u8],
}

/// All recorded data of a frame.
#[derive(Debug, Clone, Copy)]
pub struct FrameRecord<'a> {
    /// Time of recording, nanoseconds of the recording's clock.
    pub log_nanos: u64,
    /// Time of capture, nanoseconds since 1970.
    pub stamp_nanos: i64,
    /// The image.
    pub image: Option<EncodedImage<'a>>,
    /// Its camera.
    pub camera: Option<&'a CameraDescription>,
    /// Depth.
    pub depth: DepthRecord<'a>,
    /// The camera at the size of depth and labels.
    pub depth_camera: Option<&'a CameraDescription>,
    /// Class indices, of the size of depth.
    pub labels: Option<&'a [u8]>,
    /// The confidence of depth, 255 = certain, of its size.
    pub confidence: Option<&'a [u8]>,
    /// The cloud.
    pub cloud: Option<CloudRecord<'a>>,
}

impl<'a> CloudRecord<'a> {
    pub(crate) fn message<'b>(&'b self, header: Header<'b>) -> PointCloud2<'b> {
        PointCloud2 {
            header,
            height: self.height,
            width: self.width,
            fields: &POINT_FIELDS,
            is_bigendian: false,
            point_step: POINT_BYTES,
            row_step: POINT_BYTES * self.width,
            data: Bytes::new(self.bytes),
            is_dense: false, // NaN where there is no depth
        }
    }
}
