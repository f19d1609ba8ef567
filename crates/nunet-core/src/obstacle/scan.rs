//! Classifies all samples in one pass, and counts what each cell of the floor shows.

use super::Ground;
use super::kind::{Bounds, SampleKind};
use super::sectors::NONE;
use super::view::View;
use crate::depth::DepthImage;
use crate::label_roles::{Role, Roles};

/// Neighbors whose depth differs by less than this share lie on the same surface.
const SAME_SURFACE: f32 = 0.05;
/// If the steps to both neighbors of a line are larger than this share and have the same direction, the
/// sample is on a blurred depth edge.
const FLYING_STEP: f32 = 0.06;
/// Depth of this confidence is right within 5 %. It is trusted more than labels.
const CERTAIN: u8 = 227;
/// Neighbors on the same surface that a sample needs.
const MIN_SUPPORT: u32 = 2;

/// The samples of a cell of the floor.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Votes {
    pub(super) floor: u32,
    pub(super) drop: u32,
    /// Labeled as a thing, which is neither floor nor deceptive, with depth that is not certain.
    pub(super) other: u32,
    /// The label of one of these.
    pub(super) label: u8,
    /// The square of the distance of its farthest floor, square meters.
    pub(super) far_squared: f32,
}

/// The samples of one frame. Allocates once.
///
/// Works row by row, in loops without branches over slices of the same length, because these are vectorized.
#[derive(Debug, Clone)]
pub(super) struct Scan {
    /// Depth of each sample, meters, with a border of NaN, so that samples at the edge have four neighbors
    /// too.
    depth_m: Vec<f32>,
    pub(super) votes: Vec<Votes>,
    pub(super) line: Line,
    /// The camera's position in the base frame, meters.
    pub(super) camera: [f32; 3],
    columns: usize,
    rows: usize,
}

/// The values of the current row.
#[derive(Debug, Clone)]
pub(super) struct Line {
    pub(super) kinds: Vec<SampleKind>,
    /// x, y, z in the base frame, and height above ground, meters. In one array, because the cubes need all
    /// four.
    pub(super) points: Vec<[f32; 4]>,
    /// The squares of the distances from the base's origin, square meters.
    pub(super) ranges_squared: Vec<f32>,
    roles: Vec<Role>,
}

impl Scan {
    pub(super) fn new(view: &View, camera: [f64; 3]) -> Self {
        let View { columns, rows, .. } = *view;
        Self {
            depth_m: vec![f32::NAN; (columns + 2) * (rows + 2)],
            votes: vec![Votes::default(); view.cells.len()],
            line: Line {
                kinds: vec![SampleKind::Nothing; columns],
                points: vec![[f32::NAN; 4]; columns],
                ranges_squared: vec![f32::NAN; columns],
                roles: vec![Role::Other; columns],
            },
            camera: camera.map(|value| value as f32),
            columns,
            rows,
        }
    }

    /// Takes another mount of the same camera.
    pub(super) fn set_mount(&mut self, view: &View, camera: [f64; 3]) {
        self.votes.resize(view.cells.len(), Votes::default());
        self.camera = camera.map(|value| value as f32);
    }

    /// Takes the samples' depth from the image.
    pub(super) fn gather(&mut self, image: &DepthImage<'_>, view: &View) {
        let rows = image.depth_m.chunks_exact(view.width).step_by(view.stride);
        for (samples, row) in self.depth_m.chunks_exact_mut(self.columns + 2).skip(1).zip(rows) {
            gather_row(&mut samples[1..=self.columns], row, view.stride, valid);
        }
    }

    /// The point of a sample in the base frame.
    #[inline]
    pub(super) fn point(&self, view: &View, row: usize, column: usize) -> [f32; 3] {
        let depth = self.depth_m[(row + 1) * (self.columns + 2) + 1 + column];
        let index = row * self.columns + column;
        [0, 1, 2].map(|axis| self.camera[axis] + depth * view.directions[axis][index])
    }

    /// Begins a frame.
    pub(super) fn start(&mut self) {
        self.votes.fill(Votes::default());
    }

