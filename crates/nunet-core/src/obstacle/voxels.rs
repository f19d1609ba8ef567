//! Fewer points: one for each occupied cube of space.

use nunet_types::ObstaclePoint;

/// Length of a cube's edge at first, meters.
const EDGE_M: f32 = 0.05;
/// By how much edges grow while there are too many points.
const GROWTH: f32 = 1.5;
/// Edges end to grow here: the cubes around the origin are never merged.
const MAX_EDGE_M: f32 = 100.0;
/// Cubes at most while points are added; a power of two.
const CAPACITY: usize = 1 << 14;
/// Twice as many slots as cubes keep searches short.
const SLOTS: usize = 2 * CAPACITY;
const EMPTY: u32 = u32::MAX;

/// The points of one cube.
#[derive(Debug, Clone, Copy)]
struct Cube {
    key: [i16; 3],
    label: u8,
    count: u32,
    /// Sums of x, y, z, height and confidence.
    sums: [f32; 5],
}

/// Collects points into cubes. Allocates once, for any number of points.
#[derive(Debug, Clone)]
pub(super) struct Voxels {
    edge_m: f32,
    cubes: Vec<Cube>,
    /// The cubes before they are merged into larger ones.
    smaller: Vec<Cube>,
    /// Indices into `cubes`, found by a hash of the key and the next slots.
    slots: Vec<u32>,
    last: usize,
}

impl Voxels {
    pub(super) fn new() -> Self {
        Self {
            edge_m: EDGE_M,
            cubes: Vec::with_capacity(CAPACITY),
            smaller: Vec::with_capacity(CAPACITY),
            slots: vec![EMPTY; SLOTS],
            last: 0,
        }
    }

    pub(super) fn clear(&mut self) {
        self.edge_m = EDGE_M;
        self.cubes.clear();
        self.slots.fill(EMPTY);
    }

    /// Adds a point, which must be finite.
    #[inline]
    pub(super) fn add(&mut self, point: &ObstaclePoint) {
        let &ObstaclePoint { x, y, z, height, label, confidence, .. } = point;
        let sums = [x, y, z, height, f32::from(confidence)];
        self.merge(&Cube { key: [0; 3], label, count: 1, sums });
        while self.cubes.len() == CAPACITY {
            self.coarsen();
        }
    }

    /// Writes at most `most` points to `out`: the mean of each cube. Makes the cubes larger until they are few enough.
    pub(super) fn take(&mut self, most: usize, out: &mut Vec<ObstaclePoint>) {
        while self.cubes.len() > most && self.edge_m < MAX_EDGE_M {
            self.coarsen();
        }
        out.clear();
        out.extend(self.cubes.iter().take(most).map(|cube| {
            let [x, y, z, height, confidence] = cube.sums.map(|sum| sum / cube.count as f32);
            let confidence = confidence.round() as u8;
            ObstaclePoint { x, y, z, height, label: cube.label, confidence, reserved: [0; 2] }
        }));
    }

    /// Adds the points of another cube to the one at their mean. The label of the first point stays.
    #[inline]
    fn merge(&mut self, other: &Cube) {
        let key = [0, 1, 2].map(|axis| {
            let mean = other.sums[axis] / other.count as f32;
            (mean / self.edge_m).floor() as i16
        });
        let index = match self.cubes.get(self.last) {
            // Neighboring pixels mostly see the same cube.
            Some(last) if last.key == key => self.last,
            _ => self.find_or_insert(key, other.label),
        };
        self.last = index;
        let cube = &mut self.cubes[index];
        cube.count += other.count;
        for (sum, more) in cube.sums.iter_mut().zip(other.sums) {
            *sum += more;
        }
    }

    fn find_or_insert(&mut self, key: [i16; 3], label: u8) -> usize {
        let mut slot = hash(key) % SLOTS;
        // Ends, because at most half of the slots are in use.
        while self.slots[slot] != EMPTY {
            let index = self.slots[slot] as usize;
            if self.cubes[index].key == key {
                return index;
            }
            slot = (slot + 1) % SLOTS;
        }
        self.slots[slot] = self.cubes.len() as u32;
        self.cubes.push(Cube { key, label, count: 0, sums: [0.0; 5] });
        self.cubes.len() - 1
    }

    /// Merges the cubes into larger ones.
    fn coarsen(&mut self) {
        self.edge_m *= GROWTH;
        std::mem::swap(&mut self.cubes, &mut self.smaller);
        self.cubes.clear();
        self.slots.fill(EMPTY);
        for index in 0..self.smaller.len() {
            let cube = self.smaller[index];
            self.merge(&cube);
        }
    }
}

/// A hash of a key, whose low bits are good.
#[inline]
fn hash([x, y, z]: [i16; 3]) -> usize {
    let packed = u64::from(x as u16) | u64::from(y as u16) << 16 | u64::from(z as u16) << 32;
    (packed.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point(x: f32, y: f32, z: f32, label: u8) -> ObstaclePoint {
        ObstaclePoint { x, y, z, height: z, label, confidence: 200, reserved: [0; 2] }
    }

    #[test]
    fn points_of_a_cube_become_their_mean() {
        let mut voxels = Voxels::new();
        for point in [point(1.01, 0.01, 0.2, 3), point(2.0, -1.0, 0.5, 7), point(1.03, 0.03, 0.2, 3)] {
            voxels.add(&point);
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
            voxels.add(&point(x, y, z, 0));
        }
        let mut out = Vec::new();
        voxels.take(300, &mut out);
        assert!((50..=300).contains(&out.len()), "{}", out.len());
    }

    proptest! {
        #[test]
        fn every_point_has_a_kept_point_near_it(
            points in prop::collection::vec((-5.0..5.0f32, -5.0..5.0f32, 0.0..2.0f32), 1..300), most in 1usize..60,
        ) {
            let mut voxels = Voxels::new();
            for &(x, y, z) in &points {
                voxels.add(&point(x, y, z, 1));
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
