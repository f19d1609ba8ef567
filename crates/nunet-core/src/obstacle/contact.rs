//! Where a thing stands on the floor, by labels of samples whose depth is uncertain.
//!
//! In the image, a thing begins where the floor before it ends. On level floor, that place has a known
//! distance, which does not depend on depth. So things are found whose depth is wrong, such as thin legs that
//! depth blurs into the floor behind them. A flat thing must not count: the labels must continue as high as a
//! thing would be that stands there.

use super::ObstacleOptions;
use super::scan::Votes;
use super::view::Cell;
use crate::camera::Mount;

/// A thing must be this high to count, and this much higher than the clearance, meters.
const MIN_HEIGHT_M: f32 = 0.1;
const ABOVE_CLEARANCE_M: f32 = 0.05;
/// Its height is measured up to here, meters. Above, the wall behind it may begin.
const MEASURED_HEIGHT_M: f32 = 0.15;
/// A camera that is hardly higher than a thing would have to see it up to the horizon. This share of its
/// height is enough.
const MAX_HEIGHT_SHARE: f32 = 0.75;
/// A thing must fill more than one of this many parts of each cell. The legs of chairs are narrower than
/// sectors, and whether a sector is in view is also decided by quarters.
const PARTS: u32 = 4;

/// How high a thing must be, meters.
#[derive(Debug, Clone, Copy)]
pub(super) struct MinHeight {
    camera_m: f32,
    min_m: f32,
    measured_m: f32,
}

/// The nearest thing of a sector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Contact {
    /// Distance from the base's origin, meters.
    pub(super) range_m: f32,
    /// It is at least this high, meters.
    pub(super) height_m: f32,
    pub(super) label: u8,
}

impl MinHeight {
    /// `None` for a camera that cannot see whether a thing is higher than the clearance.
    pub(super) fn new(mount: &Mount, options: &ObstacleOptions) -> Option<Self> {
        let camera_m = mount.height_m() as f32;
        let visible_m = MAX_HEIGHT_SHARE * camera_m;
        let min_m = MIN_HEIGHT_M.max(options.clearance_m + ABOVE_CLEARANCE_M).min(visible_m);
        let measured_m = MEASURED_HEIGHT_M.min(visible_m).max(min_m);
        (options.clearance_m < min_m).then_some(Self { camera_m, min_m, measured_m })
    }

    /// Walks from cell to cell. A thing at the distance of a cell is as high as the camera sees it above the
    /// cell of the same direction whose tangent is less by that share of the camera's height.
    pub(super) fn nearest(self, cells: &[Cell], votes: &[Votes]) -> Option<Contact> {
        // With the tangent of its foot.
        let mut thing: Option<(f32, Contact)> = None;
        let is_high = |(_, contact): &(f32, Contact)| contact.height_m >= self.min_m;
        for (cell, vote) in cells.iter().zip(votes) {
            if !shows_thing(cell, vote) {
                if thing.as_ref().is_some_and(is_high) {
                    break;
                }
                thing = None;
                continue;
            }
            let foot = Contact { range_m: cell.near_m, height_m: 0.0, label: vote.label };
            let (tangent, contact) = thing.get_or_insert((cell.tangent, foot));
            contact.height_m = (1.0 - cell.tangent / *tangent) * self.camera_m;
            if contact.height_m >= self.measured_m {
                break;
            }
        }
        thing.filter(is_high).map(|(_, contact)| contact)
    }
}

/// Whether a thing fills more than a part of a cell, or half of a cell of few samples: one of them may be
/// wrong.
fn shows_thing(cell: &Cell, vote: &Votes) -> bool {
    let part = vote.other > 1 && PARTS * vote.other > cell.samples;
    part || (vote.other > 0 && 2 * vote.other >= cell.samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHAIR: u8 = 3;

    /// Cells of a camera 0.5 m above the floor, 4 samples each, with this number of samples labeled as a
    /// thing.
    fn nearest(clearance_m: f32, others: &[u32]) -> Option<Contact> {
        let mount = Mount::new([0.0, 0.0, 0.5], [0.0; 3]).unwrap();
        let options = ObstacleOptions { clearance_m, ..ObstacleOptions::default() };
        let cell = |index: usize| {
            let near_m = 1.0 + 0.1 * index as f32;
            Cell { samples: 4, near_m, tangent: 0.5 / near_m }
        };
        let cells: Vec<_> = (0..others.len()).map(cell).collect();
        let votes: Vec<_> =
            others.iter().map(|&other| Votes { other, label: CHAIR, ..Votes::default() }).collect();
        MinHeight::new(&mount, &options)?.nearest(&cells, &votes)
    }

    #[test]
    fn a_thing_stands_where_its_labels_begin_and_is_as_high_as_they_continue() {
        let found = nearest(0.05, &[0, 1, 4, 3, 2, 4, 4, 4, 4, 0]).unwrap();
        assert_eq!((found.range_m, found.label), (1.2, CHAIR));
        assert!((found.height_m - 1.0 / 6.0).abs() < 1e-6, "{found:?}: 0.5 m * (1 - 1.2 / 1.8)");
        assert_eq!(
            nearest(0.05, &[4, 4, 4, 4, 4, 4]).unwrap().range_m,
            1.0,
            "from the bottom of the image on"
        );
    }

    #[test]
    fn a_thing_may_be_lower_than_what_is_measured_and_narrower_than_its_sector() {
        let low = nearest(0.05, &[0, 0, 4, 4, 4, 4, 4, 0, 4]).unwrap();
        assert!(
            low.range_m == 1.2 && (low.height_m - 0.125).abs() < 1e-6,
            "{low:?}: 0.5 m * (1 - 1.2 / 1.6)"
        );
        assert_eq!(nearest(0.05, &[0, 2, 2, 2, 2, 2, 2]).unwrap().range_m, 1.1, "half of each cell");
        assert_eq!(nearest(0.05, &[0, 1, 1, 1, 1, 1, 1]), None, "a quarter");
    }

    #[test]
    fn what_lies_flat_or_is_not_seen_high_enough_is_no_thing() {
        assert_eq!(nearest(0.05, &[0, 4, 4, 0, 4, 4, 0]), None);
        assert_eq!(nearest(0.05, &[0, 0, 0, 0, 4, 4]), None, "the range ends");
        let wall = [0, 0, 4, 4, 4, 4, 4, 4, 4];
        assert_eq!(
            (nearest(0.05, &wall).is_some(), nearest(0.15, &wall)),
            (true, None),
            "0.2 m above 0.15 m"
        );
        assert_eq!(nearest(0.05, &[]), None);
    }

    #[test]
    fn a_camera_lower_than_the_clearance_cannot_tell() {
        let mount = Mount::new([0.0, 0.0, 0.06], [0.0; 3]).unwrap();
        assert!(MinHeight::new(&mount, &ObstacleOptions::default()).is_none());
    }
}
