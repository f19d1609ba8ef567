//! The ground: a plane near the expected one.
//!
//! The mount says where the floor is. This module corrects small deviations, such as vibration, a soft tire
//! or a ramp. Candidates are the samples near the expected floor (labeled floor, if there are labels). A
//! plane is fitted by iteratively reweighted least squares (Tukey's weights) while the gate shrinks. A weak
//! prior pulls towards the expected plane if the candidates do not determine the plane. A result that is too
//! steep, too far off, or has too few inliers is rejected, and the expected plane is used. So the plane
//! cannot lock onto a table.

use nalgebra::{Matrix3, Vector3};

use super::ObstacleOptions;
use crate::camera::Mount;

/// The largest number of candidates.
pub(super) const MAX_CANDIDATES: usize = 4096;
/// With fewer candidates, no plane is fitted.
const MIN_CANDIDATES: usize = 40;
const ROUNDS: i32 = 6;
/// The first gate: meters, and meters per meter of distance.
const GATE_M: f32 = 0.05;
const GATE_SLOPE: f32 = 0.07;
/// Scatter of the floor's height, meters: at least this, and this share of the camera's height (a depth that
/// is wrong by a share moves a floor point by the same share of the camera's height).
const SCATTER_M: f32 = 0.01;
const SCATTER_SHARE: f32 = 0.02;
/// The prior: standard deviations of slope and height.
const PRIOR_SLOPE: f64 = 0.05;
const PRIOR_HEIGHT_M: f64 = 0.05;
/// Inliers must be this share of the candidates.
const MIN_INLIERS: f32 = 0.3;
/// How far the plane may be off at the base's origin: meters, and share of the camera's height.
const MAX_OFFSET_M: f32 = 0.05;
const MAX_OFFSET_SHARE: f32 = 0.1;
/// A ground that is tilted by more, 5 degrees, is not the floor that the mount expects, radians.
const EXPECTED_TILT_RAD: f32 = 0.087;

/// The ground in the base frame: `z = slope_x * x + slope_y * y + height_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// Rise per meter forward.
    pub slope_x: f32,
    /// Rise per meter to the left.
    pub slope_y: f32,
    /// Height at the base's origin, meters.
    pub height_m: f32,
    /// Whether it was measured in this frame; if not, it is the expected plane `z = 0`.
    pub is_refined: bool,
    /// The share of the image that shows floor at its place, 0 to 1.
    pub floor_fraction: f32,
}

impl Ground {
    /// The plane that follows from the mount.
    pub const EXPECTED: Self =
        Self { slope_x: 0.0, slope_y: 0.0, height_m: 0.0, is_refined: false, floor_fraction: 0.0 };

    /// Meters above the ground of a point of the base frame.
    #[must_use]
    pub fn height_above(&self, [x, y, z]: [f32; 3]) -> f32 {
        z - self.slope_x * x - self.slope_y * y - self.height_m
    }

    /// Its angle to the expected plane, radians.
    #[must_use]
    pub fn tilt_rad(&self) -> f32 {
        self.slope_x.hypot(self.slope_y).atan()
    }

    /// Whether it may be the floor that the mount expects, and not a ramp or the floor of another mount.
    #[must_use]
    pub fn is_near_expected(&self) -> bool {
        self.tilt_rad() <= EXPECTED_TILT_RAD
    }
}

/// Fits the ground of each frame. Allocates once.
#[derive(Debug, Clone)]
pub(super) struct GroundFit {
    camera_height_m: f32,
    max_slope: f32,
    candidates: Vec<Candidate>,
    /// The weight of each candidate in the current round, 0 to 1.
    weights: Vec<f32>,
}

/// How far a point may be from the plane.
#[derive(Debug, Clone, Copy)]
struct Gate {
    scatter_m: f32,
    shrunk: f32,
}

impl Gate {
    #[inline]
    fn at(self, distance_m: f32) -> f32 {
        self.scatter_m + self.shrunk * (GATE_M + GATE_SLOPE * distance_m)
    }
}

/// A point that may be ground.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    point: [f32; 3],
    /// From the base's origin along the floor, meters. Used in each round.
    distance_m: f32,
}

