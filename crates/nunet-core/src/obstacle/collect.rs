//! Collects the samples of obstacles, as hits for the sectors and as reduced points.

use nunet_types::NO_LABEL;

use super::hits::Hits;
use super::kind::SampleKind;
use super::scan::Line;
use super::view::View;
use super::voxels::{Key, Voxels};
use crate::depth::DepthImage;

/// Collects the samples of obstacles. Allocates once.
#[derive(Debug, Clone)]
pub(super) struct Collector {
    pub(super) hits: Hits,
    pub(super) voxels: Voxels,
    /// The cube of each point of a row.
    keys: Vec<Key>,
    /// Distances from the base's origin of the points of a row, meters.
    ranges_m: Vec<f32>,
    /// For each column, the cube of its last point. The next point below is mostly in the same cube, or in
    /// that of the point to its left.
    last_cubes: Vec<usize>,
}

impl Collector {
    pub(super) fn new(view: &View) -> Self {
        let columns = view.columns;
        Self {
            hits: Hits::new(columns * view.rows, view.sectors.count()),
            voxels: Voxels::new(),
            keys: vec![Key::default(); columns],
            ranges_m: vec![f32::NAN; columns],
            last_cubes: vec![0; columns],
        }
    }

    /// Begins a frame.
    pub(super) fn start(&mut self) {
        self.hits.start();
        self.voxels.clear();
    }

    /// Collects the solid samples of a row.
    pub(super) fn collect_row(&mut self, row: usize, line: &Line, image: &DepthImage<'_>, view: &View) {
        let columns = view.columns;
        let Self { hits, voxels, keys, ranges_m, last_cubes } = self;
        // Slices of one length, so that the loop over columns checks no bounds.
        let (keys, ranges_m, last_cubes) =
            (&mut keys[..columns], &mut ranges_m[..columns], &mut last_cubes[..columns]);
        let (kinds, points) = (&line.kinds[..columns], &line.points[..columns]);
        let sectors = &view.sector_of[row * columns..][..columns];
        let mut edge_m = voxels.edge_m();
        find_keys(keys, points, edge_m);
        find_ranges(ranges_m, &line.ranges_squared);
        let mut left_cube = 0;
        for column in (0..columns).filter(|&column| kinds[column].is_solid()) {
            let point @ [x, y, _, height_m] = points[column];
            let sector = view.sectors.find([x, y], sectors[column]);
            if kinds[column] == SampleKind::Deceptive {
                hits.add_deceptive(sector, ranges_m[column]);
                continue;
            }
            let label = || image.label(view, row, column).unwrap_or(NO_LABEL);
            hits.add(sector, [ranges_m[column], height_m], label);
            if voxels.edge_m() != edge_m {
                edge_m = voxels.edge_m();
                find_keys(keys, points, edge_m);
            }
            let confidence = image.confidence(view, row, column);
            left_cube = voxels.add((keys[column], [last_cubes[column], left_cube]), point, confidence, label);
            last_cubes[column] = left_cube;
        }
    }
}

/// Computes the key of each point, for cubes with this edge. Takes a whole row, because this loop is
/// vectorized.
fn find_keys(keys: &mut [Key], points: &[[f32; 4]], edge_m: f32) {
    for (key, &[x, y, z, _]) in keys.iter_mut().zip(points) {
        *key = Key::at([x, y, z], edge_m);
    }
}

/// Computes the distances of a whole row, because this loop is vectorized.
fn find_ranges(ranges_m: &mut [f32], ranges_squared: &[f32]) {
    for (range_m, range_squared) in ranges_m.iter_mut().zip(ranges_squared) {
        *range_m = range_squared.sqrt();
    }
}
