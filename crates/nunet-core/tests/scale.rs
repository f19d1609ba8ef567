#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "helpers of tests are tests, and the figures are printed"
)]

//! The scale that the floor says, on the rendered drive of `models/drive`, whose depth, labels and poses are
//! exact.
//!
//! `cargo test -p nunet-core --test scale -- --nocapture` prints the figures of the book's page "Scale".

use std::path::{Path, PathBuf};

use nunet_core::camera::{Camera, Intrinsics, Mount};
use nunet_core::depth::DepthImage;
use nunet_core::scale::FloorGauge;
use nunet_types::NYU13_CLASSES;

/// Depth is multiplied by each of them.
const FACTORS: [f32; 5] = [0.5, 0.7, 1.0, 1.4, 2.0];
const FLOOR: u8 = 4;

/// Counts over images times factors.
#[derive(Debug, Default)]
struct Tally {
    /// Where floor covers 10 % of the image, and where it does not.
    much: Cases,
    little: Cases,
}

#[derive(Debug, Default)]
struct Cases {
    images: usize,
    measured: usize,
    within_5_percent: usize,
    worse_by_2_percent: usize,
    worst: f32,
}

impl Cases {
    fn add(&mut self, ratio: Option<f32>, factor: f32) {
        let wrong = |scale: f32| (scale - 1.0).abs();
        self.images += 1;
        self.measured += usize::from(ratio.is_some());
        let (before, after) = (wrong(factor), ratio.map_or(wrong(factor), |ratio| wrong(factor * ratio)));
        self.within_5_percent += usize::from(after <= 0.05);
        self.worse_by_2_percent += usize::from(after > before + 0.02);
        self.worst = self.worst.max(if ratio.is_some() { after } else { 0.0 });
    }
}

impl Tally {
    fn add(&mut self, gauge: &mut FloorGauge, (depth_m, labels): (&[f32], &[u8])) {
        let floor = labels.iter().filter(|label| **label == FLOOR).count();
        let cases = if 10 * floor >= labels.len() { &mut self.much } else { &mut self.little };
        for factor in FACTORS {
            let scaled: Vec<f32> = depth_m.iter().map(|depth| depth * factor).collect();
            let image = DepthImage { depth_m: &scaled, labels: Some(labels), confidence: None };
            cases.add(gauge.measure(&image).map(|found| found.ratio), factor);
        }
    }
}

fn drive() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/drive")
}

fn pixels(folder: &Path, id: &str) -> (Vec<f32>, Vec<u8>) {
    let depth = image::open(folder.join(format!("depth/{id}.png"))).unwrap().into_luma16().into_raw();
    let meters = |mm: u16| if mm == 0 { f32::NAN } else { f32::from(mm) / 1000.0 };
    let labels = image::open(folder.join(format!("labels/{id}.png"))).unwrap().into_luma8().into_raw();
    (depth.into_iter().map(meters).collect(), labels)
}

/// The camera's real mount in a row of `poses.csv`: 3x4, row by row, with the world's z of the axes right,
/// down and ahead.
fn real_mount(numbers: &str) -> Mount {
    let matrix: Vec<f64> = numbers.split(',').map(|number| number.parse().unwrap()).collect();
    let (right, down, ahead, height) = (matrix[8], matrix[9], matrix[10], matrix[11]);
    Mount::new([0.0, 0.0, height], [(-right).atan2(-down), (-ahead).asin(), 0.0]).unwrap()
}

/// All images, with the nominal mount or with the real one of each image.
fn tally(is_real: bool) -> Tally {
    let camera = Camera::pinhole(Intrinsics::new(262.0, 262.0, 160.3, 119.2, 320, 240).unwrap());
    let nominal = Mount::new([0.0, 0.0, 0.25], [0.0, -4_f64.to_radians(), 0.0]).unwrap();
    let mut gauge = FloorGauge::new(&camera, nominal, &NYU13_CLASSES.map(str::to_owned)).unwrap();
    let mut tally = Tally::default();
    let poses = std::fs::read_to_string(drive().join("poses.csv")).unwrap();
    for row in poses.lines().skip(1).step_by(10) {
        let (id, numbers) = row.split_once(',').unwrap();
        if is_real {
            gauge.set_mount(real_mount(numbers));
        }
        let (depth_m, labels) = pixels(&drive(), id);
        tally.add(&mut gauge, (&depth_m, &labels));
    }
    println!("real mount: {is_real} {tally:#?}");
    tally
}

#[test]
fn the_floor_of_the_drive_gives_the_scale_within_5_percent() {
    for is_real in [true, false] {
        let tally = tally(is_real);
        assert!(tally.much.images >= 100, "{tally:?}");
        assert!(tally.much.within_5_percent as f64 >= 0.9 * tally.much.images as f64, "{tally:?}");
        assert_eq!(tally.little.worse_by_2_percent, 0, "{tally:?}");
        assert!(!is_real || tally.much.worse_by_2_percent == 0, "{tally:?}");
    }
}

/// Only the upper part of each image: little floor, or none.
#[test]
fn with_little_floor_nothing_becomes_worse() {
    let camera = Camera::pinhole(Intrinsics::new(262.0, 262.0, 160.3, 119.2, 320, 140).unwrap());
    let classes = NYU13_CLASSES.map(str::to_owned);
    let mut tally = Tally::default();
    let poses = std::fs::read_to_string(drive().join("poses.csv")).unwrap();
    for row in poses.lines().skip(1).step_by(10) {
        let (id, numbers) = row.split_once(',').unwrap();
        let mut gauge = FloorGauge::new(&camera, real_mount(numbers), &classes).unwrap();
        let (depth_m, labels) = pixels(&drive(), id);
        tally.add(&mut gauge, (&depth_m[..320 * 140], &labels[..320 * 140]));
    }
    println!("{tally:#?}");
    assert!(tally.little.images >= 50, "{tally:?}");
    assert_eq!(tally.little.worse_by_2_percent + tally.much.worse_by_2_percent, 0, "{tally:?}");
}
