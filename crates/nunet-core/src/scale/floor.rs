//! Measures the scale of depth on the floor of one frame.
//!
//! The mount gives the camera's height and attitude, so the true depth of each pixel that shows level floor
//! is known. Each pixel labeled floor gives a ratio: true depth over measured depth. The frame's ratio is
//! their weighted median, taken twice: of all, then of those near the first one. A pixel weighs less the
//! farther away it is, where an error of the attitude counts more.
//!
//! Only the attitude is trusted, not a fitted plane, because a fit locks onto tables. A surface above the
//! floor is nearer than the floor behind it, so its ratio is larger. A wall's ratios grow with distance,
//! floor's do not. If many ratios are smaller than the median, then the median is that of something above the
//! floor, and the frame gives no ratio.

use super::ScaleError;
use crate::camera::{Camera, MAX_SCALE_FACTOR, MIN_SCALE_FACTOR, Mount, RayTable};
use crate::depth::DepthImage;
use crate::label_roles::{Role, Roles};
use crate::obstacle::FloorView;

/// The largest number of pixels that are used: about 0.1 ms.
const MAX_SAMPLES: usize = 8192;
/// Error of the attitude that weights assume, radians (0.5 degrees), and of depth, as a share.
const ATTITUDE_ERROR_RAD: f32 = 0.0087;
const DEPTH_ERROR: f32 = 0.03;
/// Floor whose true depth is less certain than this share is not used.
const MAX_ERROR: f32 = 0.2;
/// The floor must cover this share of the image. Smaller floor areas are often only a carpet, or floor
/// between the legs of a chair.
const MIN_FLOOR: f32 = 0.09;
/// Ratios within this logarithm of the median agree with it (35 %). Networks need this much: theirs differ
/// from near to far.
const AGREEMENT: f32 = 0.3;
/// The share of ratios that must agree.
const MIN_AGREEING: f32 = 0.6;
/// The share of ratios that may be smaller: they would be below the floor.
const MAX_BELOW: f32 = 0.2;
/// How steeply ratios may grow with distance, as the exponent: 0 for floor, 1 for an upright wall. Networks
/// that estimate near objects too far have up to 0.6.
const MAX_GROWTH: f32 = 0.75;
/// Growth is known if the logarithm of distance has this variance.
const MIN_VARIANCE: f32 = 0.01;
/// Bins of the logarithm of a ratio.
const BIN: f32 = 0.005;
const BINS: usize = 1200;

/// The ratio of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorRatio {
    /// The factor by which the frame's depth must be multiplied.
    pub ratio: f32,
    /// Half of the ratios differ from `ratio` by less than this share of it.
    pub spread: f32,
    /// The share of the image that is labeled floor and has depth, 0 to 1.
    pub floor_fraction: f32,
}

/// A pixel that sees level floor.
#[derive(Debug, Clone, Copy)]
struct FloorPixel {
    pixel: u32,
    true_m: f32,
    log_true: f32,
    weight: f32,
}

/// Weighted sums for the line of a logarithm `y` over the logarithm `x` of distance.
#[derive(Debug, Clone, Copy, Default)]
struct LineSums {
    weight: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
}

impl LineSums {
    fn add(&mut self, x: f32, y: f32, weight: f32) {
        self.weight += weight;
        self.x += weight * x;
        self.y += weight * y;
        self.xx += weight * x * x;
        self.xy += weight * x * y;
    }

    /// The slope; 0 if all distances are alike.
    fn slope(&self) -> f32 {
        let Self { weight, x, y, xx, xy } = *self;
        let variance = (xx - x * x / weight) / weight;
        if variance > MIN_VARIANCE { (xy - x * y / weight) / weight / variance } else { 0.0 }
    }
}

/// Measures the scale on the floor. Allocates once.
#[derive(Debug, Clone)]
pub struct FloorGauge {
    rays: RayTable,
    roles: Roles,
    samples: Vec<FloorPixel>,
    /// Every n-th column and row is used.
    stride: usize,
    looked_at: usize,
    weights: Vec<f32>,
}

impl FloorGauge {
    /// For depth maps of `camera`, at the size of its intrinsics. `classes` are the names of the labels,
    /// index = label.
    ///
    /// # Errors
    /// No class is floor.
    pub fn new(camera: &Camera, mount: Mount, classes: &[String]) -> Result<Self, ScaleError> {
        let roles = Roles::new(classes);
        if !roles.has_floor {
            return Err(ScaleError::NoFloorClass);
        }
        let rays = RayTable::new(camera);
        let (width, height) = (rays.width() as usize, rays.height() as usize);
        let stride = (1..).find(|n| width.div_ceil(*n) * height.div_ceil(*n) <= MAX_SAMPLES).unwrap_or(1);
        let looked_at = width.div_ceil(stride) * height.div_ceil(stride);
        let samples = Vec::with_capacity(looked_at);
        let mut gauge = Self { rays, roles, samples, stride, looked_at, weights: vec![0.0; BINS] };
        gauge.set_mount(mount);
        Ok(gauge)
    }

