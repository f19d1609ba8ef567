#![expect(clippy::unwrap_used, reason = "helpers of tests are tests")]

//! Obstacles on the rendered drive of `models/drive`, whose depth, labels and poses are exact.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use nunet_core::camera::{Camera, Intrinsics, Mount, RayTable};
use nunet_core::depth::DepthImage;
use nunet_core::obstacle::{ObstacleDetector, ObstacleOptions, ObstacleSector, Obstacles, SectorState};
use nunet_types::NYU13_CLASSES;

const SIZE: (u32, u32) = (320, 240);
const FLOOR: u8 = 4;
const CEILING: u8 = 2;
const TV: u8 = 10;
const WINDOW: u8 = 12;

fn drive() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/drive")
}

fn camera() -> Camera {
    Camera::pinhole(Intrinsics::new(262.0, 262.0, 160.3, 119.2, SIZE.0, SIZE.1).unwrap())
}

struct DriveFrame {
    id: String,
    depth_m: Vec<f32>,
    labels: Vec<u8>,
    /// Where the camera really is: over its own place on the floor, looking along x.
    mount: Mount,
}

/// Every `step`-th frame.
fn frames(step: usize) -> Vec<DriveFrame> {
    let poses = std::fs::read_to_string(drive().join("poses.csv")).unwrap();
    poses.lines().skip(1).step_by(step).map(frame).collect()
}

fn frame(row: &str) -> DriveFrame {
    let (id, numbers) = row.split_once(',').unwrap();
    let matrix: Vec<f64> = numbers.split(',').map(|number| number.parse().unwrap()).collect();
    let folder = drive();
    let depth = image::open(folder.join(format!("depth/{id}.png"))).unwrap().into_luma16().into_raw();
    let meters = |mm: u16| if mm == 0 { f32::NAN } else { f32::from(mm) / 1000.0 };
    DriveFrame {
        id: id.to_owned(),
        depth_m: depth.into_iter().map(meters).collect(),
        labels: image::open(folder.join(format!("labels/{id}.png"))).unwrap().into_luma8().into_raw(),
        mount: mount_of(&matrix),
    }
}

/// Roll and pitch of a pose, row by row: the world's z of the camera's axes right, down and ahead.
fn mount_of(matrix: &[f64]) -> Mount {
    let (right, down, ahead, height) = (matrix[8], matrix[9], matrix[10], matrix[11]);
    let (pitch, roll) = ((-ahead).asin(), (-right).atan2(-down));
    Mount::new([0.0, 0.0, height], [roll, pitch, 0.0]).unwrap()
}

/// Pixels of a sector that make an obstacle: fewer are a corner of something in the next sector.
const MIN_PIXELS: usize = 4;

/// The distance of the `rank`-th nearest point in each sector that is higher than `lowest_m` and lower than
/// the robot: of every pixel, by its true place, without windows and screens.
fn true_ranges(frame: &DriveFrame, found: &Obstacles, lowest_m: f64, rank: usize) -> Vec<f64> {
    let mut ranges = vec![vec![f64::INFINITY; rank]; found.sectors.len()];
    let rays = RayTable::new(&camera());
    for ((&[x, y], &depth), label) in rays.rays().iter().zip(&frame.depth_m).zip(&frame.labels) {
        let [right, down, depth] = [x, y, 1.0].map(|value| f64::from(value * depth));
        let [x, y, z] = frame.mount.to_base([right, down, depth]);
        if (lowest_m..1.8).contains(&z) && ![FLOOR, CEILING, TV, WINDOW].contains(label) {
            let angle = (y.atan2(x) - f64::from(found.angle_min_rad) + TAU) % TAU;
            let sector = (angle / f64::from(found.angle_step_rad)) as usize;
            if let Some(ranges) = ranges.get_mut(sector) {
                ranges.push(x.hypot(y));
            }
        }
    }
    let nearest = |mut ranges: Vec<f64>| {
        ranges.sort_unstable_by(f64::total_cmp);
        ranges[rank - 1]
    };
    ranges.into_iter().map(nearest).collect()
}

fn detector(mount: Mount) -> ObstacleDetector {
    let classes = NYU13_CLASSES.map(str::to_owned);
    ObstacleDetector::new(&camera(), mount, &classes, ObstacleOptions::default()).unwrap()
}

