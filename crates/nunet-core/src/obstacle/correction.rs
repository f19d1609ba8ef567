//! Corrects distances from depth by the places where things stand.
//!
//! Depth from one image makes near and thin things too far away, and all parts of a thing by about the same
//! factor. Labels show where its legs stand. So what depth shows beside them, such as the seat, is brought
//! nearer by the same factor. Nothing is moved farther away.

use nunet_types::ObstacleSector;

use super::contact::{Contact, MinHeight};
use super::hits::DEPTH_OF_OBSTACLE_M;
use super::scan::Votes;
use super::view::View;
use super::{Mount, ObstacleOptions};

/// The distance to the side over which the parts of a thing share their factor, meters: the width of a chair.
const WIDTH_M: f32 = 0.5;

/// What a sector shows.
#[derive(Debug, Clone, Copy)]
struct Measured {
    /// The distance of the nearest point from depth, meters; NaN if there is none.
    depth_m: f32,
    /// By which factor the place where a thing stands is nearer; 1 if it is not.
    factor: f32,
}

/// The place where a thing stands, for each sector. Allocates once.
#[derive(Debug, Clone)]
pub(super) struct Contacts {
    min_height: Option<MinHeight>,
    found: Vec<Option<Contact>>,
    measured: Vec<Measured>,
}

impl Measured {
    fn new(depth_m: f32, contact: Option<Contact>) -> Self {
        let factor = contact.map_or(1.0, |contact| contact.range_m / depth_m);
        // `min` ignores NaN.
        Self { depth_m, factor: factor.min(1.0) }
    }
}

impl Contacts {
    pub(super) fn new(mount: &Mount, options: &ObstacleOptions) -> Self {
        Self {
            min_height: MinHeight::new(mount, options),
            found: Vec::with_capacity(options.sectors),
            measured: Vec::with_capacity(options.sectors),
        }
    }

    /// Takes another mount of the same camera.
    pub(super) fn set_mount(&mut self, mount: &Mount, options: &ObstacleOptions) {
        self.min_height = MinHeight::new(mount, options);
    }

    /// Finds where things stand, and brings the obstacles nearer that depth shows in `sectors`. Their labels
    /// stay.
    pub(super) fn correct(&mut self, view: &View, votes: &[Votes], sectors: &mut [ObstacleSector]) {
        self.found.clear();
        let Some(min_height) = self.min_height else { return };
        let cells = (0..sectors.len()).map(|sector| view.cells_of(sector));
        self.found.extend(cells.map(|cells| min_height.nearest(&view.cells[cells.clone()], &votes[cells])));
        let seen = sectors.iter().zip(&self.found);
        self.measured.clear();
        self.measured.extend(seen.map(|(sector, contact)| Measured::new(sector.obstacle_m, *contact)));
        for (index, sector) in sectors.iter_mut().enumerate() {
            let factor = self.factor(index, view.sectors.angle_step_rad);
            if factor < 1.0 {
                move_along_rays(sector, factor, min_height.camera_m());
            }
        }
    }

    /// Where a thing stands in a sector.
    pub(super) fn of(&self, sector: usize) -> Option<Contact> {
        self.found.get(sector).copied().flatten()
    }

    /// The smallest factor of the sectors beside this one that show something about as far away.
    fn factor(&self, sector: usize, angle_step_rad: f32) -> f32 {
        let depth_m = self.measured[sector].depth_m;
        // Casts saturate, and NaN becomes 0.
        let reach = (WIDTH_M / (depth_m * angle_step_rad)) as usize;
        let end = sector.saturating_add(reach).saturating_add(1).min(self.measured.len());
        self.measured[sector.saturating_sub(reach)..end]
            .iter()
            .filter(|beside| (beside.depth_m - depth_m).abs() <= DEPTH_OF_OBSTACLE_M)
            .fold(1.0, |factor, beside| beside.factor.min(factor))
    }
}

/// Moves an obstacle nearer to the camera. Its heights approach that of the camera, meters.
fn move_along_rays(sector: &mut ObstacleSector, factor: f32, camera_m: f32) {
    let moved = |height_m: f32| camera_m + factor * (height_m - camera_m);
    sector.obstacle_m *= factor;
    sector.min_height_m = moved(sector.min_height_m);
    sector.max_height_m = moved(sector.max_height_m);
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_RAD: f32 = 0.1;

    /// The factor of each sector, for these distances of points and of places where something stands.
    fn factors(seen: &[(f32, f32)]) -> Vec<f32> {
        let mount = Mount::new([0.0, 0.0, 0.5], [0.0; 3]).unwrap();
        let mut contacts = Contacts::new(&mount, &ObstacleOptions::default());
        contacts.measured.extend(seen.iter().map(|&(depth_m, range_m)| {
            let contact = Contact { range_m, height_m: 0.2, label: 3 };
            Measured::new(depth_m, range_m.is_finite().then_some(contact))
        }));
        (0..seen.len()).map(|sector| contacts.factor(sector, STEP_RAD)).collect()
    }

    #[test]
    fn a_seat_is_as_much_nearer_as_the_legs_beside_it() {
        const NONE: f32 = f32::NAN;
        let chair = [(2.0, 1.0), (2.1, NONE), (2.2, NONE), (2.0, 1.5), (2.0, NONE)];
        assert_eq!(factors(&chair), [0.5, 0.5, 0.5, 0.75, 0.75], "0.5 m are two sectors at 2 m");
        assert_eq!(factors(&[(2.0, 1.0), (2.5, NONE)]), [0.5, 1.0], "the wall behind it");
        assert_eq!(factors(&[(2.0, 1.0), (NONE, NONE)]), [0.5, 1.0], "nothing to move");
        assert_eq!(factors(&[(NONE, 1.0), (2.0, NONE)]), [1.0, 1.0], "no depth to compare with");
        assert_eq!(factors(&[(2.0, 2.5), (2.0, NONE)]), [1.0, 1.0], "never farther");
    }

    #[test]
    fn what_is_moved_stays_on_its_rays() {
        let unknown = ObstacleSector::UNKNOWN;
        let mut seat = ObstacleSector { obstacle_m: 2.0, min_height_m: 0.25, max_height_m: 0.75, ..unknown };
        move_along_rays(&mut seat, 0.5, 0.25);
        assert_eq!((seat.obstacle_m, seat.min_height_m, seat.max_height_m), (1.0, 0.25, 0.5));
    }
}
