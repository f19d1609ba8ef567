//! Where each sampled pixel looks in the base frame. Computed once per camera and mount. Another mount takes
//! the memory of the one before.
//!
//! The floor is divided into cells as the camera sees them: by sector, and within a sector by the tangent of
//! the angle below the horizon, so that every cell has a few pixels near and far. A direction is free as far
//! as its cells show floor, from near to far.

use std::f32::consts::{PI, TAU};
use std::ops::Range;

use nalgebra::Vector3;

use super::ObstacleOptions;
use super::extent::{Extent, Lines, Plane};
use super::ground::MAX_CANDIDATES;
use super::sectors::{Direction, NONE, Sectors, is_between, length, unit_vector, within_turn};
use crate::camera::{Mount, RayTable};

/// The largest number of samples per row. 640x480 is sampled at every second column and row.
const MAX_SAMPLES_PER_ROW: u32 = 320;

/// Height of a cell, in samples.
const CELL_SAMPLES: f32 = 2.0;

/// Floor nearer to the camera than its height divided by this is one cell.
const MAX_TANGENT: f32 = 4.0;

/// If a camera sees no floor, rays above this elevation do not widen the field of view, because near the
/// zenith the azimuth is undefined.
const MAX_ELEVATION_TANGENT: f32 = 1.0;

/// More than the rounding error of an angle.
const SIDE_MARGIN_RAD: f32 = 1e-4;

/// A piece of floor, seen by some samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    /// Samples that look at it.
    pub(super) samples: u32,
    /// The distance of its nearest point from the base's origin, meters.
    pub(super) near_m: f32,
    /// Tangent of the angle below the horizon at which the camera sees its farthest point.
    pub(super) tangent: f32,
}

impl Cell {
    const UNSEEN: Self = Self { samples: 0, near_m: f32::INFINITY, tangent: f32::INFINITY };
}

/// A sample that looks at floor within range.
#[derive(Debug, Clone, Copy)]
struct SeenFloor {
    sector: u32,
    /// From near to far.
    band: usize,
    /// Of the sample.
    index: usize,
    range_m: f32,
    tangent: f32,
}

/// What is used only while the tables are computed.
#[derive(Debug, Clone, Default)]
struct Work {
    samples: Vec<Direction>,
    seen: Vec<SeenFloor>,
    /// By sector and band: the cell, and its number.
    cells: Vec<Cell>,
    numbers: Vec<u32>,
    /// Angles between samples, radians.
    angles_rad: Vec<f32>,
    lines: Lines,
}

/// All samples of a camera's image, and the cells of the floor.
///
/// Each value of the samples has its own array, row by row, so that loops over rows are vectorized.
#[derive(Debug, Clone)]
pub(super) struct View {
    /// Pixels of a row of the image.
    pub(super) width: usize,
    pub(super) stride: usize,
    /// Samples of a row, and rows of samples.
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// By axis: the point of each sample at depth 1, relative to the camera, in the base frame; NaN without a
    /// ray.
    pub(super) directions: [Vec<f32>; 3],
    /// The cell of the floor that each sample looks at, on level ground; [`NONE`] if it does not look at
    /// floor within range.
    pub(super) cell_of: Vec<u32>,
    /// The rows from the first to the last one with a cell.
    pub(super) floor_rows: Range<usize>,
    /// The sector of each sample's direction; a first guess for the sector of its point.
    pub(super) sector_of: Vec<u32>,
    /// Row and column of the samples that the ground is fitted to: evenly spread over those that look at
    /// floor.
    pub(super) ground_samples: Vec<[u32; 2]>,
    /// By sector, from near to far.
    pub(super) cells: Vec<Cell>,
    /// The cells of each sector: from this index to the next one.
    pub(super) first_cells: Vec<u32>,
    /// Between which distances the whole width of each sector is in view.
    pub(super) extents: Vec<Extent>,
    pub(super) sectors: Sectors,
    /// Meters between the floor of two cells, divided by the square of their distance.
    pub(super) cell_growth: f32,
    work: Work,
}

impl View {
    pub(super) fn new(rays: &RayTable, mount: &Mount, options: &ObstacleOptions) -> Self {
        let stride = rays.width().div_ceil(MAX_SAMPLES_PER_ROW).max(1) as usize;
        let width = rays.width() as usize;
        let mut view = Self {
            width,
            stride,
            columns: width.div_ceil(stride),
            rows: (rays.height() as usize).div_ceil(stride),
            directions: Default::default(),
            cell_of: Vec::new(),
            floor_rows: 0..0,
            sector_of: Vec::new(),
            ground_samples: Vec::new(),
            cells: Vec::new(),
            first_cells: Vec::new(),
            extents: Vec::new(),
            sectors: Sectors::new(-PI, PI, options.sectors),
            cell_growth: 0.0,
            work: Work::default(),
        };
        view.set_mount(rays, mount, options);
        view
    }

