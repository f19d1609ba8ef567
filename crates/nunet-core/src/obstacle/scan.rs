//! One pass over the samples: which show floor, which an obstacle, and what each cell of the floor shows.

use super::role::{Role, Roles};
use super::view::{NONE, View};
use super::{DepthImage, Ground, ObstacleOptions};

/// Neighbors whose depth differs by less than this share lie on the same surface.
const SAME_SURFACE: f32 = 0.05;
/// Steps to both neighbors of a line by more than this share, in the same direction, are an edge that depth flows over.
const FLYING_STEP: f32 = 0.06;
/// Neighbors on the same surface that a sample needs.
const MIN_SUPPORT: u32 = 2;
/// A refined ground may be off by this slope (0.25 degrees), the expected one by four times as much.
const SLOPE_ERROR: f32 = 0.0044;
/// What is deeper than this below the ground is missing floor: meters, and share of the camera's height.
const DROP_M: f32 = 0.08;
const DROP_SHARE: f32 = 0.08;

/// The class of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SampleKind {
    /// No valid depth, or nothing that counts for the robot.
    Nothing,
    /// Ground that can be driven on.
    Floor,
    /// Part of an obstacle, if its neighbors agree.
    Obstacle,
    /// A window, mirror or screen at the height of the robot.
    Deceptive,
    /// Below the ground.
    Drop,
}

/// The samples of a cell of the floor.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Votes {
    pub(super) floor: u32,
    pub(super) drop: u32,
    /// The square of the distance of its farthest floor, square meters.
    pub(super) far_squared: f32,
}

/// The samples of one frame. Allocates once.
#[derive(Debug, Clone)]
pub(super) struct Scan {
    /// Depth of each sample, meters.
    pub(super) depth_m: Vec<f32>,
    pub(super) heights_m: Vec<f32>,
    pub(super) kinds: Vec<SampleKind>,
    pub(super) votes: Vec<Votes>,
    camera: [f32; 3],
    columns: usize,
}

/// Bounds of heights and distances.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    clearance_m: f32,
    /// By how much the clearance grows per meter of depth.
    slope_error: f32,
    robot_height_m: f32,
    drop_m: f32,
    max_squared: f32,
}

impl Scan {
    pub(super) fn new(view: &View, camera: [f64; 3]) -> Self {
        let samples = view.samples.len();
        Self {
            depth_m: vec![f32::NAN; samples],
            heights_m: vec![f32::NAN; samples],
            kinds: vec![SampleKind::Nothing; samples],
            votes: vec![Votes::default(); view.cells.len()],
            camera: camera.map(|value| value as f32),
            columns: view.columns,
        }
    }

    /// Takes the samples' depth from the image.
    pub(super) fn gather(&mut self, image: &DepthImage<'_>, view: &View) {
        let rows = image.depth_m.chunks_exact(view.width).step_by(view.stride);
        for (samples, row) in self.depth_m.chunks_exact_mut(view.columns).zip(rows) {
            for (sample, &depth) in samples.iter_mut().zip(row.iter().step_by(view.stride)) {
                // False for NaN.
                *sample = if depth > 0.0 && depth < f32::INFINITY { depth } else { f32::NAN };
            }
        }
    }

    /// The point of a sample in the base frame.
    #[inline]
    pub(super) fn point(&self, view: &View, index: usize) -> [f32; 3] {
        let (depth, direction) = (self.depth_m[index], view.samples[index].direction);
        let [x, y, z] = self.camera;
        [x + depth * direction[0], y + depth * direction[1], z + depth * direction[2]]
    }

    /// Says what each sample shows, and counts the cells' votes.
    pub(super) fn classify(
        &mut self,
        image: &DepthImage<'_>,
        view: &View,
        (roles, ground, options): (&Roles, &Ground, &ObstacleOptions),
    ) {
        self.votes.fill(Votes::default());
        let slope_error = if ground.is_refined { SLOPE_ERROR } else { 4.0 * SLOPE_ERROR };
        let bounds = Bounds {
            clearance_m: options.clearance_m,
            slope_error,
            robot_height_m: options.robot_height_m,
            drop_m: options.clearance_m.max(DROP_M + DROP_SHARE * self.camera[2]),
            max_squared: options.max_range_m * options.max_range_m,
        };
        for index in 0..self.depth_m.len() {
            let point = self.point(view, index);
            let height_m = ground.height_above(point);
            let range_squared = point[0] * point[0] + point[1] * point[1];
            let role = image.label(view, index).map_or(Role::Other, |label| roles.of(label));
            let kind = bounds.kind(height_m, self.depth_m[index], range_squared, role);
            self.heights_m[index] = height_m;
            self.kinds[index] = kind;
            let cell = view.samples[index].cell;
            if cell != NONE {
                let votes = &mut self.votes[cell as usize];
                votes.floor += u32::from(kind == SampleKind::Floor);
                votes.drop += u32::from(kind == SampleKind::Drop);
                if kind == SampleKind::Floor {
                    votes.far_squared = votes.far_squared.max(range_squared);
                }
            }
        }
    }

    /// Whether a sample lies on a surface: some neighbors have almost the same depth, and it is not on the slope that
    /// networks draw between a near and a far surface.
    #[inline]
    pub(super) fn is_supported(&self, index: usize) -> bool {
        let depth = self.depth_m[index];
        let column = index % self.columns;
        let at = |exists: bool, index: usize| if exists { self.depth_m[index] } else { f32::NAN };
        let steps = [
            at(column > 0, index.wrapping_sub(1)),
            at(column + 1 < self.columns, index + 1),
            at(index >= self.columns, index.wrapping_sub(self.columns)),
            at(index + self.columns < self.depth_m.len(), index + self.columns),
        ]
        .map(|neighbor| (neighbor - depth) / depth);
        let support: u32 = steps.iter().map(|step| u32::from(step.abs() < SAME_SURFACE)).sum();
        let flies = |before: f32, after: f32| {
            before.abs().min(after.abs()) > FLYING_STEP && (before > 0.0) != (after > 0.0)
        };
        support >= MIN_SUPPORT && !flies(steps[0], steps[1]) && !flies(steps[2], steps[3])
    }

    /// The share of all samples that show floor.
    pub(super) fn floor_fraction(&self) -> f32 {
        let floor: u32 = self.votes.iter().map(|votes| votes.floor).sum();
        floor as f32 / self.kinds.len().max(1) as f32
    }
}

impl Bounds {
    /// All comparisons with NaN are false, so that a sample without depth shows nothing.
    #[inline]
    fn kind(&self, height_m: f32, depth_m: f32, range_squared: f32, role: Role) -> SampleKind {
        let clearance_m = self.clearance_m + self.slope_error * depth_m;
        let in_reach = range_squared <= self.max_squared;
        let in_way = in_reach && height_m > clearance_m && height_m < self.robot_height_m;
        match role {
            Role::Deceptive if in_reach && height_m < self.robot_height_m => SampleKind::Deceptive,
            Role::Deceptive => SampleKind::Nothing,
            _ if height_m.abs() <= clearance_m && in_reach => SampleKind::Floor,
            Role::Other if in_way => SampleKind::Obstacle,
            _ if height_m < -(self.drop_m + self.slope_error * depth_m) => SampleKind::Drop,
            _ => SampleKind::Nothing,
        }
    }
}
