//! From depth to points: the organised cloud in the camera's optical frame.

use std::num::NonZeroU32;

use crate::camera::RayTable;

/// The label of a point whose class nobody knows.
pub const NO_LABEL: u8 = 255;

/// One point of an organised cloud, 16 bytes as they lie in shared memory.
///
/// Metres in the camera's optical frame (x right, y down, z forward), NaN where there is no depth. The same bytes
/// are a ROS `PointCloud2` with fields x, y, z, rgb (FLOAT32 at 12) and label (UINT8 at 15).
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct CloudPoint {
    /// To the right, metres.
    pub x: f32,
    /// Down, metres.
    pub y: f32,
    /// Forward, metres.
    pub z: f32,
    /// Blue.
    pub b: u8,
    /// Green.
    pub g: u8,
    /// Red.
    pub r: u8,
    /// Class index, [`NO_LABEL`] where there is none.
    pub label: u8,
}

/// Width and height of the cloud of every `stride`-th column and row of a depth map.
#[must_use]
pub fn cloud_size(width: u32, height: u32, stride: NonZeroU32) -> (u32, u32) {
    (width.div_ceil(stride.get()), height.div_ceil(stride.get()))
}

/// Fills `out` with the points of columns and rows 0, `stride`, 2 `stride`, ... of a depth map.
///
/// `depth_m` is `[height][width]` of `rays`' size, metres along the optical axis; `rgb` is `[height][width][3]`;
/// `labels`, where there are any, `[height][width]`; `out` is [`cloud_size`] points, rows from the top. A point
/// without depth, or on a pixel without a ray, keeps its place with NaN coordinates.
///
/// # Errors
/// A buffer whose size is not the one above.
pub fn organised_cloud(
    depth_m: &[f32],
    rays: &RayTable,
    rgb: &[u8],
    labels: Option<&[u8]>,
    stride: NonZeroU32,
    out: &mut [CloudPoint],
) -> Result<(), CloudError> {
    todo!("{depth_m:?} {rays:?} {rgb:?} {labels:?} {stride:?} {out:?}")
}

/// What is wrong with the buffers of a cloud.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CloudError {
    /// A buffer does not fit the camera's picture.
    #[error(
        "the cloud's `{buffer}` holds `{got}` elements; a camera of `{width}x{height}` takes `{expected}`"
    )]
    Size {
        /// Which buffer.
        buffer: &'static str,
        /// Elements given.
        got: usize,
        /// Elements needed.
        expected: usize,
        /// The camera's pixels from left to right.
        width: u32,
        /// The camera's pixels from top to bottom.
        height: u32,
    },
}