    /// Computes everything again for another mount of the same camera, with the same options. Allocates only
    /// if the camera sees more cells of the floor than before.
    pub(super) fn set_mount(&mut self, rays: &RayTable, mount: &Mount, options: &ObstacleOptions) {
        let mut work = std::mem::take(&mut self.work);
        work.samples.clear();
        work.samples.reserve(self.rows * self.columns);
        for row in rays.rays().chunks(self.width.max(1)).step_by(self.stride) {
            work.samples.extend(row.chunks(self.stride).map(|pixels| {
                let [x, y] = pixels[0].map(f64::from);
                let direction = mount.direction([x, y, 1.0]);
                [direction.x as f32, direction.y as f32, direction.z as f32]
            }));
        }
        let (angle_min_rad, angle_max_rad) = field_of_view(&work.samples, mount, options);
        self.sectors.set_angles(angle_min_rad, angle_max_rad);
        let pitch_rad = pitch(&work.samples, self.columns, &mut work.angles_rad);
        let step = CELL_SAMPLES * pitch_rad;
        self.cell_growth = step / mount.height_m() as f32;
        let plane = Plane::new(mount, options, pitch_rad);
        let samples = (&work.samples[..], self.columns);
        work.lines.find_extents(samples, &self.sectors, &plane, self.cell_growth, &mut self.extents);
        self.divide_floor(&mut work, mount, options.max_range_m, step);
        for (axis, directions) in self.directions.iter_mut().enumerate() {
            directions.clear();
            directions.extend(work.samples.iter().map(|sample| sample[axis]));
        }
        self.choose_ground_samples();
        self.work = work;
    }

    fn choose_ground_samples(&mut self) {
        let Self { cell_of, ground_samples, columns, .. } = self;
        let looking = cell_of.iter().filter(|cell| **cell != NONE).count();
        let step = looking.div_ceil(MAX_CANDIDATES).max(1);
        let candidates = (0..cell_of.len()).filter(|&index| cell_of[index] != NONE).step_by(step);
        ground_samples.clear();
        ground_samples.reserve(MAX_CANDIDATES);
        ground_samples.extend(candidates.map(|index| [(index / *columns) as u32, (index % *columns) as u32]));
    }

    /// Gives each sample its sector and the cell it looks at.
    fn divide_floor(&mut self, work: &mut Work, mount: &Mount, max_range_m: f32, step: f32) {
        let camera = mount.position_m().map(|value| value as f32);
        work.seen.clear();
        work.seen.reserve(work.samples.len());
        self.sector_of.clear();
        self.sector_of.reserve(work.samples.len());
        let mut sector = NONE;
        for (index, &direction) in work.samples.iter().enumerate() {
            // The guess is the sector of the sample before.
            sector = self.sectors.find([direction[0], direction[1]], sector);
            self.sector_of.push(sector);
            let found = self.floor_of((direction, sector), camera, max_range_m, step);
            work.seen.extend(found.map(|seen| SeenFloor { index, ..seen }));
        }
        self.number_cells(work);
    }

    /// The floor that the first sample would look at in this direction; `None` beyond the range and outside
    /// the sectors.
    fn floor_of(
        &self,
        ([x, y, z], sector): (Direction, u32),
        [camera_x, camera_y, height_m]: [f32; 3],
        max_range_m: f32,
        step: f32,
    ) -> Option<SeenFloor> {
        // False for a sample without a ray, too.
        let is_below = z < 0.0;
        if !is_below {
            return None;
        }
        let reach = height_m / -z;
        let (floor_x, floor_y) = (camera_x + reach * x, camera_y + reach * y);
        let range_m = length(floor_x, floor_y);
        if range_m > max_range_m {
            return None;
        }
        let sector = self.sectors.find([floor_x, floor_y], sector);
        let tangent = (-z / length(x, y)).min(MAX_TANGENT);
        // From near to far: the largest tangent first.
        let band = ((MAX_TANGENT - tangent) / step) as usize;
        (sector != NONE).then_some(SeenFloor { sector, band, index: 0, range_m, tangent })
    }

    /// Numbers the cells that are seen, by sector and from near to far.
    fn number_cells(&mut self, work: &mut Work) {
        let Work { samples, seen, cells: all, numbers, .. } = work;
        let first_band = seen.iter().map(|seen| seen.band).min().unwrap_or_default();
        let bands = seen.iter().map(|seen| seen.band + 1 - first_band).max().unwrap_or_default();
        let place = |seen: &SeenFloor| seen.sector as usize * bands + seen.band - first_band;
        all.clear();
        all.resize(self.sectors.count() * bands, Cell::UNSEEN);
        for seen in seen.iter() {
            let cell = &mut all[place(seen)];
            *cell = Cell {
                samples: cell.samples + 1,
                near_m: cell.near_m.min(seen.range_m),
                tangent: cell.tangent.min(seen.tangent),
            };
        }
        numbers.clear();
        numbers.resize(all.len(), NONE);
        self.cells.clear();
        self.first_cells.clear();
        self.first_cells.push(0);
        for sector in 0..self.sectors.count() {
            for index in sector * bands..(sector + 1) * bands {
                if all[index].samples > 0 {
                    numbers[index] = self.cells.len() as u32;
                    self.cells.push(all[index]);
                }
            }
            self.first_cells.push(self.cells.len() as u32);
        }
        self.cell_of.clear();
        self.cell_of.resize(samples.len(), NONE);
        for seen in seen.iter() {
            self.cell_of[seen.index] = numbers[place(seen)];
        }
        // They are in the order of the samples.
        let row_of = |seen: &SeenFloor| seen.index / self.columns;
        self.floor_rows = seen.first().map_or(0, row_of)..seen.last().map_or(0, |last| row_of(last) + 1);
    }

