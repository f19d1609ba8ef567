//! Where each sampled pixel looks in the base frame. Computed once per camera and mount.
//!
//! The floor is divided into cells as the camera sees them: by sector, and within a sector by the tangent of the angle
//! below the horizon, so that every cell has a few pixels near and far. A direction is free as far as its cells show
//! floor, from near to far.

use std::f32::consts::{PI, TAU};

use nalgebra::Vector3;

use super::extent::{Extent, Plane, extents};
use super::ground::MAX_CANDIDATES;
use super::sectors::{NONE, Sample, Sectors, length};
use super::{Mount, ObstacleOptions};
use crate::camera::RayTable;

/// The largest number of samples per row. 640x480 is sampled at every second column and row.
const MAX_SAMPLES_PER_ROW: u32 = 320;

/// Height of a cell, in samples.
const CELL_SAMPLES: f32 = 2.0;

/// Floor nearer to the camera than its height divided by this is one cell.
const MAX_TANGENT: f32 = 4.0;

/// If a camera sees no floor, rays above this elevation do not widen the field of view, because near the zenith the azimuth is
/// undefined.
const MAX_ELEVATION_TANGENT: f32 = 1.0;

/// A piece of floor, seen by some samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    /// Samples that look at it.
    pub(super) samples: u32,
    /// The distance of its nearest point from the base's origin, meters.
    pub(super) near_m: f32,
}

/// A sample that looks at floor within range.
struct SeenFloor {
    sector: u32,
    /// From near to far.
    band: usize,
    /// Of the sample.
    index: usize,
    range_m: f32,
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
    /// By axis: the point of each sample at depth 1, relative to the camera, in the base frame; NaN without a ray.
    pub(super) directions: [Vec<f32>; 3],
    /// The cell of the floor that each sample looks at, on level ground; [`NONE`] if it does not look at floor within
    /// range.
    pub(super) cell_of: Vec<u32>,
    /// The sector of each sample's direction; a first guess for the sector of its point.
    pub(super) sector_of: Vec<u32>,
    /// Row and column of the samples that the ground is fitted to: evenly spread over those that look at floor.
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
}

impl View {
    pub(super) fn new(rays: &RayTable, mount: &Mount, options: &ObstacleOptions) -> Self {
        let stride = rays.width().div_ceil(MAX_SAMPLES_PER_ROW).max(1) as usize;
        let width = rays.width() as usize;
        let columns = width.div_ceil(stride);
        let rows = rays.rays().chunks(width.max(1)).step_by(stride);
        let directions = rows.flat_map(|row| row.iter().step_by(stride)).map(|&[x, y]| {
            let direction = mount.direction([f64::from(x), f64::from(y), 1.0]);
            Vector3::new(direction.x as f32, direction.y as f32, direction.z as f32)
        });
        let sample =
            |direction: Vector3<f32>| Sample { direction: direction.into(), cell: NONE, sector: NONE };
        let mut samples: Vec<Sample> = directions.map(sample).collect();
        let sectors = field_of_view(&samples, mount, options);
        let height_m = mount.height_m() as f32;
        let pitch_rad = pitch(&samples, columns);
        let step = CELL_SAMPLES * pitch_rad;
        let cell_growth = step / height_m;
        let plane = Plane::new(mount, options, pitch_rad);
        let extents = extents(&samples, columns, &sectors, &plane, cell_growth);
        let mut view = Self {
            width,
            stride,
            columns,
            rows: samples.len() / columns.max(1),
            directions: Default::default(),
            cell_of: Vec::new(),
            sector_of: Vec::new(),
            ground_samples: Vec::new(),
            cells: Vec::new(),
            first_cells: Vec::new(),
            extents,
            sectors,
            cell_growth,
        };
        view.divide_floor(&mut samples, mount, options.max_range_m, step);
        view.directions = [0, 1, 2].map(|axis| samples.iter().map(|sample| sample.direction[axis]).collect());
        view.cell_of = samples.iter().map(|sample| sample.cell).collect();
        view.sector_of = samples.iter().map(|sample| sample.sector).collect();
        view.ground_samples = view.choose_ground_samples();
        view
    }

    fn choose_ground_samples(&self) -> Vec<[u32; 2]> {
        let looking = self.cell_of.iter().filter(|cell| **cell != NONE).count();
        let step = looking.div_ceil(MAX_CANDIDATES).max(1);
        let candidates = (0..self.cell_of.len()).filter(|&index| self.cell_of[index] != NONE).step_by(step);
        candidates.map(|index| [(index / self.columns) as u32, (index % self.columns) as u32]).collect()
    }

