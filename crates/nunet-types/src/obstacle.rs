//! Obstacles around a robot, by direction and as points.

use crate::cloud_point::NO_LABEL;
use crate::layout::{FieldType, contract_struct};
use crate::vocabulary::vocabulary;

/// Sectors that a message has room for.
pub const MAX_SECTORS: usize = 360;

/// Obstacle points that a message has room for.
pub const MAX_OBSTACLE_POINTS: usize = 5000;

vocabulary! {
    /// What ends the free space in one direction.
    SectorState as "sector_state" {
        /// Not known: floor not visible, no valid depth, outside the view, glass, mirror or screen. Never
        /// free.
        Unknown = 0 "unknown",
        /// Nothing: the floor is seen and empty up to `range_m`.
        Free = 1 "free",
        /// An obstacle at `range_m`.
        Occupied = 2 "occupied",
        /// The floor ends at `range_m`: stairs, an edge.
        Drop = 3 "drop",
    }
}

contract_struct! {
    /// One direction of the robot, in the leveled base frame: x forward, y left, origin on the floor.
    ///
    /// All zero means unknown.
    ObstacleSector, 32 bytes {
        /// Meters from the base's origin up to which the direction is free; what is there is `state`. Nearer
        /// than `seen_from_m` nothing was seen.
        pub range_m: f32,
        /// Meters to the nearest obstacle, also where `state` is another; NaN if none was seen.
        pub obstacle_m: f32,
        /// Lowest point of the nearest obstacle, meters above ground; NaN without obstacle.
        pub min_height_m: f32,
        /// Highest point of the nearest obstacle, meters above ground; NaN without obstacle.
        pub max_height_m: f32,
        /// Meters to the nearest floor that the camera can see in this direction; NaN if it sees none.
        pub seen_from_m: f32,
        /// Seconds since the obstacle was seen; 0 unless `remembered`.
        pub age_s: f32,
        /// A [`SectorState`].
        pub state: u32,
        /// The class of the nearest obstacle; 255 where there is none.
        pub label: u8,
        /// 1 if the obstacle was seen in an earlier frame and left the image at the bottom, else 0.
        pub remembered: u8,
        /// Zero; room for later fields.
        pub reserved: [u8; 2],
    }
}

impl FieldType for ObstacleSector {
    const KIND: &'static str = "nunet.v1.ObstacleSector";
}

impl ObstacleSector {
    /// A direction without information.
    pub const UNKNOWN: Self = Self {
        range_m: 0.0,
        obstacle_m: f32::NAN,
        min_height_m: f32::NAN,
        max_height_m: f32::NAN,
        seen_from_m: f32::NAN,
        age_s: 0.0,
        state: SectorState::Unknown as u32,
        label: NO_LABEL,
        remembered: 0,
        reserved: [0; 2],
    };

    /// How far a scan of these sectors says that a direction is free: floor that was searched up to
    /// `max_range_m` is seen at least so far, because the farthest cell of floor begins before it.
    #[must_use]
    pub fn scan_range_m(max_range_m: f32) -> f32 {
        0.9 * max_range_m
    }

    /// The sector as a beam of a scan: the distance of its obstacle or drop; infinity if it is free up to
    /// `range_m`, which consumers clear; otherwise NaN. Remembered obstacles are NaN too: a scan cannot say
    /// that they are old.
    #[must_use]
    pub fn beam_m(&self, range_m: f32) -> f32 {
        match self.state() {
            SectorState::Occupied if self.remembered == 0 => self.range_m,
            SectorState::Drop => self.range_m,
            SectorState::Free if self.range_m >= range_m => f32::INFINITY,
            _ => f32::NAN,
        }
    }

    /// The field `state` as a word; a number without a meaning is unknown.
    #[must_use]
    pub fn state(&self) -> SectorState {
        SectorState::try_from(self.state).unwrap_or(SectorState::Unknown)
    }
}

contract_struct! {
    /// A point of an obstacle, in the leveled base frame: x forward, y left, z up, origin on the floor.
    ///
    /// The same bytes are a ROS `PointCloud2` with fields `x y z height` `FLOAT32`, `label` `UINT8` at 16,
    /// `confidence` `UINT8` at 17.
    ObstaclePoint, 20 bytes {
        /// Meters forward.
        pub x: f32,
        /// Meters to the left.
        pub y: f32,
        /// Meters up.
        pub z: f32,
        /// Meters above the ground at this place.
        pub height: f32,
        /// The class; 255 where there is none.
        pub label: u8,
        /// 255 = certain; 255 as well where the network has no confidence.
        pub confidence: u8,
        /// Zero; room for later fields.
        pub reserved: [u8; 2],
    }
}

impl FieldType for ObstaclePoint {
    const KIND: &'static str = "nunet.v1.ObstaclePoint";
}

/// The obstacles of one frame, wherever they are kept, in the leveled base frame: x forward, y left.
#[derive(Debug, Clone, Copy)]
pub struct ObstacleMap<'a> {
    /// Directions, counterclockwise.
    pub sectors: &'a [ObstacleSector],
    /// Points of obstacles.
    pub points: &'a [ObstaclePoint],
    /// The right boundary of the first sector, radians from forward.
    pub angle_min_rad: f32,
    /// The width of a sector, radians.
    pub angle_step_rad: f32,
    /// How far obstacles were searched, meters.
    pub max_range_m: f32,
}

impl ObstacleMap<'_> {
    /// The angle of the middle of sector `index`, radians from forward, counterclockwise.
    #[must_use]
    pub fn angle_rad(&self, index: usize) -> f32 {
        self.angle_min_rad + (index as f32 + 0.5) * self.angle_step_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable as _;

    #[test]
    fn zeros_and_numbers_without_a_meaning_are_unknown() {
        assert_eq!(ObstacleSector::zeroed().state(), SectorState::Unknown);
        let sector = ObstacleSector { state: 99, ..ObstacleSector::UNKNOWN };
        assert_eq!(sector.state(), SectorState::Unknown);
    }
}