impl GroundFit {
    pub(super) fn new(mount: &Mount, options: &ObstacleOptions) -> Self {
        Self {
            camera_height_m: mount.height_m() as f32,
            max_slope: options.max_slope_deg.to_radians().tan(),
            candidates: Vec::with_capacity(MAX_CANDIDATES),
            weights: Vec::with_capacity(MAX_CANDIDATES),
        }
    }

    /// Takes another mount of the same camera.
    pub(super) fn set_mount(&mut self, mount: &Mount) {
        self.camera_height_m = mount.height_m() as f32;
    }

    /// The typical error of a floor point's height, meters.
    pub(super) fn scatter_m(&self) -> f32 {
        SCATTER_M.max(SCATTER_SHARE * self.camera_height_m)
    }

    /// The ground of the points that may be floor. Takes the first [`MAX_CANDIDATES`] of them.
    pub(super) fn fit(&mut self, points: impl Iterator<Item = [f32; 3]>) -> Ground {
        let gate = self.gate(0);
        let measured = points.map(Candidate::new);
        let near = measured.filter(|candidate| candidate.point[2].abs() < gate.at(candidate.distance_m));
        self.candidates.clear();
        self.candidates.extend(near.take(MAX_CANDIDATES));
        if self.candidates.len() < MIN_CANDIDATES {
            return Ground::EXPECTED;
        }
        let mut ground = Ground::EXPECTED;
        for round in 0..ROUNDS {
            match self.solve(&ground, round) {
                Some(better) => ground = better,
                None => return Ground::EXPECTED,
            }
        }
        if self.is_plausible(&ground) { Ground { is_refined: true, ..ground } } else { Ground::EXPECTED }
    }

    fn gate(&self, round: i32) -> Gate {
        Gate { scatter_m: 3.0 * self.scatter_m(), shrunk: 0.5_f32.powi(round) }
    }

    /// One step of the reweighted least squares; `None` if there is no solution.
    fn solve(&mut self, ground: &Ground, round: i32) -> Option<Ground> {
        let gate = self.gate(round);
        // A loop of its own, because it is vectorized. The sums are not: another order would change their
        // rounding.
        self.weights.clear();
        self.weights.extend(self.candidates.iter().map(|&Candidate { point, distance_m }| {
            let share = ground.height_above(point) / gate.at(distance_m);
            let near = (1.0 - share * share).max(0.0);
            near * near
        }));
        let precision = 1.0 / f64::from(self.scatter_m()).powi(2);
        let prior = [PRIOR_SLOPE, PRIOR_SLOPE, PRIOR_HEIGHT_M].map(|deviation| deviation.powi(-2));
        // The normal matrix is symmetric; these are its different entries for the unknowns slope x, slope y
        // and height.
        let [mut xx, mut yy, mut hh] = prior;
        let [mut xy, mut xh, mut yh] = [0.0; 3];
        let mut right = [0.0; 3];
        for (candidate, &weight) in self.candidates.iter().zip(&self.weights) {
            let [x, y, z] = candidate.point.map(f64::from);
            let weight = precision * f64::from(weight);
            let [weighted_x, weighted_y, weighted_z] = [weight * x, weight * y, weight * z];
            xx += weighted_x * x;
            xy += weighted_y * x;
            yy += weighted_y * y;
            xh += weighted_x;
            yh += weighted_y;
            hh += weight;
            right[0] += weighted_z * x;
            right[1] += weighted_z * y;
            right[2] += weighted_z;
        }
        let normal = Matrix3::new(xx, xy, xh, xy, yy, yh, xh, yh, hh);
        let plane = normal.cholesky()?.solve(&Vector3::from(right));
        let [slope_x, slope_y, height_m] = [plane.x as f32, plane.y as f32, plane.z as f32];
        Some(Ground { slope_x, slope_y, height_m, ..*ground })
    }

    fn is_plausible(&self, ground: &Ground) -> bool {
        let gate = 3.0 * self.scatter_m();
        let inliers =
            self.candidates.iter().filter(|near| ground.height_above(near.point).abs() < gate).count();
        let max_offset_m = MAX_OFFSET_M + MAX_OFFSET_SHARE * self.camera_height_m;
        ground.slope_x.hypot(ground.slope_y) <= self.max_slope
            && ground.height_m.abs() <= max_offset_m
            && inliers as f32 >= MIN_INLIERS * self.candidates.len() as f32
    }
}