    /// Classifies each sample of a row, and counts the votes of the cells. Returns whether any sample is
    /// solid.
    pub(super) fn classify_row(
        &mut self,
        row: usize,
        image: &DepthImage<'_>,
        view: &View,
        (roles, bounds): (&Roles, &Bounds),
    ) -> bool {
        self.measure_row(row, view, &bounds.ground);
        self.find_roles(row, view, image.labels, roles);
        self.find_kinds(row, bounds);
        // Other rows look at no cell.
        if view.floor_rows.contains(&row) {
            self.vote(row, view);
            if roles.has_floor {
                self.vote_things(row, image, view);
            }
        }
        let has_solid = self.line.kinds.iter().any(|kind| kind.is_solid());
        if has_solid {
            self.remove_unsupported(row);
        }
        has_solid
    }

    /// The points and distances of a row.
    #[allow(clippy::needless_range_loop, reason = "several slices at once; zips are not vectorized as well")]
    fn measure_row(&mut self, row: usize, view: &View, ground: &Ground) {
        let columns = self.columns;
        let [camera_x, camera_y, camera_z] = self.camera;
        let directions = view.directions.each_ref().map(|axis| &axis[row * columns..][..columns]);
        let depth_m = &self.depth_m[(row + 1) * (columns + 2) + 1..][..columns];
        let points = &mut self.line.points[..columns];
        let ranges_squared = &mut self.line.ranges_squared[..columns];
        for i in 0..columns {
            let x = camera_x + depth_m[i] * directions[0][i];
            let y = camera_y + depth_m[i] * directions[1][i];
            let z = camera_z + depth_m[i] * directions[2][i];
            points[i] = [x, y, z, ground.height_above([x, y, z])];
            ranges_squared[i] = x * x + y * y;
        }
    }

    /// The roles of a row; without labels all are [`Role::Other`].
    fn find_roles(&mut self, row: usize, view: &View, labels: Option<&[u8]>, roles: &Roles) {
        let Some(labels) = labels else {
            self.line.roles.fill(Role::Other);
            return;
        };
        let labels = &labels[row * view.stride * view.width..][..view.width];
        gather_row(&mut self.line.roles, labels, view.stride, |label| roles.of(label));
    }

    #[allow(clippy::needless_range_loop, reason = "several slices at once; zips are not vectorized as well")]
    fn find_kinds(&mut self, row: usize, bounds: &Bounds) {
        let columns = self.columns;
        let depth_m = &self.depth_m[(row + 1) * (columns + 2) + 1..][..columns];
        let Line { kinds, points, ranges_squared, roles } = &mut self.line;
        let (kinds, points) = (&mut kinds[..columns], &points[..columns]);
        let (ranges_squared, roles) = (&ranges_squared[..columns], &roles[..columns]);
        for i in 0..columns {
            kinds[i] = bounds.kind(points[i][3], depth_m[i], ranges_squared[i], roles[i]);
        }
    }

    /// Counts the votes of a row.
    fn vote(&mut self, row: usize, view: &View) {
        let cells = &view.cell_of[row * self.columns..][..self.columns];
        let samples = self.line.kinds.iter().zip(cells).zip(&self.line.ranges_squared);
        for ((&kind, &cell), &range_squared) in samples {
            if cell != NONE {
                let votes = &mut self.votes[cell as usize];
                let is_floor = kind == SampleKind::Floor;
                votes.floor += u32::from(is_floor);
                votes.drop += u32::from(kind == SampleKind::Drop);
                if is_floor & (range_squared > votes.far_squared) {
                    votes.far_squared = range_squared;
                }
            }
        }
    }

    /// Counts the votes of a row's labels, where depth is not certain. Without labels or confidence there are
    /// none.
    fn vote_things(&mut self, row: usize, image: &DepthImage<'_>, view: &View) {
        let (Some(labels), Some(confidence)) = (image.labels, image.confidence) else { return };
        let line = row * view.stride * view.width..(row * view.stride + 1) * view.width;
        let labels = labels[line.clone()].iter().step_by(view.stride);
        let seen = labels.zip(confidence[line].iter().step_by(view.stride));
        let cells = &view.cell_of[row * self.columns..][..self.columns];
        for ((&role, &cell), (&label, &confidence)) in self.line.roles.iter().zip(cells).zip(seen) {
            if (role == Role::Other) & (cell != NONE) & (confidence < CERTAIN) {
                let votes = &mut self.votes[cell as usize];
                (votes.other, votes.label) = (votes.other + 1, label);
            }
        }
    }

