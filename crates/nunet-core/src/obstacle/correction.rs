//! Corrects distances from depth by the places where things stand.
//!
//! Depth from one image makes near and thin things too far away, and all parts of a thing by about the same
//! factor. Labels show where its legs stand, if the confidence says that depth is uncertain there. So what
//! depth shows beside them, such as the seat, is brought nearer by the same factor, on its rays from the
//! camera. Nothing is moved farther away. Without labels or confidence, nothing is corrected.

use super::ObstacleOptions;
use super::contact::{Contact, MinHeight};
use super::ground::Ground;
use super::hits::{DEPTH_OF_OBSTACLE_M, SectorEvidence, SeenObstacle, gap};
use super::scan::Votes;
use super::view::View;
use crate::camera::Mount;

/// The distance to the side over which the parts of a thing share their factor, meters: the width of a chair.
const WIDTH_M: f32 = 0.5;
/// A smaller factor is not shared: depth shows something behind the thing. Depth of the worst validation set
/// is 2.4 times too far (`models/wnet_c.md`).
const MIN_SHARED: f32 = 0.4;

/// Where the camera is in this frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Viewpoint {
    /// In the floor plane, from the base's origin, meters.
    position_m: [f32; 2],
    /// Above the ground, meters.
    height_m: f32,
}

/// What a sector shows.
#[derive(Debug, Clone, Copy)]
struct Measured {
    /// How far ahead of the base's origin the camera is in this direction, meters.
    camera_m: f32,
    /// The distance of the nearest point from depth, meters; NaN if there is none.
    depth_m: f32,
    /// By which factor the place where a thing stands is nearer to the camera; 1 if it is not.
    factor: f32,
}

/// The place where a thing stands, for each sector. Allocates once.
#[derive(Debug, Clone)]
pub(super) struct Correction {
    min_height: Option<MinHeight>,
    found: Vec<Option<Contact>>,
    measured: Vec<Measured>,
}

impl Viewpoint {
    pub(super) fn new(camera: [f32; 3], ground: &Ground) -> Self {
        Self { position_m: [camera[0], camera[1]], height_m: ground.height_above(camera) }
    }
}

impl Measured {
    fn new(camera_m: f32, depth_m: f32, contact: Option<Contact>) -> Self {
        let is_nearer = |contact: &Contact| camera_m < contact.range_m && contact.range_m < depth_m;
        let ratio = |contact: Contact| (contact.range_m - camera_m) / (depth_m - camera_m);
        Self { camera_m, depth_m, factor: contact.filter(is_nearer).map_or(1.0, ratio) }
    }

    /// The distance from the base's origin after the correction, meters. A camera behind the origin may see
    /// something there.
    fn moved_m(self, factor: f32) -> f32 {
        let moved_m = self.camera_m + factor * (self.depth_m - self.camera_m);
        if moved_m < 0.0 { 0.0 } else { moved_m }
    }
}

impl Correction {
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

    /// Adds where things stand to the evidence of the sectors, and brings the obstacles beside them nearer
    /// that depth shows.
    pub(super) fn apply(
        &mut self,
        view: &View,
        votes: &[Votes],
        camera: Viewpoint,
        sectors: &mut [SectorEvidence],
    ) {
        let Some(min_height) = self.min_height else { return };
        self.find(min_height, view, votes, camera, sectors);
        for (index, sector) in sectors.iter_mut().enumerate() {
            let measured = self.measured[index];
            let stands_here = self.found[index]
                .is_some_and(|contact| take(sector, contact, gap(contact.range_m, view.cell_growth)));
            let factor = self.factor(index, view.sectors.angle_step_rad);
            let moved_m = measured.moved_m(factor);
            if let Some(obstacle) = &mut sector.obstacle
                && moved_m < obstacle.range_m
            {
                obstacle.range_m = moved_m;
                if !stands_here {
                    move_heights(obstacle, factor, camera.height_m);
                }
            }
        }
    }

    /// Finds where things stand, and compares that with depth.
    fn find(
        &mut self,
        min_height: MinHeight,
        view: &View,
        votes: &[Votes],
        Viewpoint { position_m: [x, y], .. }: Viewpoint,
        sectors: &[SectorEvidence],
    ) {
        let cells = (0..sectors.len()).map(|sector| view.cells_of(sector));
        self.found.clear();
        self.found.extend(cells.map(|cells| min_height.nearest(&view.cells[cells.clone()], &votes[cells])));
        self.measured.clear();
        self.measured.extend(sectors.iter().zip(&self.found).enumerate().map(
            |(index, (sector, contact))| {
                let [ahead_x, ahead_y] = view.sectors.middle(index);
                let depth_m = sector.obstacle.map_or(f32::NAN, |obstacle| obstacle.range_m);
                Measured::new(ahead_x * x + ahead_y * y, depth_m, *contact)
            },
        ));
    }

    /// The smallest factor of this sector, and of those beside it that show something about as far away.
    fn factor(&self, sector: usize, angle_step_rad: f32) -> f32 {
        let own = self.measured[sector];
        // Casts saturate, and NaN becomes 0.
        let reach = (WIDTH_M / (own.depth_m * angle_step_rad)) as usize;
        let end = sector.saturating_add(reach).saturating_add(1).min(self.measured.len());
        self.measured[sector.saturating_sub(reach)..end]
            .iter()
            .filter(|beside| (beside.depth_m - own.depth_m).abs() <= DEPTH_OF_OBSTACLE_M)
            .filter(|beside| beside.factor >= MIN_SHARED)
            .fold(own.factor, |factor, beside| beside.factor.min(factor))
    }
}