    /// Sets the mount for the next frames, for example with the attitude of an inertial sensor.
    pub fn set_mount(&mut self, mount: Mount) {
        let height_m = mount.height_m() as f32;
        let width = self.rays.width() as usize;
        self.samples.clear();
        let rows = self.rays.rays().chunks(width.max(1)).enumerate().step_by(self.stride);
        for (row, rays) in rows {
            for (column, &[x, y]) in rays.iter().enumerate().step_by(self.stride) {
                let direction = mount.direction([f64::from(x), f64::from(y), 1.0]);
                let down = -direction.z as f32;
                let level = direction.xy().norm() as f32;
                // Relative change of the floor's distance with the angle below the horizon.
                let error = DEPTH_ERROR.hypot(ATTITUDE_ERROR_RAD * (level / down + down / level));
                // False for NaN, of a pixel without a ray.
                if down > 0.0 && error <= MAX_ERROR {
                    let pixel = (row * width + column) as u32;
                    let weight = error.powi(-2) * DEPTH_ERROR.powi(2);
                    let true_m = height_m / down;
                    self.samples.push(FloorPixel { pixel, true_m, log_true: true_m.ln(), weight });
                }
            }
        }
    }

    /// The share of the image in which this camera can use floor, 0 to 1.
    #[must_use]
    pub fn floor_in_view(&self) -> f32 {
        self.samples.len() as f32 / self.looked_at.max(1) as f32
    }

    /// The floor that a frame shows, whatever the mount says. Its height is that of unscaled depth, and its
    /// direction does not depend on the scale. Allocates.
    #[must_use]
    pub fn floor_view(&self, image: &DepthImage<'_>) -> Option<FloorView> {
        FloorView::of_image(&self.rays, &self.roles, image)
    }

    /// The ratio of a frame; `None` without labels or enough floor, if its ratios do not agree, or if
    /// buffers have another size than the camera's image. Allocates nothing.
    pub fn measure(&mut self, image: &DepthImage<'_>) -> Option<FloorRatio> {
        let labels = image.labels?;
        let pixels = self.rays.rays().len();
        if image.depth_m.len() != pixels || labels.len() != pixels {
            return None;
        }
        let (floor, line) = self.count(image, labels);
        let floor_fraction = floor as f32 / self.looked_at.max(1) as f32;
        if floor_fraction < MIN_FLOOR || line.slope() > MAX_GROWTH {
            return None;
        }
        let all: f32 = self.weights.iter().sum();
        let middle = weighted_median(&self.weights, 0.5)?;
        let reach = (AGREEMENT / BIN) as usize;
        let (first, last) = (middle.saturating_sub(reach), (middle + reach).min(BINS - 1));
        let (below, agreeing) = (&self.weights[..first], &self.weights[first..=last]);
        let share = |weights: &[f32]| weights.iter().sum::<f32>() / all;
        if share(agreeing) < MIN_AGREEING || share(below) > MAX_BELOW {
            return None;
        }
        let quantile = |part| weighted_median(agreeing, part).map(|bin| log_of(first + bin));
        let (low, middle, high) = (quantile(0.25)?, quantile(0.5)?, quantile(0.75)?);
        let ratio = middle.exp();
        let is_possible = (MIN_SCALE_FACTOR..=MAX_SCALE_FACTOR).contains(&ratio);
        is_possible.then_some(FloorRatio { ratio, spread: (high - low) / 2.0, floor_fraction })
    }

    /// Adds up the weights of the floor's ratios by their logarithm; returns how many samples show floor, and
    /// how their ratios grow with distance.
    fn count(&mut self, image: &DepthImage<'_>, labels: &[u8]) -> (usize, LineSums) {
        let Self { samples, weights, roles, .. } = self;
        weights.fill(0.0);
        let (mut floor, mut line) = (0, LineSums::default());
        for &FloorPixel { pixel, true_m, log_true, weight } in samples.iter() {
            let pixel = pixel as usize;
            let ratio = true_m / image.depth_m[pixel];
            // False for NaN.
            if roles.of(labels[pixel]) == Role::Floor && ratio > 0.0 && ratio < f32::INFINITY {
                let confidence = image.confidence.and_then(|confidence| confidence.get(pixel));
                let certainty = confidence.map_or(1.0, |&confidence| f32::from(confidence) / 255.0);
                let log = ratio.ln();
                weights[bin_of(log)] += weight * certainty;
                line.add(log_true, log, weight * certainty);
                floor += 1;
            }
        }
        (floor, line)
    }
}

/// The bin of a logarithm; those beyond the ends are in the last ones.
fn bin_of(log: f32) -> usize {
    (log / BIN + BINS as f32 / 2.0).clamp(0.0, (BINS - 1) as f32) as usize
}

/// The logarithm in the middle of a bin.
fn log_of(bin: usize) -> f32 {
    (bin as f32 + 0.5 - BINS as f32 / 2.0) * BIN
}