fn image<'a>(frame: &'a DriveFrame, with_labels: bool) -> DepthImage<'a> {
    let labels = with_labels.then_some(&frame.labels[..]);
    DepthImage { depth_m: &frame.depth_m, labels, confidence: None }
}

#[test]
fn the_axes_of_a_pose_are_those_of_the_mount() {
    let level = mount_of(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.25]);
    assert_eq!(level.roll_pitch_yaw_rad().map(|angle| angle.abs() < 1e-9), [true; 3]);
    let (sin, cos) = (0.1_f64.sin(), 0.1_f64.cos());
    let up = mount_of(&[1.0, 0.0, 0.0, 0.0, 0.0, sin, cos, 0.0, 0.0, -cos, sin, 0.25]);
    assert!((up.roll_pitch_yaw_rad()[1] + 0.1).abs() < 1e-9);
}

#[test]
fn the_ground_is_found_within_a_degree_and_2_cm_from_a_nominal_mount() {
    let nominal = Mount::new([0.0, 0.0, 0.25], [0.0, -4_f64.to_radians(), 0.0]).unwrap();
    let mut refined = 0;
    let frames = frames(10);
    for frame in &frames {
        for with_labels in [true, false] {
            let mut detector = detector(nominal);
            let ground = detector.detect(&image(frame, with_labels), 0).unwrap().ground;
            let [roll, pitch, _] = frame.mount.roll_pitch_yaw_rad();
            let [_, nominal_pitch, _] = nominal.roll_pitch_yaw_rad();
            let degrees = |slope: f32| f64::from(slope.atan()).to_degrees();
            let wrong_x = degrees(ground.slope_x) - (pitch - nominal_pitch).to_degrees();
            let wrong_y = degrees(ground.slope_y) + roll.to_degrees();
            let wrong_height = f64::from(ground.height_m) - (0.25 - frame.mount.height_m());
            let context = format!("{} {ground:?} {wrong_x:.2} {wrong_y:.2} {wrong_height:.3}", frame.id);
            assert!(wrong_x.abs() < 1.0 && wrong_y.abs() < 1.0 && wrong_height.abs() < 0.02, "{context}");
            refined += usize::from(ground.is_refined);
        }
    }
    assert!(refined as f64 > 0.8 * 2.0 * frames.len() as f64, "{refined} of {}", 2 * frames.len());
}

#[test]
fn sectors_are_right_within_5_cm_and_never_wrongly_free() {
    let (mut occupied, mut right, mut near, mut found_near) = (0, 0, 0, 0);
    for frame in frames(10) {
        for with_labels in [true, false] {
            let mut detector = detector(frame.mount);
            let found = detector.detect(&image(&frame, with_labels), 0).unwrap();
            // What is between the clearance and 2 cm more may count or not.
            let (high, all) =
                (true_ranges(&frame, found, 0.07, MIN_PIXELS), true_ranges(&frame, found, 0.05, 1));
            for (index, sector) in found.sectors.iter().enumerate() {
                let context =
                    format!("{} sector {index}: {} {} {sector:?}", frame.id, all[index], high[index]);
                assert_free(sector, high[index], &context);
                if sector.state() == SectorState::Occupied {
                    occupied += 1;
                    let range = f64::from(sector.range_m);
                    let fits = (all[index] - 0.05..=high[index] + 0.05).contains(&range);
                    right += usize::from(fits);
                }
                if high[index] < 2.0 {
                    near += 1;
                    found_near += usize::from(f64::from(sector.obstacle_m) < high[index] + 0.05);
                }
            }
        }
    }
    println!(
        "{right} of {occupied} occupied sectors within 5 cm; {found_near} of {near} nearer than 2 m found"
    );
    assert!(right as f64 > 0.97 * f64::from(occupied), "{right} of {occupied}");
    assert!(found_near as f64 > 0.99 * f64::from(near), "{found_near} of {near}");
}

fn assert_free(sector: &ObstacleSector, truth: f64, context: &str) {
    assert!(f64::from(sector.range_m) < truth + 0.05, "wrongly free: {context}");
}
