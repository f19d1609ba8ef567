//! Reduces points to one for each occupied cube of space.

use nunet_types::ObstaclePoint;

/// The initial length of a cube's edge, meters.
const EDGE_M: f32 = 0.05;
/// By how much edges grow while there are too many points.
const GROWTH: f32 = 1.5;
/// The largest edge. The cubes around the origin are never merged, so edges could grow without end.
const MAX_EDGE_M: f32 = 100.0;
/// The largest number of cubes while points are added; a power of two.
const CAPACITY: usize = 1 << 14;
/// Twice as many slots as cubes keep searches short.
const SLOTS: usize = 2 * CAPACITY;
/// A slot is a key in the upper 48 bits and the cube's index, which is less than `CAPACITY`, in the lower 16.
const EMPTY: u64 = u64::MAX;

/// The place of a cube: three numbers of 16 bits, in edges from the base's origin.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Key(u64);

/// The points of one cube.
#[derive(Debug, Clone, Copy)]
struct Cube {
    key: Key,
    /// Sums of x, y, z and height.
    sums: [f32; 4],
    confidence: f32,
    count: u32,
    label: u8,
}

/// Collects points into cubes. Allocates once, for any number of points.
#[derive(Debug, Clone)]
pub(super) struct Voxels {
    edge_m: f32,
    cubes: Vec<Cube>,
    /// The cubes before they are merged into larger ones.
    smaller: Vec<Cube>,
    /// A hash table with open addressing: a cube is in the slot of its key's hash, or in one of the next
    /// slots.
    slots: Vec<u64>,
}

impl Voxels {
    pub(super) fn new() -> Self {
        Self {
            edge_m: EDGE_M,
            cubes: Vec::with_capacity(CAPACITY),
            smaller: Vec::with_capacity(CAPACITY),
            slots: vec![EMPTY; SLOTS],
        }
    }

    pub(super) fn clear(&mut self) {
        self.edge_m = EDGE_M;
        self.remove_all();
    }

    /// Length of a cube's edge, meters. Grows when there are too many cubes.
    pub(super) fn edge_m(&self) -> f32 {
        self.edge_m
    }

    /// Adds a point (x, y, z, height) to the cube at `key`, which follows from the present length of edges.
    /// The point must be finite and within a kilometer. Returns the index of the cube; one of the `guesses`
    /// is probably the same one.
    #[inline]
    pub(super) fn add(
        &mut self,
        (key, guesses): (Key, [usize; 2]),
        point: [f32; 4],
        confidence: u8,
        label: impl FnOnce() -> u8,
    ) -> usize {
        for guess in guesses {
            if let Some(cube) = self.cubes.get_mut(guess)
                && cube.key == key
            {
                cube.add(point, f32::from(confidence), 1);
                return guess;
            }
        }
        let index = self.find_or_insert(key, label());
        self.cubes[index].add(point, f32::from(confidence), 1);
        while self.cubes.len() == CAPACITY {
            self.coarsen();
        }
        index
    }

    /// Writes at most `most` points to `out`: the mean of each cube. Makes the cubes larger until they are
    /// few enough.
    pub(super) fn take(&mut self, most: usize, out: &mut Vec<ObstaclePoint>) {
        while self.cubes.len() > most && self.edge_m < MAX_EDGE_M {
            self.coarsen();
        }
        out.clear();
        out.extend(self.cubes.iter().take(most).map(|cube| {
            let [x, y, z, height] = cube.sums.map(|sum| sum / cube.count as f32);
            // Rounded; `round` is a function call on processors without SSE 4.1.
            let confidence = (cube.confidence / cube.count as f32 + 0.5) as u8;
            ObstaclePoint { x, y, z, height, label: cube.label, confidence, reserved: [0; 2] }
        }));
    }

    /// The index of the cube at `key`. The label of its first point stays.
    fn find_or_insert(&mut self, key: Key, label: u8) -> usize {
        let mut slot = key.hash() % SLOTS;
        // This loop ends, because at most half of the slots are in use.
        while self.slots[slot] != EMPTY {
            if self.slots[slot] >> 16 == key.0 {
                return usize::from(self.slots[slot] as u16);
            }
            slot = (slot + 1) % SLOTS;
        }
        let index = self.cubes.len();
        self.slots[slot] = key.0 << 16 | index as u64;
        self.cubes.push(Cube { key, sums: [0.0; 4], confidence: 0.0, count: 0, label });
        index
    }

    /// Merges the cubes into larger ones.
    fn coarsen(&mut self) {
        self.edge_m *= GROWTH;
        std::mem::swap(&mut self.cubes, &mut self.smaller);
        self.remove_all();
        for index in 0..self.smaller.len() {
            let Cube { sums, confidence, count, label, .. } = self.smaller[index];
            let mean = [sums[0], sums[1], sums[2]].map(|sum| sum / count as f32);
            let index = self.find_or_insert(Key::at(mean, self.edge_m), label);
            self.cubes[index].add(sums, confidence, count);
        }
    }

