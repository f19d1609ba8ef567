//! Between which distances the whole width of a sector is in view.
//!
//! The sides of the image cut the outermost sectors. A camera that looks down sees less of them far away than
//! near, and one that looks up less near than far away. An obstacle in the part that is cut off is not seen.
//! So each sector is examined along a few lines from the base's origin. A line is in view where it passes
//! between two neighboring samples.

use std::f32::consts::{PI, TAU};

use super::ObstacleOptions;
use super::kind::SLOPE_ERROR;
use super::sectors::{Direction, Sectors, length, within_turn};
use crate::camera::Mount;

/// Lines per sector. An obstacle that fills a quarter of the sector meets one.
const LINES: usize = 4;

/// Of the samples of a row or column, every one of this number is used. Between them, the view has straight
/// sides.
const STEP: usize = 4;

/// Samples of an obstacle that must be in view above the clearance.
const MIN_SAMPLES: f32 = 2.0;

/// If the lines of a sector enter or leave the view within this number of cells, the bottom or the top of the
/// image cuts them, not a side. Then the visible floor alone decides.
const BOTTOM_CELLS: f32 = 2.0;
const TOP_CELLS: f32 = 0.5;

/// If the whole width is in view only from this many times the distance of the nearest floor on, the sector
/// is unknown.
const MAX_NEAR_FACTOR: f32 = 1.5;

/// Where something is in view, meters from the base's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extent {
    /// Floor is in view from here on.
    pub(super) from_m: f32,
    /// Obstacles that are hardly higher than the clearance are in view up to here.
    pub(super) until_m: f32,
}

impl Extent {
    /// Nothing is in view.
    const NOTHING: Self = Self { from_m: f32::INFINITY, until_m: 0.0 };

    /// What is in view on all lines of a sector.
    fn of_lines(lines: &[Self], cell_growth: f32) -> Self {
        let from_m = lines.iter().fold(0.0, |from_m: f32, line| from_m.max(line.from_m));
        let until_m = lines.iter().fold(f32::INFINITY, |until_m: f32, line| until_m.min(line.until_m));
        let farthest_m = lines.iter().fold(0.0, |farthest_m: f32, line| farthest_m.max(line.until_m));
        // False if nothing is in view on a line.
        let is_cut_by_top = 1.0 / until_m - 1.0 / farthest_m < TOP_CELLS * cell_growth;
        Self { from_m, until_m: if is_cut_by_top { f32::INFINITY } else { until_m } }
    }

    /// From where on a sector is seen, and up to where it may be free. `near_m`: the nearest floor that any
    /// of its samples looks at.
    pub(super) fn limit(self, near_m: f32, cell_growth: f32) -> Self {
        let bottom_m = near_m + BOTTOM_CELLS * cell_growth * near_m * near_m;
        let from_m = if self.from_m > bottom_m { self.from_m } else { near_m };
        if from_m > MAX_NEAR_FACTOR * near_m || from_m > self.until_m {
            return Self { from_m: near_m, until_m: 0.0 };
        }
        Self { from_m, until_m: self.until_m }
    }
}

/// A point as the sectors see it.
#[derive(Debug, Clone, Copy)]
struct Polar {
    /// From the right boundary of the first sector, in lines.
    line: f32,
    range_m: f32,
}

/// The lines of all sectors, counterclockwise, and what is seen of them. The buffers are kept, so that
/// another mount allocates nothing.
#[derive(Debug, Clone, Default)]
pub(super) struct Lines {
    extents: Vec<Extent>,
    /// The floor that every [`STEP`]th sample of every [`STEP`]th row looks at, and the point at the
    /// clearance.
    points: Vec<[Polar; 2]>,
    /// The direction in the middle of the sectors, radians, and their number up to there.
    middle_rad: f32,
    middle: f32,
    /// Lines per radian, and in a full circle.
    per_rad: f32,
    circle: i64,
}

/// Every [`STEP`]th index, and the last one.
fn spread(count: usize) -> impl Iterator<Item = usize> {
    (0..count.saturating_sub(1)).step_by(STEP).chain(count.checked_sub(1))
}

/// The floor, and the height above it up to which an obstacle must be in view.
pub(super) struct Plane {
    camera: [f32; 3],
    /// The camera's height above the clearance, meters; a little if it is lower.
    above_clearance_m: f32,
    /// By how much that height grows per meter of distance.
    slope: f32,
    /// Farther than the largest range from the base's origin, wherever the camera is.
    far_m: f32,
}