/// The bin in which the sum of the weights passes `part` of the whole.
fn weighted_median(weights: &[f32], part: f32) -> Option<usize> {
    let half = part * weights.iter().sum::<f32>();
    let mut sum = 0.0;
    weights.iter().position(|weight| {
        sum += weight;
        *weight > 0.0 && sum >= half
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Intrinsics;

    const SIZE: (u32, u32) = (160, 120);
    const FLOOR: u8 = 1;

    fn gauge(height_m: f64, pitch_rad: f64) -> FloorGauge {
        let camera = Camera::pinhole(Intrinsics::new(130.0, 130.0, 79.5, 59.5, SIZE.0, SIZE.1).unwrap());
        let mount = Mount::new([0.0, 0.0, height_m], [0.0, pitch_rad, 0.0]).unwrap();
        FloorGauge::new(&camera, mount, &["wall".to_owned(), "floor".to_owned()]).unwrap()
    }

    /// Depth of level planes at the given heights, side by side, all labeled floor; a wall 4 m ahead.
    fn scene(gauge: &FloorGauge, camera_m: f32, planes_m: &[f32]) -> (Vec<f32>, Vec<u8>) {
        let width = SIZE.0 as usize;
        let pixel = |(index, &[_, y]): (usize, &[f32; 2])| {
            let plane_m = planes_m[index % width * planes_m.len() / width];
            let depth = if y > 0.0 { (camera_m - plane_m) / y } else { f32::INFINITY };
            if depth < 4.0 { (depth, FLOOR) } else { (4.0, 0) }
        };
        gauge.rays.rays().iter().enumerate().map(pixel).unzip()
    }

    fn measured(planes_m: &[f32], factor: f32) -> Option<FloorRatio> {
        let mut gauge = gauge(0.5, 0.0);
        let (mut depth_m, labels) = scene(&gauge, 0.5, planes_m);
        depth_m.iter_mut().for_each(|depth| *depth *= factor);
        gauge.measure(&DepthImage { depth_m: &depth_m, labels: Some(&labels), confidence: None })
    }

    #[test]
    fn depth_that_is_too_far_or_too_near_is_corrected() {
        for factor in [0.3, 0.5, 0.8, 1.0, 1.3, 2.0, 4.0] {
            let found = measured(&[0.0], factor).unwrap();
            assert!((found.ratio * factor - 1.0).abs() < 0.004, "{factor}: {found:?}");
            assert!(found.spread < 0.01 && found.floor_fraction > 0.2, "{found:?}");
        }
    }

    #[test]
    fn a_table_that_is_labeled_floor_does_not_become_the_floor() {
        let found = measured(&[0.0, 0.0, 0.25], 1.5).unwrap();
        assert!((found.ratio * 1.5 - 1.0).abs() < 0.01, "{found:?}");
        assert_eq!(measured(&[0.0, 0.25, 0.25], 1.5), None, "floor below what would be floor");
    }

    #[test]
    fn a_wall_that_is_labeled_floor_says_nothing() {
        let mut gauge = gauge(0.5, 0.0);
        let (depth_m, labels) = (vec![2.0; 160 * 120], vec![FLOOR; 160 * 120]);
        let image = DepthImage { depth_m: &depth_m, labels: Some(&labels), confidence: None };
        assert_eq!(gauge.measure(&image), None);
    }

    #[test]
    fn without_floor_labels_or_depth_there_is_no_ratio() {
        let mut gauge = gauge(0.5, 0.0);
        let (depth_m, labels) = scene(&gauge, 0.5, &[0.0]);
        let mut ratio = |depth_m: &[f32], labels: Option<&[u8]>| {
            gauge.measure(&DepthImage { depth_m, labels, confidence: None })
        };
        assert!(ratio(&depth_m, Some(&labels)).is_some());
        assert_eq!(ratio(&depth_m, None), None);
        assert_eq!(ratio(&depth_m, Some(&vec![0; labels.len()])), None);
        assert_eq!(ratio(&vec![f32::NAN; depth_m.len()], Some(&labels)), None);
        assert_eq!(ratio(&vec![0.0; depth_m.len()], Some(&labels)), None);
        assert_eq!(ratio(&depth_m[1..], Some(&labels)), None);
    }

    #[test]
    fn the_attitude_counts_and_a_new_one_is_taken() {
        let level = gauge(0.5, 0.0);
        let (depth_m, labels) = scene(&level, 0.5, &[0.0]);
        let image = DepthImage { depth_m: &depth_m, labels: Some(&labels), confidence: None };
        let mut tilted = gauge(0.5, 0.3);
        let wrong = tilted.measure(&image).map_or(0.0, |found| found.ratio);
        assert!((wrong - 1.0).abs() > 0.1, "{wrong}");
        tilted.set_mount(Mount::new([0.0, 0.0, 0.5], [0.0; 3]).unwrap());
        assert!((tilted.measure(&image).unwrap().ratio - 1.0).abs() < 0.004);
    }

    #[test]
    fn a_camera_that_looks_up_has_no_floor_in_view() {
        assert_eq!(gauge(0.5, -1.2).floor_in_view(), 0.0);
        assert!(gauge(0.5, 0.3).floor_in_view() > 0.3);
    }
}
