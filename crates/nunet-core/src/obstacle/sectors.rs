//! The directions that the points of samples are sorted into.

use std::f32::consts::TAU;

/// The point of a sample at depth 1, relative to the camera, in the base frame; NaN for a pixel without a ray.
pub(super) type Direction = [f32; 3];

/// A sample without a cell, or without a sector.
pub(super) const NONE: u32 = u32::MAX;

/// The length of a vector. Nothing overflows at the scale of rooms, and it is several times faster than `hypot`.
#[inline]
pub(super) fn length(x: f32, y: f32) -> f32 {
    (x * x + y * y).sqrt()
}

/// The directions of the sectors.
#[derive(Debug, Clone)]
pub(super) struct Sectors {
    pub(super) angle_min_rad: f32,
    pub(super) angle_step_rad: f32,
    /// Unit vectors of the boundaries, one more than sectors.
    boundaries: Vec<[f32; 2]>,
}

impl Sectors {
    pub(super) fn new(angle_min_rad: f32, angle_max_rad: f32, count: usize) -> Self {
        let boundaries = vec![[0.0; 2]; count + 1];
        let mut sectors = Self { angle_min_rad, angle_step_rad: 0.0, boundaries };
        sectors.set_angles(angle_min_rad, angle_max_rad);
        sectors
    }

    /// Takes other angles for the same number of sectors. Allocates nothing.
    pub(super) fn set_angles(&mut self, angle_min_rad: f32, angle_max_rad: f32) {
        let angle_step_rad = (angle_max_rad - angle_min_rad) / self.count() as f32;
        for (index, boundary) in self.boundaries.iter_mut().enumerate() {
            let (sin, cos) = (angle_min_rad + index as f32 * angle_step_rad).sin_cos();
            *boundary = [cos, sin];
        }
        (self.angle_min_rad, self.angle_step_rad) = (angle_min_rad, angle_step_rad);
    }

    pub(super) fn count(&self) -> usize {
        self.boundaries.len() - 1
    }

    /// The direction of the middle of a sector.
    pub(super) fn middle(&self, sector: usize) -> [f32; 2] {
        let (sin, cos) = (self.angle_min_rad + (sector as f32 + 0.5) * self.angle_step_rad).sin_cos();
        [cos, sin]
    }

    /// The sector of a direction, computed; [`NONE`] outside the field of view.
    pub(super) fn at(&self, x: f32, y: f32) -> u32 {
        let angle = (y.atan2(x) - self.angle_min_rad).rem_euclid(TAU);
        let index = (angle / self.angle_step_rad) as usize;
        if index < self.count() { index as u32 } else { NONE }
    }

    /// The sector of a point. Tries `guess` first, which is almost always right and needs no arc tangent.
    #[inline]
    pub(super) fn find(&self, [x, y]: [f32; 2], guess: u32) -> u32 {
        let index = guess as usize;
        if index < self.count() {
            let left_of = |[cos, sin]: [f32; 2]| cos * y - sin * x >= 0.0;
            let ahead = self.boundaries[index][0] * x + self.boundaries[index][1] * y > 0.0;
            if ahead & left_of(self.boundaries[index]) & !left_of(self.boundaries[index + 1]) {
                return guess;
            }
        }
        self.at(x, y)
    }
}
