//! The points of obstacles by direction, and the nearest one of each.

use nunet_types::{NO_LABEL, ObstacleSector};

/// Points of an obstacle are at most this much farther than its nearest one, meters.
pub(super) const DEPTH_OF_OBSTACLE_M: f32 = 0.3;
/// Free floor may end before its obstacle by this many meters plus this many cells.
pub(super) const GAP_M: f32 = 0.1;
const GAP_CELLS: f32 = 3.0;

/// A point that may belong to the nearest obstacle of its sector.
#[derive(Debug, Clone, Copy)]
struct Hit {
    range_m: f32,
    height_m: f32,
    sector: u32,
}

/// What is nearest in a sector. Distances are infinite without any.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    obstacle_m: f32,
    /// The distance of the nearest window, mirror or screen.
    deceptive_m: f32,
    min_height_m: f32,
    max_height_m: f32,
    label: u8,
}

/// The points of one frame. Allocates once.
#[derive(Debug, Clone)]
pub(super) struct Hits {
    hits: Vec<Hit>,
    nearest: Vec<Nearest>,
}

impl Nearest {
    const NOTHING: Self = Self {
        obstacle_m: f32::INFINITY,
        deceptive_m: f32::INFINITY,
        min_height_m: f32::INFINITY,
        max_height_m: f32::NEG_INFINITY,
        label: NO_LABEL,
    };

    /// Up to this distance, points belong to the nearest obstacle, meters.
    #[inline]
    fn depth_m(&self) -> f32 {
        self.obstacle_m + DEPTH_OF_OBSTACLE_M
    }

    /// A sector without a state. Until it has one, `range_m` is the distance of the nearest deceptive
    /// surface.
    fn sector(&self) -> ObstacleSector {
        let sector = ObstacleSector { range_m: self.deceptive_m, ..ObstacleSector::UNKNOWN };
        if self.obstacle_m.is_infinite() {
            return sector;
        }
        let Self { obstacle_m, min_height_m, max_height_m, label, .. } = *self;
        ObstacleSector { obstacle_m, min_height_m, max_height_m, label, ..sector }
    }
}

impl Hits {
    /// For at most this number of points.
    pub(super) fn new(points: usize, sectors: usize) -> Self {
        Self { hits: Vec::with_capacity(points), nearest: vec![Nearest::NOTHING; sectors] }
    }

    /// Begins a frame.
    pub(super) fn start(&mut self) {
        self.hits.clear();
        self.nearest.fill(Nearest::NOTHING);
    }

    /// Takes a point of an obstacle; one without a sector is ignored. Its label is read only if it is the
    /// nearest one.
    #[inline]
    pub(super) fn add(&mut self, sector: u32, [range_m, height_m]: [f32; 2], label: impl FnOnce() -> u8) {
        let Some(nearest) = self.nearest.get_mut(sector as usize) else {
            return;
        };
        // A point that is too far now is too far in the end, because the obstacle only comes nearer.
        if range_m <= nearest.depth_m() {
            if range_m < nearest.obstacle_m {
                (nearest.obstacle_m, nearest.label) = (range_m, label());
            }
            self.hits.push(Hit { range_m, height_m, sector });
        }
    }

    /// Takes a point of a deceptive surface.
    pub(super) fn add_deceptive(&mut self, sector: u32, range_m: f32) {
        if let Some(nearest) = self.nearest.get_mut(sector as usize) {
            nearest.deceptive_m = nearest.deceptive_m.min(range_m);
        }
    }

    /// Writes what is nearest in each sector.
    pub(super) fn fill(&mut self, sectors: &mut [ObstacleSector]) {
        for &Hit { range_m, height_m, sector } in &self.hits {
            let nearest = &mut self.nearest[sector as usize];
            if range_m <= nearest.depth_m() {
                // Not `min` and `max`, which take several instructions because of NaN. There is none here.
                if height_m < nearest.min_height_m {
                    nearest.min_height_m = height_m;
                }
                if height_m > nearest.max_height_m {
                    nearest.max_height_m = height_m;
                }
            }
        }
        for (sector, nearest) in sectors.iter_mut().zip(&self.nearest) {
            *sector = nearest.sector();
        }
    }
}

/// By how much the end of the free floor may differ from an obstacle, meters.
pub(super) fn gap(obstacle_m: f32, cell_growth: f32) -> f32 {
    GAP_M + GAP_CELLS * cell_growth * obstacle_m.min(100.0).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_points_near_the_nearest_one_belong_to_the_obstacle() {
        let mut hits = Hits::new(10, 2);
        let mut sectors = [ObstacleSector::UNKNOWN; 2];
        for (range_m, height_m, label) in [(2.0, 0.9, 1), (1.6, 0.1, 2), (1.5, 0.4, 3), (1.8, 0.2, 4)] {
            hits.add(0, [range_m, height_m], || label);
        }
        hits.add_deceptive(1, 3.0);
        hits.add_deceptive(1, 2.5);
        hits.add(2, [1.0, 1.0], || 5);
        hits.fill(&mut sectors);
        let [near, glass] = sectors;
        assert_eq!((near.obstacle_m, near.label, near.range_m), (1.5, 3, f32::INFINITY));
        assert_eq!((near.min_height_m, near.max_height_m), (0.1, 0.4));
        assert!(glass.obstacle_m.is_nan() && glass.min_height_m.is_nan() && glass.max_height_m.is_nan());
        assert_eq!((glass.range_m, glass.label), (2.5, NO_LABEL));
        hits.start();
        hits.fill(&mut sectors);
        assert!(sectors[0].obstacle_m.is_nan() && sectors[1].range_m.is_infinite());
    }
}
