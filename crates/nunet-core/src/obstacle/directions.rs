//! For each direction, finds the nearest obstacle and how far the floor is free.

use nunet_types::{ObstacleSector, SectorState};

use super::correction::{Correction, Viewpoint};
use super::hits::{GAP_M, Hits, SectorEvidence, SeenObstacle, gap};
use super::scan::Votes;
use super::sectors::Sectors;
use super::view::{Cell, View};

/// Where the free floor of a sector ends.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FreeFloor {
    /// Distance of its farthest point, meters; 0 without any.
    free_m: f32,
    end: End,
}

impl FreeFloor {
    /// Only up to a distance, meters. Beyond, a side of the sector is out of view.
    fn within(self, until_m: f32) -> Self {
        if self.free_m > until_m { Self { free_m: until_m, end: End::OutOfRange } } else { self }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    /// At the largest range, or where the image ends.
    OutOfRange,
    /// Where the floor is missing.
    Drop,
    /// Where something else is seen, or where the floor cannot be.
    Covered,
}

/// The farthest floor that is seen must be at least at this share of the distance at which the mount expects
/// it. With a mount that is some degrees wrong, the foot of an obstacle is taken for distant floor: it looks
/// like floor up to the last cell, but it is far too near.
const MIN_REACH: f32 = 0.5;

/// Fills all sectors from the points of obstacles and the cells of the floor.
pub(super) fn fill(
    view: &View,
    votes: &[Votes],
    hits: &mut Hits,
    max_range_m: f32,
    (correction, camera): (&mut Correction, Viewpoint),
    sectors: &mut [ObstacleSector],
) {
    let evidence = hits.evidence();
    correction.apply(view, votes, camera, evidence);
    for (index, (sector, evidence)) in sectors.iter_mut().zip(&*evidence).enumerate() {
        let cells = view.cells_of(index);
        let (seen, votes) = (&view.cells[cells.clone()], &votes[cells]);
        let floor = free_floor(seen, votes);
        let near_m = seen.first().map(|cell| cell.near_m);
        let in_view = view.extents[index].limit(near_m.unwrap_or(f32::NAN), view.cell_growth);
        let seen_from_m = near_m.map(|_| in_view.from_m);
        let floor = floor.within(in_view.until_m);
        *sector = conclude(evidence, floor, seen_from_m, view.cell_growth, max_range_m);
    }
}

/// Walks from cell to cell as long as each shows mostly floor. A cell that is mostly labeled as a thing does
/// not, whatever its depth: thin things are blurred into the floor behind them.
fn free_floor(cells: &[Cell], votes: &[Votes]) -> FreeFloor {
    let shows = |index: usize, count: u32| 2 * count >= cells[index].samples;
    let mut free_squared = 0.0_f32;
    for (index, vote) in votes.iter().enumerate() {
        if !shows(index, vote.floor) || shows(index, vote.other) {
            let is_missing = shows(index, vote.drop)
                && votes.get(index + 1).is_none_or(|next| shows(index + 1, next.drop));
            let end = if is_missing { End::Drop } else { End::Covered };
            return FreeFloor { free_m: free_squared.sqrt(), end };
        }
        free_squared = free_squared.max(vote.far_squared);
    }
    let free_m = free_squared.sqrt();
    let is_where_expected = cells.last().is_none_or(|last| free_m >= MIN_REACH * last.near_m);
    FreeFloor { free_m, end: if is_where_expected { End::OutOfRange } else { End::Covered } }
}

/// The sector of this evidence. `seen_from_m` is the distance of the nearest visible floor, `None` if none is
/// visible.
fn conclude(
    evidence: &SectorEvidence,
    floor: FreeFloor,
    seen_from_m: Option<f32>,
    cell_growth: f32,
    max_range_m: f32,
) -> ObstacleSector {
    let (state, range_m) = decide(evidence, floor, seen_from_m, cell_growth, max_range_m);
    let sector = ObstacleSector {
        range_m,
        seen_from_m: seen_from_m.unwrap_or(f32::NAN),
        state: state.into(),
        ..ObstacleSector::UNKNOWN
    };
    let Some(SeenObstacle { range_m: obstacle_m, min_height_m, max_height_m, label }) = evidence.obstacle
    else {
        return sector;
    };
    ObstacleSector { obstacle_m, min_height_m, max_height_m, label, ..sector }
}

/// The state of a sector, and up to where it is free, meters.
///
/// The nearest point decides. An obstacle counts only if the floor is free up to it. Otherwise the direction
/// is unknown from the end of the free floor on.
fn decide(
    evidence: &SectorEvidence,
    FreeFloor { free_m, end }: FreeFloor,
    seen_from_m: Option<f32>,
    cell_growth: f32,
    max_range_m: f32,
) -> (SectorState, f32) {
    let obstacle_m = evidence.obstacle.map(|obstacle| obstacle.range_m);
    if let Some(deceptive_m) = evidence.deceptive_m
        && obstacle_m.is_none_or(|obstacle_m| deceptive_m + GAP_M < obstacle_m)
    {
        return (SectorState::Unknown, free_m.min(deceptive_m));
    }
    // No floor is visible below the image. An obstacle there counts without floor before it.
    let known_m = free_m.max(seen_from_m.unwrap_or(f32::INFINITY));
    if let Some(obstacle_m) = obstacle_m
        && obstacle_m <= known_m + gap(obstacle_m, cell_growth)
    {
        return (SectorState::Occupied, obstacle_m);
    }
    match end {
        End::Drop if free_m > 0.0 => (SectorState::Drop, free_m),
        // The whole width may come into view only beyond the range, but the floor is missing within it.
        End::Drop => (SectorState::Drop, seen_from_m.map_or(max_range_m, |from_m| from_m.min(max_range_m))),
        End::OutOfRange if free_m > 0.0 => (SectorState::Free, free_m),
        End::OutOfRange | End::Covered => (SectorState::Unknown, free_m),
    }
}

/// Obstacles that left the image at the bottom.
#[derive(Debug, Clone)]
pub(super) struct Memory {
    hold_nanos: i64,
    /// For each sector the last obstacle that was seen, and when.
    seen: Vec<Option<(i64, ObstacleSector)>>,
    /// That of the sectors before.
    turned: Vec<Option<(i64, ObstacleSector)>>,
}

/// An obstacle leaves the image at the bottom if it was last seen nearer than this times the nearest visible
/// floor.
const LEAVES_BELOW: f32 = 1.5;

impl Memory {
    pub(super) fn new(hold_s: f32, sectors: usize) -> Self {
        let hold_nanos = (f64::from(hold_s) * 1e9) as i64;
        Self { hold_nanos, seen: vec![None; sectors], turned: vec![None; sectors] }
    }