impl Plane {
    /// `pitch_rad`: the angle between samples.
    pub(super) fn new(mount: &Mount, options: &ObstacleOptions, pitch_rad: f32) -> Self {
        let camera = mount.position_m().map(|value| value as f32);
        Self {
            camera,
            above_clearance_m: (camera[2] - options.clearance_m).max(1e-3),
            slope: SLOPE_ERROR + MIN_SAMPLES * pitch_rad,
            far_m: 1.1 * options.max_range_m + length(camera[0], camera[1]),
        }
    }

    /// Where a ray meets the floor, and where it is at the clearance. NaN for a ray that does not meet the
    /// floor.
    fn points(&self, [x, y, z]: Direction) -> [[f32; 2]; 2] {
        let norm = length(x, y);
        let tangent = -z / norm;
        let floor_m = if tangent > 0.0 { self.camera[2] / tangent } else { f32::NAN };
        let falls = tangent + self.slope;
        let low_m = if falls > 0.0 { self.above_clearance_m / falls } else { f32::INFINITY };
        [floor_m, low_m.min(self.far_m)]
            .map(|reach_m| [self.camera[0] + reach_m * x / norm, self.camera[1] + reach_m * y / norm])
    }
}

impl Lines {
    /// Fills `extents`: between which distances the whole width of each sector is in view. `samples` are in
    /// rows of `columns`. Cells at a distance are `cell_growth` times its square long.
    pub(super) fn find_extents(
        &mut self,
        (samples, columns): (&[Direction], usize),
        sectors: &Sectors,
        plane: &Plane,
        cell_growth: f32,
        extents: &mut Vec<Extent>,
    ) {
        self.start(sectors);
        let mut points = std::mem::take(&mut self.points);
        points.clear();
        for row in spread(samples.len() / columns.max(1)) {
            let row = &samples[row * columns..][..columns];
            points.extend(spread(columns).map(|column| plane.points(row[column]).map(|at| self.polar(at))));
        }
        let rows = || points.chunks(spread(columns).count().max(1));
        for (row, below) in rows().zip(rows().skip(1)) {
            for (left, right) in row.iter().zip(&row[1..]) {
                self.see(left, right);
            }
            for (above, below) in row.iter().zip(below) {
                self.see(above, below);
            }
        }
        self.points = points;
        extents.clear();
        extents.extend(self.extents.chunks(LINES).map(|lines| Extent::of_lines(lines, cell_growth)));
    }

    /// Begins with sectors of which nothing is seen.
    fn start(&mut self, sectors: &Sectors) {
        let count = LINES * sectors.count();
        self.extents.clear();
        self.extents.resize(count, Extent::NOTHING);
        self.per_rad = LINES as f32 / sectors.angle_step_rad;
        self.middle = 0.5 * count as f32;
        self.middle_rad = sectors.angle_min_rad + self.middle / self.per_rad;
        self.circle = (TAU * self.per_rad).round() as i64;
    }

    fn polar(&self, [x, y]: [f32; 2]) -> Polar {
        let angle = within_turn(y.atan2(x) - self.middle_rad + PI) - PI;
        Polar { line: self.middle + angle * self.per_rad, range_m: length(x, y) }
    }

    /// Takes what two neighboring samples show of the lines between them.
    fn see(&mut self, [a_floor, a_low]: &[Polar; 2], [b_floor, b_low]: &[Polar; 2]) {
        self.cross(a_floor, b_floor, |extent, range_m| extent.from_m = extent.from_m.min(range_m));
        self.cross(a_low, b_low, |extent, range_m| extent.until_m = extent.until_m.max(range_m));
    }