/// Takes a thing that the labels show, if no obstacle is nearer or about as far away, meters: depth is finer
/// than cells. Whether it was taken.
fn take(sector: &mut SectorEvidence, Contact { range_m, height_m, label }: Contact, gap_m: f32) -> bool {
    let is_new = sector.obstacle.is_none_or(|obstacle| obstacle.range_m > range_m + gap_m);
    if is_new {
        let thing = SeenObstacle { range_m, min_height_m: 0.0, max_height_m: height_m, label };
        sector.obstacle = Some(thing);
    }
    is_new
}

/// Heights of an obstacle that moves nearer to a camera at `camera_m` above ground, meters.
fn move_heights(obstacle: &mut SeenObstacle, factor: f32, camera_m: f32) {
    let moved = |height_m: f32| camera_m + factor * (height_m - camera_m);
    obstacle.min_height_m = moved(obstacle.min_height_m);
    obstacle.max_height_m = moved(obstacle.max_height_m);
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_RAD: f32 = 0.1;
    const NONE: f32 = f32::NAN;

    /// The factor of each sector, for these distances of points and of places where something stands.
    fn factors(seen: &[(f32, f32)]) -> Vec<f32> {
        let mount = Mount::new([0.0, 0.0, 0.5], [0.0; 3]).unwrap();
        let mut correction = Correction::new(&mount, &ObstacleOptions::default());
        correction.measured.extend(seen.iter().map(|&(depth_m, range_m)| measured(0.0, depth_m, range_m)));
        (0..seen.len()).map(|sector| correction.factor(sector, STEP_RAD)).collect()
    }

    fn measured(camera_m: f32, depth_m: f32, range_m: f32) -> Measured {
        let contact = Contact { range_m, height_m: 0.2, label: 3 };
        Measured::new(camera_m, depth_m, range_m.is_finite().then_some(contact))
    }

    #[test]
    fn a_seat_is_as_much_nearer_as_the_legs_beside_it() {
        let chair = [(2.0, 1.0), (2.1, NONE), (2.2, NONE), (2.0, 1.5), (2.0, NONE)];
        assert_eq!(factors(&chair), [0.5, 0.5, 0.5, 0.75, 0.75], "0.5 m are two sectors at 2 m");
        assert_eq!(factors(&[(2.0, 1.0), (2.5, NONE)]), [0.5, 1.0], "the wall behind it");
        assert_eq!(factors(&[(2.0, 1.0), (NONE, NONE)]), [0.5, 1.0], "nothing to move");
        assert_eq!(factors(&[(NONE, 1.0), (2.0, NONE)]), [1.0, 1.0], "no depth to compare with");
        assert_eq!(factors(&[(2.0, 2.5), (2.0, NONE)]), [1.0, 1.0], "never farther");
        assert_eq!(factors(&[(2.0, 0.5), (2.0, NONE)]), [0.25, 1.0], "depth shows what is behind the thing");
    }

    #[test]
    fn distances_shrink_toward_the_camera() {
        // The camera is 0.3 m ahead of the base's origin.
        let leg = measured(0.3, 0.8, 0.5);
        assert!((leg.factor - 0.4).abs() < 1e-6, "{leg:?}");
        assert!((measured(0.3, 1.0, NONE).moved_m(leg.factor) - 0.58).abs() < 1e-6);
        assert_eq!(measured(0.6, 0.8, 0.5).factor, 1.0, "behind the camera");
        assert_eq!(measured(-0.4, 0.3, NONE).moved_m(0.5), 0.0, "between the camera and the origin");
    }

    #[test]
    fn a_thing_counts_if_depth_shows_nothing_about_as_near() {
        let thing = Contact { range_m: 1.0, height_m: 0.2, label: 3 };
        let taken = SeenObstacle { range_m: 1.0, min_height_m: 0.0, max_height_m: 0.2, label: 3 };
        let of_depth =
            |range_m: f32| SeenObstacle { range_m, min_height_m: 0.3, max_height_m: 0.4, label: 7 };
        for (range_m, is_taken) in [(None, true), (Some(2.0), true), (Some(1.05), false), (Some(0.5), false)]
        {
            let before = SectorEvidence { obstacle: range_m.map(of_depth), deceptive_m: Some(3.0) };
            let mut sector = before;
            assert_eq!(take(&mut sector, thing, 0.1), is_taken);
            let expected = SectorEvidence { obstacle: Some(taken), ..before };
            assert_eq!(sector, if is_taken { expected } else { before });
        }
    }

    #[test]
    fn what_is_moved_stays_on_its_rays() {
        let mut seat = SeenObstacle { range_m: 1.0, min_height_m: 0.25, max_height_m: 0.75, label: 3 };
        move_heights(&mut seat, 0.5, 0.25);
        assert_eq!((seat.min_height_m, seat.max_height_m), (0.25, 0.5));
    }
}
