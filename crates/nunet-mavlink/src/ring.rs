//! Sectors of the camera's view as distances around the vehicle.

use nunet_types::ObstacleSector;

/// Distances of a message.
pub const BINS: usize = 72;
/// The distance of an unknown direction.
pub const UNKNOWN_CM: u16 = u16::MAX;

pub(crate) const BIN_DEG: f32 = 5.0;
/// Overlaps of angles below this are rounding, degrees.
const TOUCH_DEG: f32 = 0.01;

/// The distances of `OBSTACLE_DISTANCE`: 72 directions of 5 degrees, clockwise seen from above, the first one
/// forward.
///
/// It is the mirror image of a `LaserScan`, which counts counterclockwise.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DistanceRing {
    /// Centimeters; `max_cm + 1` is free, [`UNKNOWN_CM`] is unknown or outside of the view.
    pub distances_cm: [u16; BINS],
    /// The largest distance at which obstacles are detected, centimeters.
    pub max_cm: u16,
}

impl Default for DistanceRing {
    fn default() -> Self {
        Self { distances_cm: [UNKNOWN_CM; BINS], max_cm: 0 }
    }
}

impl DistanceRing {
    /// Fills the ring from sectors, counterclockwise: sector `i` begins at `angle_min + i * angle_step`
    /// radians, 0 = forward. `max_range_m` is the range within which obstacles were searched.
    ///
    /// A direction has the distance of its nearest obstacle or drop. It is free only if all of it is in view
    /// and free.
    pub fn fill(&mut self, sectors: &[ObstacleSector], [angle_min, angle_step]: [f32; 2], max_range_m: f32) {
        let range_m = ObstacleSector::scan_range_m(max_range_m);
        self.max_cm = centimeters(range_m);
        let mut bins = [Bin::default(); BINS];
        let width_deg = angle_step.to_degrees();
        for (index, sector) in (0_u16..).zip(sectors) {
            let center_deg = -(angle_min + (f32::from(index) + 0.5) * angle_step).to_degrees();
            let beam_m = sector.beam_m(range_m);
            for (bin, number) in bins.iter_mut().zip(0_u16..) {
                bin.add(f32::from(number) * BIN_DEG - center_deg, width_deg, beam_m);
            }
        }
        let (max_cm, distances) = (self.max_cm, &mut self.distances_cm);
        distances.iter_mut().zip(&bins).for_each(|(distance, bin)| *distance = bin.distance_cm(max_cm));
    }
}

/// One direction of the ring.
#[derive(Debug, Clone, Copy)]
struct Bin {
    nearest_m: f32,
    /// Degrees that are in view and free.
    free_deg: f32,
}

impl Default for Bin {
    fn default() -> Self {
        Self { nearest_m: f32::INFINITY, free_deg: 0.0 }
    }
}

impl Bin {
    /// Adds a sector of this width, whose center is `away_deg` from this bin's. Its beam is a distance,
    /// infinity if it is free, or NaN.
    fn add(&mut self, away_deg: f32, width_deg: f32, beam_m: f32) {
        let away_deg = (away_deg + 180.0).rem_euclid(360.0) - 180.0;
        let overlap_deg = (0.5 * (BIN_DEG + width_deg) - away_deg.abs()).min(BIN_DEG).min(width_deg);
        if overlap_deg < TOUCH_DEG {
            return;
        }
        // False for NaN.
        if beam_m < self.nearest_m {
            self.nearest_m = beam_m;
        } else if beam_m == f32::INFINITY {
            self.free_deg += overlap_deg;
        }
    }

    fn distance_cm(&self, max_cm: u16) -> u16 {
        let is_free = self.free_deg > BIN_DEG - 2.0 * TOUCH_DEG;
        match centimeters(self.nearest_m) {
            near if self.nearest_m.is_finite() && near <= max_cm => near,
            _ if is_free => max_cm.saturating_add(1),
            _ => UNKNOWN_CM,
        }
    }
}

/// Rounded down, so that no obstacle appears farther away than it is.
fn centimeters(meters: f32) -> u16 {
    (100.0 * meters + 0.01) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use nunet_types::SectorState;

    fn sector(state: SectorState, range_m: f32) -> ObstacleSector {
        ObstacleSector { state: state.into(), range_m, ..ObstacleSector::UNKNOWN }
    }

    /// Sectors of this width from this angle on, degrees.
    fn ring(sectors: &[ObstacleSector], from_deg: f32, width_deg: f32) -> DistanceRing {
        let mut ring = DistanceRing::default();
        ring.fill(sectors, [from_deg.to_radians(), width_deg.to_radians()], 5.0);
        ring
    }

    const FREE: f32 = 5.0;

    #[test]
    fn what_is_left_is_at_the_end_of_the_ring_and_what_is_right_at_its_beginning() {
        let free = sector(SectorState::Free, FREE);
        let mut sectors = vec![free; 60];
        sectors[15] = sector(SectorState::Occupied, 1.0); // 15 degrees to the right
        sectors[55] = sector(SectorState::Drop, 2.0); // 25 degrees to the left
        let ring = ring(&sectors, -30.0, 1.0);
        let at = |bin: usize| ring.distances_cm[bin];
        assert_eq!((ring.max_cm, at(0), at(2), at(70)), (450, 451, 451, 451));
        assert_eq!((at(3), at(4), at(67), at(66)), (100, 451, 200, UNKNOWN_CM), "{ring:?}");
        assert!((7..=65).all(|bin| at(bin) == UNKNOWN_CM), "outside of the view");
    }

    #[test]
    fn unknown_is_never_free_and_a_direction_that_is_half_in_view_is_unknown() {
        let free = sector(SectorState::Free, FREE);
        let unknown = sector(SectorState::Unknown, 1.0);
        let remembered = ObstacleSector { remembered: 1, ..sector(SectorState::Occupied, 0.4) };
        for other in [unknown, remembered, sector(SectorState::Free, 3.0)] {
            let ring = ring(&[free, free, other, free], -10.0, 5.0);
            assert_eq!(ring.distances_cm[0], UNKNOWN_CM, "{other:?}");
        }
        let ring = ring(&[free, free], -5.0, 5.0);
        assert_eq!((ring.distances_cm[0], ring.distances_cm[1]), (451, UNKNOWN_CM), "ends at 5 degrees");
    }

    #[test]
    fn an_obstacle_counts_wherever_it_is_in_a_direction_and_beyond_the_range_it_does_not() {
        let free = sector(SectorState::Free, FREE);
        let far = sector(SectorState::Occupied, 4.8);
        let ring = ring(&[free, sector(SectorState::Occupied, 0.0), far, free], -10.0, 5.0);
        assert_eq!(ring.distances_cm[0], 0, "touching");
        assert_eq!(
            ring.distances_cm[71], UNKNOWN_CM,
            "4.8 m is beyond what is searched, but not free up to there"
        );
    }

    #[test]
    fn a_camera_that_looks_back_fills_the_middle_of_the_ring() {
        let sectors = [sector(SectorState::Occupied, 1.5); 4];
        let ring = ring(&sectors, 170.0, 5.0);
        assert_eq!((ring.distances_cm[36], ring.distances_cm[0]), (150, UNKNOWN_CM));
    }
}