    /// The cells of a sector, from near to far.
    pub(super) fn cells_of(&self, sector: usize) -> Range<usize> {
        self.first_cells[sector] as usize..self.first_cells[sector + 1] as usize
    }

    /// The share of all samples that look at floor within range.
    pub(super) fn floor_in_view(&self) -> f32 {
        let looking = self.cell_of.iter().filter(|cell| **cell != NONE).count();
        looking as f32 / self.cell_of.len().max(1) as f32
    }
}

/// The azimuths that the sectors cover, radians: those in which the camera sees floor within range. If it
/// sees no floor, those in which it sees anything.
fn field_of_view(samples: &[Direction], mount: &Mount, options: &ObstacleOptions) -> (f32, f32) {
    let axis = mount.direction([0.0, 0.0, 1.0]);
    let yaw = (axis.y as f32).atan2(axis.x as f32);
    // Tangent of the angle below the horizon at which the floor is at the largest range.
    let far = mount.height_m() as f32 / options.max_range_m;
    let within = |lowest: f32| {
        let below = samples.iter().filter(|&&[x, y, z]| -z >= lowest * length(x, y));
        let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
        // Directions a little within both, once there are some. Those between them change nothing.
        let mut sides = [[0.0; 2]; 2];
        for &[x, y, _] in below {
            if is_between([x, y], sides) {
                continue;
            }
            let angle = within_turn(y.atan2(x) - yaw + PI) - PI;
            if angle < min || angle > max {
                (min, max) = (min.min(angle), max.max(angle));
                sides = [min + SIDE_MARGIN_RAD, max - SIDE_MARGIN_RAD].map(|angle| unit_vector(yaw + angle));
            }
        }
        (min, max)
    };
    let (mut min, mut max) = [far, -MAX_ELEVATION_TANGENT]
        .into_iter()
        .map(within)
        .find(|(min, max)| min <= max)
        .unwrap_or_default();
    let sees_nadir = axis.z < -0.999;
    if sees_nadir || max - min > TAU - 0.1 {
        (min, max) = (-PI, PI);
    }
    let narrowest = 1e-3;
    (yaw + min, yaw + max.max(min + narrowest))
}

/// The median angle between neighboring samples of a column, radians. `angles` is a buffer.
fn pitch(samples: &[Direction], columns: usize, angles: &mut Vec<f32>) -> f32 {
    let below = samples.iter().skip(columns);
    let each = samples.iter().zip(below).step_by(37).map(|(&a, &b)| {
        let (a, b) = (Vector3::from(a), Vector3::from(b));
        (a - b).norm() / a.norm()
    });
    angles.clear();
    angles.extend(each.filter(|angle| angle.is_finite()));
    angles.sort_unstable_by(f32::total_cmp);
    angles.get(angles.len() / 2).copied().unwrap_or(0.01).clamp(1e-4, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Intrinsics};

    #[test]
    fn all_cells_are_in_the_rows_in_which_floor_can_be() {
        let (width, height) = (80, 60);
        let camera = Camera::pinhole(Intrinsics::new(80.0, 80.0, 39.5, 29.5, width, height).unwrap());
        let rays = RayTable::new(&camera);
        let floor_rows = |roll: f64, pitch: f64| {
            let mount = Mount::new([0.0, 0.0, 0.5], [roll, pitch, 0.0]).unwrap();
            let view = View::new(&rays, &mount, &ObstacleOptions::default());
            let has_cell = |row: &[u32]| row.iter().any(|cell| *cell != NONE);
            let with_cell = || view.cell_of.chunks(view.columns).map(has_cell);
            let first = with_cell().position(|has_cell| has_cell).unwrap_or(0);
            let end = with_cell().rposition(|has_cell| has_cell).map_or(0, |last| last + 1);
            assert_eq!(view.floor_rows, first..end, "roll {roll}, pitch {pitch}");
            view.floor_rows
        };
        for pitch in [-1.3, -0.3, 0.3, 1.3] {
            floor_rows(0.4, pitch);
        }
        let level = floor_rows(0.0, 0.0);
        assert!((31..45).contains(&level.start) && level.end == 60, "{level:?}: below the horizon");
        let turned_over = floor_rows(std::f64::consts::PI, 0.0);
        assert!(turned_over.start == 0 && turned_over.end < 30, "{turned_over:?}");
    }
}
