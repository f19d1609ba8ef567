//! Collects the samples of obstacles, as hits for the sectors and as reduced points.

use super::DepthImage;
use super::directions::Hit;
use super::kind::SampleKind;
use super::scan::Line;
use super::sectors::NONE;
use super::view::View;
use super::voxels::{Key, Voxels};

/// Collects the samples of obstacles. Allocates once.
#[derive(Debug, Clone)]
pub(super) struct Collector {
    /// Only the first `count` are of this frame.
    hits: Vec<Hit>,
    count: usize,
    pub(super) voxels: Voxels,
    /// The cube of each point of a row.
    keys: Vec<Key>,
    /// Distances from the base's origin of the points of a row, meters.
    ranges_m: Vec<f32>,
    /// The columns of a row's solid samples.
    solid: Vec<u16>,
    /// For each column, the cube of its last point. The next point below is mostly in the same cube.
    last_cubes: Vec<usize>,
}

impl Collector {
    pub(super) fn new(view: &View) -> Self {
        let columns = view.columns;
        Self {
            hits: vec![Hit::default(); columns * view.rows],
            count: 0,
            voxels: Voxels::new(),
            keys: vec![Key::default(); columns],
            ranges_m: vec![f32::NAN; columns],
            solid: vec![0; columns],
            last_cubes: vec![0; columns],
        }
    }

    /// Begins a frame.
    pub(super) fn start(&mut self) {
        self.count = 0;
        self.voxels.clear();
    }

    /// The samples of the frame, for the sectors.
    pub(super) fn hits(&self) -> &[Hit] {
        &self.hits[..self.count]
    }

    /// Collects the solid samples of a row.
    pub(super) fn collect_row(&mut self, row: usize, line: &Line, image: &DepthImage<'_>, view: &View) {
        let solid = self.find_solid(&line.kinds);
        self.add_points((row, solid), line, image, view);
        self.add_hits((row, solid), line, image, view);
    }

    /// Lists the columns of solid samples, without branches. Returns how many there are.
    fn find_solid(&mut self, kinds: &[SampleKind]) -> usize {
        let mut count = 0;
        for (kind, column) in kinds.iter().zip(0..) {
            self.solid[count] = column;
            count += usize::from(kind.is_solid());
        }
        count
    }

    fn add_points(&mut self, (row, solid): (usize, usize), line: &Line, image: &DepthImage<'_>, view: &View) {
        let Self { voxels, keys, last_cubes, .. } = self;
        let mut edge_m = voxels.edge_m();
        find_keys(keys, &line.points, edge_m);
        let columns = self.solid[..solid].iter().map(|&column| usize::from(column));
        for column in columns.filter(|&column| line.kinds[column] == SampleKind::Obstacle) {
            let label = image.label(view, row, column).unwrap_or(Hit::NO_LABEL);
            let confidence = image.confidence(view, row, column);
            if voxels.edge_m() != edge_m {
                edge_m = voxels.edge_m();
                find_keys(keys, &line.points, edge_m);
            }
            let guess = last_cubes[column];
            last_cubes[column] = voxels.add(keys[column], guess, line.points[column], (label, confidence));
        }
    }

    fn add_hits(&mut self, (row, solid): (usize, usize), line: &Line, image: &DepthImage<'_>, view: &View) {
        for (range_m, range_squared) in self.ranges_m.iter_mut().zip(&line.ranges_squared) {
            *range_m = range_squared.sqrt();
        }
        let sectors = &view.sector_of[row * view.columns..][..view.columns];
        for column in self.solid[..solid].iter().map(|&column| usize::from(column)) {
            let [x, y, _, height_m] = line.points[column];
            let sector = view.sectors.find([x, y], sectors[column]);
            self.hits[self.count] = Hit {
                range_m: self.ranges_m[column],
                height_m,
                sector: sector as u16,
                label: image.label(view, row, column).unwrap_or(Hit::NO_LABEL),
                is_deceptive: line.kinds[column] == SampleKind::Deceptive,
            };
            self.count += usize::from(sector != NONE);
        }
    }
}

/// Computes the key of each point, for cubes with this edge. Takes a whole row, because this loop is vectorized.
fn find_keys(keys: &mut [Key], points: &[[f32; 4]], edge_m: f32) {
    for (key, &[x, y, z, _]) in keys.iter_mut().zip(points) {
        *key = Key::at([x, y, z], edge_m);
    }
}
