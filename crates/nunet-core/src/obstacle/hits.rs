//! The points of obstacles by direction, and the nearest one of each.

use nunet_types::NO_LABEL;

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

/// The nearest obstacle of a sector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SeenObstacle {
    /// From the base's origin, meters.
    pub(super) range_m: f32,
    /// Its lowest and its highest point, meters above ground.
    pub(super) min_height_m: f32,
    pub(super) max_height_m: f32,
    pub(super) label: u8,
}

/// What a frame shows in a sector, except for the floor. The state of the sector is decided later.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct SectorEvidence {
    pub(super) obstacle: Option<SeenObstacle>,
    /// The distance of the nearest window, mirror or screen, meters.
    pub(super) deceptive_m: Option<f32>,
}

/// The points of one frame. Allocates once.
#[derive(Debug, Clone)]
pub(super) struct Hits {
    hits: Vec<Hit>,
    nearest: Vec<Nearest>,
    evidence: Vec<SectorEvidence>,
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

    fn evidence(&self) -> SectorEvidence {
        let Self { obstacle_m, deceptive_m, min_height_m, max_height_m, label } = *self;
        let obstacle = SeenObstacle { range_m: obstacle_m, min_height_m, max_height_m, label };
        SectorEvidence {
            obstacle: obstacle_m.is_finite().then_some(obstacle),
            deceptive_m: deceptive_m.is_finite().then_some(deceptive_m),
        }
    }
}

impl Hits {
    /// For at most this number of points.
    pub(super) fn new(points: usize, sectors: usize) -> Self {
        Self {
            hits: Vec::with_capacity(points),
            nearest: vec![Nearest::NOTHING; sectors],
            evidence: vec![SectorEvidence::default(); sectors],
        }
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

    /// What is nearest in each sector, once all points of the frame were added. The caller may correct it.
    pub(super) fn evidence(&mut self) -> &mut [SectorEvidence] {
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
        for (evidence, nearest) in self.evidence.iter_mut().zip(&self.nearest) {
            *evidence = nearest.evidence();
        }
        &mut self.evidence
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
        for (range_m, height_m, label) in [(2.0, 0.9, 1), (1.6, 0.1, 2), (1.5, 0.4, 3), (1.8, 0.2, 4)] {
            hits.add(0, [range_m, height_m], || label);
        }
        hits.add_deceptive(1, 3.0);
        hits.add_deceptive(1, 2.5);
        hits.add(2, [1.0, 1.0], || 5);
        let near = SeenObstacle { range_m: 1.5, min_height_m: 0.1, max_height_m: 0.4, label: 3 };
        let expected = [
            SectorEvidence { obstacle: Some(near), deceptive_m: None },
            SectorEvidence { obstacle: None, deceptive_m: Some(2.5) },
        ];
        assert_eq!(hits.evidence(), expected);
        hits.start();
        assert_eq!(hits.evidence(), [SectorEvidence::default(); 2]);
    }
}
