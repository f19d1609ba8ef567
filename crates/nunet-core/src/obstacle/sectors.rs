//! The directions that the points of samples are sorted into.

use std::f32::consts::TAU;

/// The point of a sample at depth 1, relative to the camera, in the base frame; NaN for a pixel without a
/// ray.
pub(super) type Direction = [f32; 3];

/// A sample without a cell, or without a sector.
pub(super) const NONE: u32 = u32::MAX;

/// The length of a vector. Nothing overflows at the scale of rooms, and it is several times faster than
/// `hypot`.
#[inline]
pub(super) fn length(x: f32, y: f32) -> f32 {
    (x * x + y * y).sqrt()
}

/// An angle within 0 to 2π. Mostly it is there already, and the remainder is a function call.
#[inline]
pub(super) fn within_turn(angle_rad: f32) -> f32 {
    if (0.0..TAU).contains(&angle_rad) { angle_rad } else { angle_rad.rem_euclid(TAU) }
}

pub(super) fn unit_vector(angle_rad: f32) -> [f32; 2] {
    let (sin, cos) = angle_rad.sin_cos();
    [cos, sin]
}

/// Whether the direction of a point is between two unit vectors, the right and the left one, and within a
/// quarter of a turn of the right one. Needs no arc tangent.
#[inline]
pub(super) fn is_between([x, y]: [f32; 2], [right, left]: [[f32; 2]; 2]) -> bool {
    let left_of = |[cos, sin]: [f32; 2]| cos * y - sin * x >= 0.0;
    let ahead = right[0] * x + right[1] * y > 0.0;
    ahead & left_of(right) & !left_of(left)
}

/// The directions of the sectors.
#[derive(Debug, Clone)]
pub(super) struct Sectors {
    pub(super) angle_min_rad: f32,
    pub(super) angle_step_rad: f32,
    /// Unit vectors of the right and the left boundary of each sector.
    boundaries: Vec<[[f32; 2]; 2]>,
}

impl Sectors {
    pub(super) fn new(angle_min_rad: f32, angle_max_rad: f32, count: usize) -> Self {
        let boundaries = vec![[[0.0; 2]; 2]; count];
        let mut sectors = Self { angle_min_rad, angle_step_rad: 0.0, boundaries };
        sectors.set_angles(angle_min_rad, angle_max_rad);
        sectors
    }

    /// Takes other angles for the same number of sectors. Allocates nothing.
    pub(super) fn set_angles(&mut self, angle_min_rad: f32, angle_max_rad: f32) {
        let angle_step_rad = (angle_max_rad - angle_min_rad) / self.count() as f32;
        for (sector, boundaries) in self.boundaries.iter_mut().enumerate() {
            *boundaries =
                [sector, sector + 1].map(|index| unit_vector(angle_min_rad + index as f32 * angle_step_rad));
        }
        (self.angle_min_rad, self.angle_step_rad) = (angle_min_rad, angle_step_rad);
    }

    pub(super) fn count(&self) -> usize {
        self.boundaries.len()
    }

    /// The direction of the middle of a sector.
    pub(super) fn middle(&self, sector: usize) -> [f32; 2] {
        unit_vector(self.angle_min_rad + (sector as f32 + 0.5) * self.angle_step_rad)
    }

    /// The sector of a direction, computed; [`NONE`] outside the field of view.
    pub(super) fn at(&self, x: f32, y: f32) -> u32 {
        let angle = within_turn(y.atan2(x) - self.angle_min_rad);
        let index = (angle / self.angle_step_rad) as usize;
        if index < self.count() { index as u32 } else { NONE }
    }

    /// The sector of a point. Tries `guess` first, which is almost always right and needs no arc tangent.
    #[inline]
    pub(super) fn find(&self, [x, y]: [f32; 2], guess: u32) -> u32 {
        match self.boundaries.get(guess as usize) {
            Some(&boundaries) if is_between([x, y], boundaries) => guess,
            _ => self.at(x, y),
        }
    }
}
