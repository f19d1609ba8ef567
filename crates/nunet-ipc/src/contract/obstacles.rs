//! The payload of the topic `obstacles`.

use bytemuck::Zeroable as _;
use nunet_types::{
    MAX_OBSTACLE_POINTS, MAX_SECTORS, ObstacleMap, ObstaclePoint, ObstacleSector, contract_struct,
};

use super::CONTRACT_VERSION;

/// The name under which other languages know [`ObstacleRecord`].
pub const OBSTACLES_TYPE_NAME: &str = "nunet.v1.ObstacleRecord";

contract_struct! {
    /// The obstacles of one frame, in the leveled base frame: x forward, y left, z up, origin on the floor.
    /// The header's `frame_id` is that of the base.
    ObstacleRecord, 111680 bytes {
        /// [`CONTRACT_VERSION`].
        pub contract_version: u32,
        /// How many of `sectors` are in use.
        pub sector_count: u32,
        /// How many of `points` are in use.
        pub point_count: u32,
        /// 1 if the ground was measured in this frame, 0 if it is the plane that follows from the mount.
        pub ground_refined: u32,
        /// 1 if labels identified floor and glass, 0 if only geometry did.
        pub used_labels: u32,
        /// The right boundary of the first sector, radians, counterclockwise from x; the sectors follow
        /// counterclockwise.
        pub angle_min_rad: f32,
        /// The width of a sector, radians.
        pub angle_step_rad: f32,
        /// Height above the ground that the robot can drive over, meters.
        pub clearance_m: f32,
        /// Height above the ground that the robot can drive under, meters.
        pub robot_height_m: f32,
        /// Obstacles farther from the base are ignored, meters.
        pub max_range_m: f32,
        /// The share of the image that shows floor, 0 to 1.
        pub floor_fraction: f32,
        /// The ground: rise per meter forward.
        pub ground_slope_x: f32,
        /// The ground: rise per meter to the left.
        pub ground_slope_y: f32,
        /// The ground: height at the origin, meters.
        pub ground_height_m: f32,
        /// 1 if the mount was turned by the robot's attitude at the capture time, 0 if the robot counts as
        /// level.
        pub used_attitude: u32,
        /// Zero; room for later fields.
        pub reserved: [u8; 100],
        /// The directions. Unused entries are undefined.
        pub sectors: [ObstacleSector; MAX_SECTORS],
        /// The points of obstacles. Unused entries are undefined.
        pub points: [ObstaclePoint; MAX_OBSTACLE_POINTS],
    }
}

impl Default for ObstacleRecord {
    /// No sectors and no points. The record is large: if memory for it exists already, write to that instead.
    fn default() -> Self {
        Self { contract_version: CONTRACT_VERSION, ..Self::zeroed() }
    }
}

impl ObstacleRecord {
    /// The record that a payload holds; `None` if it is too short.
    #[must_use]
    pub fn of_payload(bytes: &[u8]) -> Option<&Self> {
        bytemuck::try_from_bytes(bytes.get(..size_of::<Self>())?).ok()
    }

    /// The directions in use; a count beyond the array is cut to it.
    #[must_use]
    pub fn sectors(&self) -> &[ObstacleSector] {
        &self.sectors[..(self.sector_count as usize).min(MAX_SECTORS)]
    }

    /// The points in use; a count beyond the array is cut to it.
    #[must_use]
    pub fn points(&self) -> &[ObstaclePoint] {
        &self.points[..(self.point_count as usize).min(MAX_OBSTACLE_POINTS)]
    }

    /// The sectors and points, to draw or send them.
    #[must_use]
    pub fn map(&self) -> ObstacleMap<'_> {
        ObstacleMap {
            sectors: self.sectors(),
            points: self.points(),
            angle_min_rad: self.angle_min_rad,
            angle_step_rad: self.angle_step_rad,
            max_range_m: self.max_range_m,
        }
    }

    /// Sets the directions; those beyond [`MAX_SECTORS`] are dropped.
    pub fn set_sectors(&mut self, sectors: &[ObstacleSector]) {
        self.sector_count = fill(&mut self.sectors, sectors);
    }

    /// Sets the points; those beyond [`MAX_OBSTACLE_POINTS`] are dropped.
    pub fn set_points(&mut self, points: &[ObstaclePoint]) {
        self.point_count = fill(&mut self.points, points);
    }
}

/// Copies as many elements as there is room for.
fn fill<T: Copy>(room: &mut [T], from: &[T]) -> u32 {
    let count = room.len().min(from.len());
    room[..count].copy_from_slice(&from[..count]);
    count as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_beyond_the_arrays_are_cut() {
        let mut record = Box::new(ObstacleRecord::default());
        record.set_sectors(&[ObstacleSector::UNKNOWN; MAX_SECTORS + 1]);
        assert_eq!(record.sectors().len(), MAX_SECTORS);
        record.set_sectors(&[ObstacleSector::UNKNOWN; 2]);
        (record.point_count, record.sectors[1].label) = (u32::MAX, 3);
        assert_eq!((record.points().len(), record.sectors()[1].label), (MAX_OBSTACLE_POINTS, 3));
    }
}
