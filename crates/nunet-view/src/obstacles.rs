//! Obstacles from above, as they are sent.

use nunet_types::ObstacleMap;

/// More points than this are not distinguishable in a small view from above; of more, every n-th is sent.
const MAX_POINTS: usize = 500;

/// Appends the section `obstacles` to `bytes`: counts and angles (16 bytes), sectors (8 bytes each), points
/// (8 bytes each).
pub(crate) fn pack_obstacles(map: &ObstacleMap<'_>, bytes: &mut Vec<u8>) {
    let stride = map.points.len().div_ceil(MAX_POINTS).max(1);
    let points = map.points.iter().step_by(stride);
    for count in [map.sectors.len(), points.len()] {
        bytes.extend(u16::try_from(count).unwrap_or(u16::MAX).to_le_bytes());
    }
    let numbers = [map.angle_min_rad, map.angle_step_rad, map.max_range_m];
    bytes.extend(numbers.map(f32::to_le_bytes).as_flattened());
    for sector in map.sectors {
        bytes.extend(sector.range_m.to_le_bytes());
        bytes.extend([sector.state() as u8, sector.label, sector.remembered, 0]);
    }
    for point in points {
        // A cast saturates.
        let centimeters =
            [point.x, point.y, point.height].map(|meters| ((100.0 * meters).round() as i16).to_le_bytes());
        bytes.extend(centimeters.as_flattened());
        bytes.extend([point.label, 0]);
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::{ObstaclePoint, ObstacleSector, SectorState};

    use super::*;

    const POINT: ObstaclePoint = ObstaclePoint {
        x: 1.25,
        y: -400.0,
        z: 0.6,
        height: 0.5,
        label: 7,
        confidence: 255,
        reserved: [0; 2],
    };

    fn packed(sectors: &[ObstacleSector], points: &[ObstaclePoint]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let map =
            ObstacleMap { sectors, points, angle_min_rad: -0.5, angle_step_rad: 0.25, max_range_m: 6.0 };
        pack_obstacles(&map, &mut bytes);
        bytes
    }

    #[test]
    fn sectors_and_points_follow_the_counts() {
        let sector = ObstacleSector {
            range_m: 1.5,
            state: SectorState::Occupied.into(),
            label: 3,
            remembered: 1,
            ..ObstacleSector::UNKNOWN
        };
        let bytes = packed(&[ObstacleSector::UNKNOWN, sector], &[POINT]);
        assert_eq!(bytes.len(), 16 + 2 * 8 + 8);
        assert_eq!(bytes[..4], [2, 0, 1, 0]);
        assert_eq!(bytes[24..28], 1.5_f32.to_le_bytes());
        assert_eq!(bytes[28..32], [2, 3, 1, 0]);
        let expected = [125_i16, i16::MIN, 50].map(i16::to_le_bytes);
        assert_eq!(bytes[32..38], *expected.as_flattened());
        assert_eq!(bytes[38..], [7, 0]);
    }

    #[test]
    fn of_many_points_every_nth_is_sent() {
        let points = vec![POINT; 2 * MAX_POINTS + 1];
        let bytes = packed(&[], &points);
        let count = usize::from(u16::from_le_bytes([bytes[2], bytes[3]]));
        assert_eq!(count, points.len().div_ceil(3));
        assert_eq!(bytes.len(), 16 + 8 * count);
    }
}