    pub(super) fn clear(&mut self) {
        self.seen.fill(None);
    }

    /// Moves what is remembered from the sectors of one view to those of another, which are as many.
    pub(super) fn turn(&mut self, from: &Sectors, to: &Sectors) {
        if self.hold_nanos == 0 {
            return;
        }
        std::mem::swap(&mut self.seen, &mut self.turned);
        for (sector, seen) in self.seen.iter_mut().enumerate() {
            let [x, y] = to.middle(sector);
            *seen = self.turned.get(from.at(x, y) as usize).copied().flatten();
        }
    }

    /// Stores the obstacles of this frame, and restores those that left the image a short time ago.
    pub(super) fn update(&mut self, sectors: &mut [ObstacleSector], now_nanos: i64) {
        if self.hold_nanos == 0 {
            return;
        }
        for (sector, seen) in sectors.iter_mut().zip(&mut self.seen) {
            if sector.state() == SectorState::Occupied {
                *seen = Some((now_nanos, *sector));
            } else if let Some((then, last)) = *seen {
                let age_nanos = now_nanos.saturating_sub(then);
                let is_recent = (0..=self.hold_nanos).contains(&age_nanos);
                if is_recent && last.obstacle_m <= LEAVES_BELOW * last.seen_from_m {
                    // A nearer drop is seen now, and must not be hidden.
                    if sector.state() != SectorState::Drop || sector.range_m > last.range_m {
                        *sector = ObstacleSector { remembered: 1, age_s: age_nanos as f32 / 1e9, ..last };
                    }
                } else {
                    *seen = None;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE_M: f32 = 5.0;

    fn walk(samples: &[(u32, u32, u32)]) -> FreeFloor {
        let cells: Vec<Cell> =
            samples.iter().map(|&(samples, ..)| Cell { samples, near_m: 1.0, tangent: 0.5 }).collect();
        let votes: Vec<Votes> = samples
            .iter()
            .enumerate()
            .map(|(index, &(_, floor, drop))| Votes {
                floor,
                drop,
                far_squared: ((index + 1) as f32).powi(2),
                ..Votes::default()
            })
            .collect();
        free_floor(&cells, &votes)
    }

    #[test]
    fn free_floor_ends_at_the_first_cell_that_does_not_show_it() {
        assert_eq!(walk(&[(4, 4, 0), (4, 3, 0)]), FreeFloor { free_m: 2.0, end: End::OutOfRange });
        assert_eq!(walk(&[(4, 4, 0), (4, 1, 0), (4, 4, 0)]), FreeFloor { free_m: 1.0, end: End::Covered });
        assert_eq!(walk(&[(4, 4, 0), (4, 0, 4), (4, 0, 2)]), FreeFloor { free_m: 1.0, end: End::Drop });
        assert_eq!(walk(&[(4, 4, 0), (4, 0, 4), (4, 4, 0)]).end, End::Covered, "one cell is no drop");
        assert_eq!(walk(&[(4, 1, 0)]), FreeFloor { free_m: 0.0, end: End::Covered });
        assert_eq!(walk(&[]), FreeFloor { free_m: 0.0, end: End::OutOfRange });
    }

    #[test]
    fn floor_that_is_far_nearer_than_expected_is_not_free_to_its_end() {
        let cells = [1.0, 4.0].map(|near_m| Cell { samples: 4, near_m, tangent: 0.5 });
        let seen_to = |far_m: f32| {
            let votes = [1.5, far_m].map(|far_m: f32| Votes {
                floor: 4,
                far_squared: far_m.powi(2),
                ..Votes::default()
            });
            free_floor(&cells, &votes)
        };
        assert_eq!(seen_to(2.5), FreeFloor { free_m: 2.5, end: End::OutOfRange });
        assert_eq!(seen_to(1.75), FreeFloor { free_m: 1.75, end: End::Covered });
    }

    #[test]
    fn a_cell_that_is_labeled_as_a_thing_is_not_free() {
        let cell = Cell { samples: 4, near_m: 1.0, tangent: 0.5 };
        let free_m = |other: u32| {
            let vote = Votes { floor: 4, other, far_squared: 1.0, ..Votes::default() };
            free_floor(&[cell], &[vote])
        };
        assert_eq!(free_m(1), FreeFloor { free_m: 1.0, end: End::OutOfRange });
        assert_eq!(free_m(2), FreeFloor { free_m: 0.0, end: End::Covered });
    }

    #[test]
    fn free_floor_is_cut_where_a_side_of_the_sector_leaves_the_view() {
        let floor = FreeFloor { free_m: 2.0, end: End::Drop };
        assert_eq!(floor.within(1.5), FreeFloor { free_m: 1.5, end: End::OutOfRange });
        assert_eq!(floor.within(f32::INFINITY), floor);
        let nothing = floor.within(0.0);
        let sector = conclude(&SectorEvidence::default(), nothing, None, 0.01, RANGE_M);
        assert_eq!((sector.state(), sector.range_m), (SectorState::Unknown, 0.0));
    }

    /// What depth shows at these distances; NaN and infinity are nothing.
    fn evidence(obstacle_m: f32, deceptive_m: f32) -> SectorEvidence {
        let finite = |distance_m: f32| distance_m.is_finite().then_some(distance_m);
        let seen = |range_m| SeenObstacle { range_m, min_height_m: 0.1, max_height_m: 0.4, label: 3 };
        SectorEvidence { obstacle: finite(obstacle_m).map(seen), deceptive_m: finite(deceptive_m) }
    }

    fn state(obstacle_m: f32, deceptive_m: f32, free_m: f32, end: End) -> (SectorState, f32) {
        let floor = FreeFloor { free_m, end };
        let sector = conclude(&evidence(obstacle_m, deceptive_m), floor, Some(0.5), 0.01, RANGE_M);
        (sector.state(), sector.range_m)
    }

    #[test]
    fn a_sector_names_its_obstacle_also_if_another_thing_decides() {
        let floor = FreeFloor { free_m: 0.9, end: End::Covered };
        let behind_glass = conclude(&evidence(2.0, 1.0), floor, Some(0.5), 0.01, RANGE_M);
        let expected = ObstacleSector {
            range_m: 0.9,
            obstacle_m: 2.0,
            min_height_m: 0.1,
            max_height_m: 0.4,
            seen_from_m: 0.5,
            label: 3,
            ..ObstacleSector::UNKNOWN
        };
        assert_eq!(behind_glass, expected);
        let empty = conclude(&SectorEvidence::default(), floor, None, 0.01, RANGE_M);
        let unknown = ObstacleSector { range_m: 0.9, ..ObstacleSector::UNKNOWN };
        // As text, because unknown values are NaN.
        assert_eq!(format!("{empty:?}"), format!("{unknown:?}"));
    }

    #[test]
    fn the_nearest_point_decides() {
        const NONE: f32 = f32::INFINITY;
        assert_eq!(state(2.0, NONE, 1.95, End::Covered), (SectorState::Occupied, 2.0));
        assert_eq!(state(1.0, NONE, 2.0, End::Covered), (SectorState::Occupied, 1.0), "hangs over the floor");
        assert_eq!(state(0.4, NONE, 0.0, End::Covered), (SectorState::Occupied, 0.4), "below the image");
        assert_eq!(state(3.0, NONE, 1.0, End::Covered), (SectorState::Unknown, 1.0), "unseen in between");
        assert_eq!(state(2.0, 1.0, 0.9, End::Covered), (SectorState::Unknown, 0.9), "a screen before a wall");
        assert_eq!(state(2.0, 1.95, 1.9, End::Covered), (SectorState::Occupied, 2.0), "a window in a wall");
        assert_eq!(state(f32::NAN, NONE, 4.9, End::OutOfRange), (SectorState::Free, 4.9));
        assert_eq!(state(f32::NAN, NONE, 1.2, End::Drop), (SectorState::Drop, 1.2));
        assert_eq!(state(f32::NAN, NONE, 0.0, End::Drop), (SectorState::Drop, 0.5));
        assert_eq!(state(f32::NAN, NONE, 0.0, End::OutOfRange), (SectorState::Unknown, 0.0));
        assert_eq!(state(f32::NAN, 1.5, 4.9, End::OutOfRange), (SectorState::Unknown, 1.5));
    }

    #[test]
    fn a_drop_is_within_the_range_also_if_its_sector_is_in_view_only_beyond() {
        let missing = FreeFloor { free_m: 0.0, end: End::Drop };
        for seen_from_m in [Some(5.12), None] {
            let sector = conclude(&SectorEvidence::default(), missing, seen_from_m, 0.01, RANGE_M);
            assert_eq!((sector.state(), sector.range_m), (SectorState::Drop, RANGE_M));
        }
    }

    fn occupied(range_m: f32) -> ObstacleSector {
        ObstacleSector {
            state: SectorState::Occupied.into(),
            range_m,
            obstacle_m: range_m,
            seen_from_m: 0.6,
            ..ObstacleSector::UNKNOWN
        }
    }

    #[test]
    fn a_remembered_obstacle_does_not_hide_a_nearer_drop() {
        let drop = |range_m: f32| ObstacleSector {
            state: SectorState::Drop.into(),
            range_m,
            ..ObstacleSector::UNKNOWN
        };
        let mut memory = Memory::new(0.5, 2);
        memory.update(&mut [occupied(0.7); 2], 0);
        let mut sectors = [drop(0.65), drop(0.75)];
        memory.update(&mut sectors, 100_000_000);
        assert_eq!(sectors.map(|sector| sector.remembered), [0, 1]);
        assert_eq!((sectors[0].state(), sectors[0].range_m), (SectorState::Drop, 0.65));
        let mut sectors = [ObstacleSector::UNKNOWN; 2];
        memory.update(&mut sectors, 200_000_000);
        assert_eq!(sectors.map(|sector| sector.range_m), [0.7; 2], "it is still remembered");
    }

    #[test]
    fn an_obstacle_that_leaves_below_the_image_is_remembered_for_a_while_and_marked() {
        let mut memory = Memory::new(0.5, 2);
        let after = |memory: &mut Memory, now: i64| {
            let mut sectors = [ObstacleSector::UNKNOWN; 2];
            memory.update(&mut sectors, now);
            sectors
        };
        memory.update(&mut [occupied(0.7), occupied(2.0)], 0);
        let [near, far] = after(&mut memory, 400_000_000);
        assert_eq!((near.state(), near.remembered, near.range_m), (SectorState::Occupied, 1, 0.7));
        assert!((near.age_s - 0.4).abs() < 1e-6);
        assert_eq!((far.state(), far.remembered), (SectorState::Unknown, 0), "it did not leave below");
        assert_eq!(after(&mut memory, 600_000_000)[0].state(), SectorState::Unknown);
        memory.update(&mut [occupied(0.7), occupied(2.0)], 0);
        assert_eq!(after(&mut memory, -1)[0].state(), SectorState::Unknown, "time went back");

        memory.update(&mut [occupied(0.7), occupied(2.0)], 0);
        memory.turn(&Sectors::new(0.0, 0.2, 2), &Sectors::new(-0.1, 0.1, 2));
        let [new, near] = after(&mut memory, 100_000_000);
        assert_eq!((new.state(), near.range_m), (SectorState::Unknown, 0.7), "the view turned right by one");
    }
}
