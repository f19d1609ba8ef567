//! One point of a cloud.

use crate::layout::contract_struct;

/// The label of a point that has no class.
pub const NO_LABEL: u8 = 255;

contract_struct! {
    /// One point of a cloud, in the camera's optical frame: x right, y down, z forward.
    ///
    /// The same bytes are a ROS `PointCloud2` with fields `x y z` `FLOAT32`, `rgb` `FLOAT32` at 12, `label`
    /// `UINT8` at 15.
    CloudPoint, 16 bytes {
        /// Meters to the right; NaN where depth has no measurement.
        pub x: f32,
        /// Meters down.
        pub y: f32,
        /// Meters forward.
        pub z: f32,
        /// Blue.
        pub b: u8,
        /// Green.
        pub g: u8,
        /// Red.
        pub r: u8,
        /// The class; 255 where there is none.
        pub label: u8,
    }
}

impl CloudPoint {
    /// A point without depth, color and class.
    pub const NONE: Self = Self { x: f32::NAN, y: f32::NAN, z: f32::NAN, b: 0, g: 0, r: 0, label: NO_LABEL };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_of_a_point_are_a_ros_point() {
        let offsets: Vec<_> = CloudPoint::FIELDS.iter().map(|field| (field.name, field.offset)).collect();
        let expected = [("x", 0), ("y", 4), ("z", 8), ("b", 12), ("g", 13), ("r", 14), ("label", 15)];
        assert_eq!(offsets, expected);
        let point = CloudPoint { x: 1.0, r: 7, ..CloudPoint::NONE };
        let bytes: &[u8] = bytemuck::bytes_of(&point);
        assert_eq!((&bytes[..4], &bytes[12..]), (&1.0_f32.to_ne_bytes()[..], &[0, 0, 7, NO_LABEL][..]));
    }
}