    /// Calls `see` with each line between two points, and with the distance at which their connection crosses
    /// it. Nothing is between points that are NaN.
    fn cross(&mut self, a: &Polar, b: &Polar, see: impl Fn(&mut Extent, f32)) {
        let circle = self.circle as f32;
        let mut step = b.line - a.line;
        // Behind the camera, the shorter way.
        if step.abs() > 0.5 * circle {
            step -= circle.copysign(step);
        }
        let (first, last) = (a.line.min(a.line + step) - 0.5, a.line.max(a.line + step) - 0.5);
        if !first.is_finite() || !last.is_finite() {
            return;
        }
        let (first, last, count) = (first.ceil() as i64, last.ceil() as i64, self.extents.len() as i64);
        // Only the lines of the sectors are visited, also one turn earlier or later: a circle of very narrow
        // ones has millions.
        for turn in [-self.circle, 0, self.circle] {
            for line in first.max(turn)..last.min(turn + count) {
                let share = (line as f32 + 0.5 - a.line) / step;
                let range_m = a.range_m + share * (b.range_m - a.range_m);
                see(&mut self.extents[(line - turn) as usize], range_m);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn extent(from_m: f32, until_m: f32) -> Extent {
        Extent { from_m, until_m }
    }

    fn lines(sectors: &Sectors) -> Lines {
        let mut lines = Lines::default();
        lines.start(sectors);
        lines
    }

    #[test]
    fn a_sector_is_in_view_where_all_its_lines_are() {
        let whole = |lines: &[Extent]| Extent::of_lines(lines, 0.01);
        assert_eq!(whole(&[extent(0.5, 5.0), extent(0.7, 2.0)]), extent(0.7, 2.0), "cut by a side");
        assert_eq!(
            whole(&[extent(0.5, 3.0), extent(0.5, 2.98)]),
            extent(0.5, f32::INFINITY),
            "cut by the top"
        );
        assert_eq!(whole(&[extent(0.5, 5.0), Extent::NOTHING]), Extent::NOTHING);
        assert_eq!(whole(&[Extent::NOTHING; 2]), Extent::NOTHING);
    }

    #[test]
    fn a_sector_is_seen_from_where_its_whole_width_is_in_view() {
        let limit = |from_m: f32, until_m: f32| extent(from_m, until_m).limit(1.0, 0.05);
        assert_eq!(limit(1.05, 5.0), extent(1.0, 5.0), "cut by the bottom");
        assert_eq!(limit(1.4, 5.0), extent(1.4, 5.0));
        assert_eq!(limit(1.6, 5.0), extent(1.0, 0.0), "a side is not seen near");
        assert_eq!(limit(1.4, 1.2), extent(1.0, 0.0), "never as a whole");
        assert_eq!(Extent::NOTHING.limit(1.0, 0.05), extent(1.0, 0.0));
    }

    #[test]
    fn very_narrow_sectors_are_crossed_from_one_side_of_the_robot_to_the_other() {
        let mut lines = lines(&Sectors::new(-5e-4, 5e-4, 360));
        let [right, left] = [[0.3, -0.4], [0.3, 0.4]].map(|point| [lines.polar(point); 2]);
        // This would take minutes if all lines between the two points were visited.
        for _ in 0..10_000 {
            lines.see(&right, &left);
        }
        assert_eq!(lines.extents.len(), 1440);
        assert!(lines.extents.iter().all(|extent| (extent.from_m - 0.5).abs() < 1e-3));
        assert!(lines.extents.iter().all(|extent| (extent.until_m - 0.5).abs() < 1e-3));
    }

    #[test]
    fn lines_between_two_points_are_crossed_also_behind_the_camera() {
        let sectors = Sectors::new(-PI, PI, 2);
        let mut lines = lines(&sectors);
        let point = |degrees: f32, range_m: f32| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            [range_m * cos, range_m * sin]
        };
        let mut see = |a: [f32; 2], b: [f32; 2]| {
            let [a, b] = [a, b].map(|point| [lines.polar(point); 2]);
            lines.see(&a, &b);
        };
        // Lines are at -157.5, -112.5, ..., 157.5 degrees.
        see(point(10.0, 1.0), point(80.0, 2.0));
        see(point(150.0, 3.0), point(-150.0, 3.0));
        see(point(-100.0, f32::NAN), point(-20.0, 1.0));
        let seen: Vec<usize> = (0..8).filter(|&line| lines.extents[line] != Extent::NOTHING).collect();
        assert_eq!(seen, [0, 4, 5, 7]);
        assert!((lines.extents[4].from_m - (1.0 + 12.5 / 70.0)).abs() < 1e-3, "{:?}", lines.extents[4]);
        assert!((lines.extents[0].until_m - 3.0).abs() < 1e-3);
    }
}
