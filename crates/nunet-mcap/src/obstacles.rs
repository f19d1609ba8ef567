//! Obstacles as ROS messages.

use std::borrow::Cow;

use nunet_types::layout::bytemuck;
use nunet_types::{ObstacleMap, ObstaclePoint, ObstacleSector};
use serde_bytes::Bytes;

use crate::messages::{Header, LaserScan, PointCloud2, PointField};

const POINT_FIELDS: [PointField; 6] = [
    PointField { name: "x", offset: 0, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "y", offset: 4, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "z", offset: 8, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "height", offset: 12, datatype: PointField::FLOAT32, count: 1 },
    PointField { name: "label", offset: 16, datatype: PointField::UINT8, count: 1 },
    PointField { name: "confidence", offset: 17, datatype: PointField::UINT8, count: 1 },
];

/// The obstacles of a frame, in the robot's base frame.
#[derive(Debug, Clone, Copy)]
pub struct ObstacleMapRecord<'a> {
    /// The base's coordinate frame.
    pub frame_id: &'a str,
    /// The obstacles.
    pub map: ObstacleMap<'a>,
}

impl<'a> ObstacleMapRecord<'a> {
    pub(crate) fn cloud(&self, header: Header<'a>) -> PointCloud2<'a> {
        const POINT_BYTES: u32 = size_of::<ObstaclePoint>() as u32;
        let count = self.map.points.len() as u32;
        PointCloud2 {
            header,
            height: 1,
            width: count,
            fields: &POINT_FIELDS,
            is_bigendian: false,
            point_step: POINT_BYTES,
            row_step: POINT_BYTES * count,
            data: Bytes::new(bytemuck::cast_slice(self.map.points)),
            is_dense: true,
        }
    }

    /// One beam through the middle of each sector. Distances are in meters, angles in radians.
    ///
    /// Obstacles and drops have their distance. Infinity means free up to `range_max`, because consumers
    /// clear their map up to it. A sector whose floor was seen only up to a shorter range is NaN, like an
    /// unknown one. Remembered obstacles are NaN too, because a scan cannot mark them as old.
    pub(crate) fn scan(&self, header: Header<'a>) -> LaserScan<'a> {
        let range_max = ObstacleSector::scan_range_m(self.map.max_range_m);
        let ranges: Vec<f32> = self.map.sectors.iter().map(|sector| sector.beam_m(range_max)).collect();
        let last = self.map.sectors.len().saturating_sub(1) as f32;
        let first_rad = self.map.angle_min_rad + 0.5 * self.map.angle_step_rad;
        LaserScan {
            header,
            angle_min: first_rad,
            angle_max: first_rad + last * self.map.angle_step_rad,
            angle_increment: self.map.angle_step_rad,
            time_increment: 0.0,
            scan_time: 0.0,
            range_min: 0.0,
            range_max,
            ranges: Cow::Owned(ranges),
            intensities: Cow::Borrowed(&[]),
        }
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::SectorState;

    use super::*;
    use crate::messages::Time;

    fn sector(state: SectorState, range_m: f32, remembered: u8) -> ObstacleSector {
        ObstacleSector { state: state.into(), range_m, remembered, ..ObstacleSector::UNKNOWN }
    }

    #[test]
    fn a_scan_counts_counterclockwise_and_never_calls_unknown_free() {
        let sectors = [
            sector(SectorState::Occupied, 1.0, 0),
            sector(SectorState::Free, 4.6, 0),
            sector(SectorState::Free, 4.0, 0),
            sector(SectorState::Unknown, 2.0, 0),
            sector(SectorState::Drop, 1.5, 0),
            sector(SectorState::Occupied, 0.5, 1),
        ];
        let record = ObstacleMapRecord {
            frame_id: "base_link",
            map: ObstacleMap {
                sectors: &sectors,
                points: &[],
                angle_min_rad: -0.25,
                angle_step_rad: 0.1,
                max_range_m: 5.0,
            },
        };
        let header = Header { stamp: Time::default(), frame_id: "base_link".into() };
        let scan = record.scan(header);
        assert!((scan.angle_min + 0.2).abs() < 1e-6 && (scan.angle_max - 0.3).abs() < 1e-6);
        assert_eq!((scan.ranges[0], scan.ranges[4]), (1.0, 1.5), "the first beam is the rightmost");
        assert_eq!((scan.ranges[1], scan.range_max), (f32::INFINITY, 4.5));
        assert!([2, 3, 5].iter().all(|&index| scan.ranges[index].is_nan()), "{:?}", scan.ranges);
    }
}