    /// Removes samples from the obstacles that do not lie on a surface: those with too few neighbors of
    /// almost the same depth, and those on a blurred edge between a near and a far surface.
    #[allow(clippy::needless_range_loop, reason = "several slices at once; zips are not vectorized as well")]
    fn remove_unsupported(&mut self, row: usize) {
        let (columns, pitch) = (self.columns, self.columns + 2);
        let depth_m = |row: usize, column: usize| &self.depth_m[row * pitch + column..][..columns];
        let (above, below) = (depth_m(row, 1), depth_m(row + 2, 1));
        let (left, here, right) = (depth_m(row + 1, 0), depth_m(row + 1, 1), depth_m(row + 1, 2));
        let kinds = &mut self.line.kinds[..columns];
        for i in 0..columns {
            // One division for four steps.
            let share = 1.0 / here[i];
            let steps = [left[i], right[i], above[i], below[i]].map(|depth| (depth - here[i]) * share);
            if kinds[i].is_solid() & !is_supported(steps) {
                kinds[i] = SampleKind::Nothing;
            }
        }
    }

    /// The share of all samples that show floor.
    pub(super) fn floor_fraction(&self) -> f32 {
        let floor: u32 = self.votes.iter().map(|votes| votes.floor).sum();
        floor as f32 / (self.rows * self.columns).max(1) as f32
    }
}

/// Takes the first of each `stride` pixels. The usual strides are constants, because that is vectorized.
#[inline]
fn gather_row<P: Copy, S>(samples: &mut [S], row: &[P], stride: usize, sample_of: impl Fn(P) -> S) {
    match stride {
        1 => gather_chunks::<1, _, _>(samples, row, sample_of),
        2 => gather_chunks::<2, _, _>(samples, row, sample_of),
        _ => {
            for (sample, &pixel) in samples.iter_mut().zip(row.iter().step_by(stride)) {
                *sample = sample_of(pixel);
            }
        }
    }
}

#[inline]
fn gather_chunks<const STRIDE: usize, P: Copy, S>(samples: &mut [S], row: &[P], sample_of: impl Fn(P) -> S) {
    let (chunks, rest) = row.as_chunks::<STRIDE>();
    for (sample, chunk) in samples.iter_mut().zip(chunks) {
        *sample = sample_of(chunk[0]);
    }
    if let (Some(sample), Some(&pixel)) = (samples.get_mut(chunks.len()), rest.first()) {
        *sample = sample_of(pixel);
    }
}

/// A depth, or NaN.
#[inline]
fn valid(depth: f32) -> f32 {
    // False for NaN.
    if (depth > 0.0) & (depth < f32::INFINITY) { depth } else { f32::NAN }
}

/// Whether a sample lies on a surface, from the relative steps of depth to its neighbors: left, right, above,
/// below.
#[inline]
fn is_supported(steps: [f32; 4]) -> bool {
    let [left, right, above, below] = steps;
    let support: u32 = steps.iter().map(|step| u32::from(step.abs() < SAME_SURFACE)).sum();
    (support >= MIN_SUPPORT) & !flies(left, right) & !flies(above, below)
}

/// Whether a line of three samples crosses a blurred depth edge.
#[inline]
fn flies(before: f32, after: f32) -> bool {
    // False for NaN: a step to nothing is not small.
    let is_small = |step: f32| step.abs() <= FLYING_STEP;
    !is_small(before) & !is_small(after) & ((before > 0.0) != (after > 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAN: f32 = f32::NAN;

    #[test]
    fn every_stride_takes_the_first_pixels_and_the_last_column() {
        let row = [1.0, -2.0, 3.0, f32::INFINITY, 5.0];
        let mut samples = [9.0; 5];
        gather_row(&mut samples, &row, 1, valid);
        assert_eq!(samples.map(f32::to_bits), [1.0, NAN, 3.0, NAN, 5.0].map(f32::to_bits));
        let mut samples = [9.0; 3];
        gather_row(&mut samples, &row, 2, valid);
        assert_eq!(samples, [1.0, 3.0, 5.0]);
        let mut samples = [9.0; 2];
        gather_row(&mut samples, &row[..4], 2, valid);
        assert_eq!(samples, [1.0, 3.0]);
    }

    #[test]
    fn a_sample_needs_two_neighbors_and_must_not_be_on_a_slope() {
        assert!(is_supported([0.0, 0.0, 0.0, 0.0]));
        assert!(is_supported([0.04, NAN, -0.04, NAN]), "a corner");
        assert!(!is_supported([0.04, NAN, NAN, NAN]), "isolated");
        assert!(!is_supported([-0.1, 0.1, 0.0, 0.0]), "between a near and a far surface");
        assert!(is_supported([0.1, 0.1, 0.0, 0.0]), "a thin object before a far one");
    }
}