    /// Gives each sample its sector and the cell it looks at.
    fn divide_floor(&mut self, samples: &mut [Sample], mount: &Mount, max_range_m: f32, step: f32) {
        let camera = mount.position_m().map(|value| value as f32);
        let mut seen = Vec::with_capacity(samples.len());
        let mut neighbor = NONE;
        for (index, sample) in samples.iter_mut().enumerate() {
            let [x, y, _] = sample.direction;
            sample.sector = self.sectors.find([x, y], neighbor);
            neighbor = sample.sector;
            let found = self.floor_of(sample, camera, max_range_m, step);
            seen.extend(found.map(|(sector, band, range_m)| SeenFloor { sector, band, index, range_m }));
        }
        self.number_cells(samples, &seen);
    }

    /// Sector, band and distance of the floor that a sample looks at; `None` beyond the range and outside the sectors.
    fn floor_of(
        &self,
        sample: &Sample,
        [camera_x, camera_y, height_m]: [f32; 3],
        max_range_m: f32,
        step: f32,
    ) -> Option<(u32, usize, f32)> {
        let [x, y, z] = sample.direction;
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
        let sector = self.sectors.find([floor_x, floor_y], sample.sector);
        let tangent = (-z / length(x, y)).min(MAX_TANGENT);
        // From near to far: the largest tangent first.
        let band = ((MAX_TANGENT - tangent) / step) as usize;
        (sector != NONE).then_some((sector, band, range_m))
    }

    /// Numbers the cells that are seen, by sector and from near to far.
    fn number_cells(&mut self, samples: &mut [Sample], seen: &[SeenFloor]) {
        let first_band = seen.iter().map(|seen| seen.band).min().unwrap_or_default();
        let bands = seen.iter().map(|seen| seen.band + 1 - first_band).max().unwrap_or_default();
        let place = |seen: &SeenFloor| seen.sector as usize * bands + seen.band - first_band;
        let mut all = vec![Cell { samples: 0, near_m: f32::INFINITY }; self.sectors.count() * bands];
        for seen in seen {
            let cell = &mut all[place(seen)];
            *cell = Cell { samples: cell.samples + 1, near_m: cell.near_m.min(seen.range_m) };
        }
        let mut numbers = vec![NONE; all.len()];
        self.first_cells = vec![0];
        for sector in 0..self.sectors.count() {
            for index in sector * bands..(sector + 1) * bands {
                if all[index].samples > 0 {
                    numbers[index] = self.cells.len() as u32;
                    self.cells.push(all[index]);
                }
            }
            self.first_cells.push(self.cells.len() as u32);
        }
        for seen in seen {
            samples[seen.index].cell = numbers[place(seen)];
        }
    }

    /// The cells of a sector, from near to far.
    pub(super) fn cells_of(&self, sector: usize) -> std::ops::Range<usize> {
        self.first_cells[sector] as usize..self.first_cells[sector + 1] as usize
    }

    /// The share of all samples that look at floor within range.
    pub(super) fn floor_in_view(&self) -> f32 {
        let looking = self.cell_of.iter().filter(|cell| **cell != NONE).count();
        looking as f32 / self.cell_of.len().max(1) as f32
    }
}

/// The sectors cover all azimuths in which the camera sees floor within range. If it sees no floor, they cover all azimuths
/// in which it sees anything.
fn field_of_view(samples: &[Sample], mount: &Mount, options: &ObstacleOptions) -> Sectors {
    let axis = mount.direction([0.0, 0.0, 1.0]);
    let yaw = (axis.y as f32).atan2(axis.x as f32);
    // Tangent of the angle below the horizon at which the floor is at the largest range.
    let far = mount.height_m() as f32 / options.max_range_m;
    let within = |lowest: f32| {
        let below = samples
            .iter()
            .map(|sample| sample.direction)
            .filter(move |&[x, y, z]| -z >= lowest * length(x, y));
        let angles = below.map(|[x, y, _]| (y.atan2(x) - yaw + PI).rem_euclid(TAU) - PI);
        angles.fold((f32::INFINITY, f32::NEG_INFINITY), |(min, max), angle| (min.min(angle), max.max(angle)))
    };
    let (mut min, mut max) = [far, -MAX_ELEVATION_TANGENT]
        .map(within)
        .into_iter()
        .find(|(min, max)| min <= max)
        .unwrap_or_default();
    let sees_nadir = axis.z < -0.999;
    if sees_nadir || max - min > TAU - 0.1 {
        (min, max) = (-PI, PI);
    }
    let narrowest = 1e-3;
    Sectors::new(yaw + min, yaw + max.max(min + narrowest), options.sectors)
}

/// The median angle between neighboring samples of a column, radians.
fn pitch(samples: &[Sample], columns: usize) -> f32 {
    let below = samples.iter().skip(columns);
    let mut angles: Vec<f32> = samples
        .iter()
        .zip(below)
        .step_by(37)
        .map(|(a, b)| {
            let (a, b) = (Vector3::from(a.direction), Vector3::from(b.direction));
            (a - b).norm() / a.norm()
        })
        .filter(|angle| angle.is_finite())
        .collect();
    angles.sort_unstable_by(f32::total_cmp);
    angles.get(angles.len() / 2).copied().unwrap_or(0.01).clamp(1e-4, 0.5)
}