    fn remove_all(&mut self) {
        self.cubes.clear();
        self.slots.fill(EMPTY);
    }
}

impl Cube {
    #[inline]
    fn add(&mut self, sums: [f32; 4], confidence: f32, count: u32) {
        for (sum, more) in self.sums.iter_mut().zip(sums) {
            *sum += more;
        }
        self.confidence += confidence;
        self.count += count;
    }
}

impl Key {
    /// The key of a point, for cubes of an edge. Both in meters.
    #[inline]
    pub(super) fn at([x, y, z]: [f32; 3], edge_m: f32) -> Self {
        let [x, y, z] = [floor(x / edge_m), floor(y / edge_m), floor(z / edge_m)];
        Self(u64::from(x) | u64::from(y) << 16 | u64::from(z) << 32)
    }

    /// A hash whose low bits are good.
    #[inline]
    fn hash(self) -> usize {
        (self.0.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as usize
    }
}

/// The lower 16 bits of the largest integer up to a number between ±2^21.
///
/// Adding this sum of powers of two rounds a number to the nearest integer, which is then in the lower bits.
/// `f32::floor` is a function call on processors without SSE 4.1, and conversions to integers check the
/// range; this is vectorized.
#[inline]
fn floor(value: f32) -> u16 {
    const TO_INTEGER: f32 = (3 << 22) as f32;
    let shifted = value + TO_INTEGER;
    let is_above = shifted - TO_INTEGER > value;
    shifted.to_bits().wrapping_sub(u32::from(is_above)) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point(x: f32, y: f32, z: f32, label: u8) -> ObstaclePoint {
        ObstaclePoint { x, y, z, height: z, label, confidence: 200, reserved: [0; 2] }
    }

    fn add(voxels: &mut Voxels, point: &ObstaclePoint) {
        let &ObstaclePoint { x, y, z, height, label, confidence, .. } = point;
        voxels.add((Key::at([x, y, z], voxels.edge_m()), [0; 2]), [x, y, z, height], confidence, || label);
    }

    #[test]
    fn points_of_a_cube_become_their_mean() {
        let mut voxels = Voxels::new();
        for point in [point(1.01, 0.01, 0.2, 3), point(2.0, -1.0, 0.5, 7), point(1.03, 0.03, 0.2, 3)] {
            add(&mut voxels, &point);
        }
        let mut out = Vec::new();
        voxels.take(100, &mut out);
        assert_eq!(out.len(), 2);
        assert!((out[0].x - 1.02).abs() < 1e-6 && (out[0].y - 0.02).abs() < 1e-6, "{:?}", out[0]);
        assert_eq!((out[0].label, out[0].confidence, out[1].label), (3, 200, 7));
        voxels.clear();
        voxels.take(100, &mut out);
        assert_eq!(out, []);
    }

    #[test]
    fn cubes_grow_until_all_fit() {
        let mut voxels = Voxels::new();
        for index in 0..60_000_u32 {
            let [x, y, z] = [index % 100, index / 100 % 100, index / 10_000].map(|i| i as f32 * 0.06 - 3.0);
            add(&mut voxels, &point(x, y, z, 0));
        }
        let mut out = Vec::new();
        voxels.take(300, &mut out);
        assert!((50..=300).contains(&out.len()), "{}", out.len());
    }

    proptest! {
        #[test]
        fn floor_is_the_one_of_the_library(value in prop_oneof![-3e4..3e4f32, -3.0..3.0f32, -1e-30..1e-30f32]) {
            prop_assert_eq!(floor(value), value.floor() as i16 as u16);
            prop_assert_eq!(floor(value.trunc()), value.trunc() as i16 as u16);
        }

        #[test]
        fn every_point_has_a_kept_point_near_it(
            points in prop::collection::vec((-5.0..5.0f32, -5.0..5.0f32, 0.0..2.0f32), 1..300), most in 1usize..60,
        ) {
            let mut voxels = Voxels::new();
            for &(x, y, z) in &points {
                add(&mut voxels, &point(x, y, z, 1));
            }
            let mut out = Vec::new();
            voxels.take(most, &mut out);
            prop_assert!((1..=most).contains(&out.len()));
            let reach = 4.0 * voxels.edge_m;
            for (x, y, z) in points {
                let nearest = out.iter().map(|kept| {
                    ((kept.x - x).powi(2) + (kept.y - y).powi(2) + (kept.z - z).powi(2)).sqrt()
                });
                prop_assert!(nearest.fold(f32::INFINITY, f32::min) <= reach);
            }
        }
    }
}