impl Candidate {
    fn new(point: [f32; 3]) -> Self {
        let [x, y] = [point[0], point[1]].map(f64::from);
        // In double precision nothing overflows, and it is faster than `hypot`.
        Self { point, distance_m: (x * x + y * y).sqrt() as f32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fit() -> GroundFit {
        let mount = Mount::new([0.0, 0.0, 0.5], [0.0; 3]).unwrap();
        GroundFit::new(&mount, &ObstacleOptions::default())
    }

    fn grid(count: usize) -> impl Iterator<Item = (f32, f32)> {
        (0..count * count).map(move |i| {
            let (row, column) = (i / count, i % count);
            (0.5 + 3.0 * row as f32 / count as f32, -1.0 + 2.0 * column as f32 / count as f32)
        })
    }

    #[test]
    fn a_tilted_floor_with_a_box_on_it_is_found() {
        let floor = grid(40).map(|(x, y)| [x, y, 0.03 * x - 0.02 * y + 0.01]);
        let box_on_it = grid(15).map(|(x, y)| [1.0 + 0.2 * x, 0.3 * y, 0.03 * (1.0 + 0.2 * x) + 0.15]);
        let ground = fit().fit(floor.chain(box_on_it));
        assert!(ground.is_refined);
        assert!((ground.slope_x - 0.03).abs() < 0.003 && (ground.slope_y + 0.02).abs() < 0.003, "{ground:?}");
        assert!((ground.height_m - 0.01).abs() < 0.005, "{ground:?}");
        assert!((ground.tilt_rad() - 0.036).abs() < 0.004, "{ground:?}");
    }

    #[test]
    fn a_table_is_not_ground_and_neither_is_a_wall() {
        let table = grid(40).map(|(x, y)| [x, y, 0.4]);
        assert_eq!(fit().fit(table), Ground::EXPECTED);
        let wall = grid(40).map(|(x, y)| [2.0, y, x - 0.5]);
        let ground = fit().fit(wall);
        let slope_deg = ground.slope_x.hypot(ground.slope_y).atan().to_degrees();
        assert!(slope_deg < 1.5 && ground.height_m.abs() < 0.02, "{ground:?}");
    }

    #[test]
    fn a_slope_beyond_the_limit_is_not_ground() {
        let options = ObstacleOptions { max_slope_deg: 2.0, ..ObstacleOptions::default() };
        let mount = Mount::new([0.0, 0.0, 0.5], [0.0; 3]).unwrap();
        let ramp = || grid(40).map(|(x, y)| [x, y, 0.06 * x]);
        assert_eq!(GroundFit::new(&mount, &options).fit(ramp()), Ground::EXPECTED);
        assert!(fit().fit(ramp()).is_refined);
    }

    #[test]
    fn few_points_leave_the_expected_plane() {
        assert_eq!(fit().fit(grid(6).map(|(x, y)| [x, y, 0.02])), Ground::EXPECTED);
        assert_eq!(fit().fit(std::iter::empty()), Ground::EXPECTED);
        assert_eq!(fit().fit(std::iter::repeat_n([f32::NAN; 3], 5000)), Ground::EXPECTED);
    }

    proptest! {
        #[test]
        fn every_plane_near_the_expected_one_is_found_through_noise_and_outliers(
            slope_x in -0.05..0.05f32, slope_y in -0.05..0.05f32, height in -0.03..0.03f32, seed in 0u32..1000,
        ) {
            let noise = |i: usize| ((i as u32).wrapping_mul(2_654_435_761).wrapping_add(seed) % 1000) as f32 / 1000.0;
            let points = grid(40).enumerate().map(|(i, (x, y))| {
                let outlier = if i % 5 == 0 { 0.3 * noise(3 * i) } else { 0.0 };
                [x, y, slope_x * x + slope_y * y + height + 0.01 * (noise(i) - 0.5) + outlier]
            });
            let ground = fit().fit(points);
            prop_assert!(ground.is_refined);
            prop_assert!((ground.slope_x - slope_x).abs() < 0.01, "{ground:?}");
            prop_assert!((ground.slope_y - slope_y).abs() < 0.01, "{ground:?}");
            prop_assert!((ground.height_m - height).abs() < 0.015, "{ground:?}");
        }
    }
}
