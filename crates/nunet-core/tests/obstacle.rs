#![expect(clippy::unwrap_used, reason = "helpers of tests are tests")]

//! Exact scenes: floor, boxes, stairs and a table, ray by ray, and what must come out.

use nunet_core::ErrorKind;
use nunet_core::camera::{Camera, Intrinsics, Mount, RayTable};
use nunet_core::depth::DepthImage;
use nunet_core::obstacle::{
    Ground, ObstacleDetector, ObstacleError, ObstacleOptions, ObstaclePoint, ObstacleSector, Obstacles,
    SectorState,
};
use nunet_types::{NO_LABEL, NYU13_CLASSES};
use proptest::prelude::*;

const SIZE: (u32, u32) = (320, 240);
const PIXELS: usize = (SIZE.0 * SIZE.1) as usize;
const FLOOR: u8 = 4;
const WALL: u8 = 11;
const TABLE: u8 = 9;
const WINDOW: u8 = 12;

/// An axis-aligned box in the base frame, with a class.
#[derive(Debug, Clone, Copy)]
struct Block {
    min: [f64; 3],
    max: [f64; 3],
    label: u8,
}

impl Block {
    const fn new(x: (f64, f64), y: (f64, f64), z: (f64, f64), label: u8) -> Self {
        Self { min: [x.0, y.0, z.0], max: [x.1, y.1, z.1], label }
    }

    /// Where a ray enters, in multiples of its direction.
    fn hit(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<f64> {
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let a = (self.min[axis] - origin[axis]) / direction[axis];
            let b = (self.max[axis] - origin[axis]) / direction[axis];
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        (enter <= leave && enter > 0.0).then_some(enter)
    }
}

/// The floor of all scenes: 20 m x 20 m, its top at 0.
const GROUND: Block = Block::new((-10.0, 10.0), (-10.0, 10.0), (-0.01, 0.0), FLOOR);

fn camera() -> Camera {
    Camera::pinhole(Intrinsics::new(262.0, 262.0, 160.3, 119.2, SIZE.0, SIZE.1).unwrap())
}

fn mount(height_m: f64, pitch_deg: f64) -> Mount {
    rolled(height_m, pitch_deg, 0.0)
}

fn rolled(height_m: f64, pitch_deg: f64, roll_deg: f64) -> Mount {
    Mount::new([0.0, 0.0, height_m], [roll_deg.to_radians(), pitch_deg.to_radians(), 0.0]).unwrap()
}

/// Depth and labels as the camera sees the scene.
fn render(mount: &Mount, scene: &[Block]) -> (Vec<f32>, Vec<u8>) {
    let rays = RayTable::new(&camera());
    let pixel = |&[x, y]: &[f32; 2]| {
        let (origin, end) = (mount.position_m(), mount.to_base([f64::from(x), f64::from(y), 1.0]));
        let direction = [0, 1, 2].map(|axis| end[axis] - origin[axis]);
        let hits = scene.iter().filter_map(|block| Some((block.hit(origin, direction)?, block.label)));
        hits.min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or((f32::NAN, NO_LABEL), |(depth, label)| (depth as f32, label))
    };
    rays.rays().iter().map(pixel).unzip()
}

fn detector(mount: Mount, options: ObstacleOptions) -> ObstacleDetector {
    let classes = NYU13_CLASSES.map(str::to_owned);
    ObstacleDetector::new(&camera(), mount, &classes, options).unwrap()
}

/// What a scene gives with labels, and without.
fn obstacles(mount: Mount, scene: &[Block]) -> [Obstacles; 2] {
    let (depth_m, labels) = render(&mount, scene);
    [Some(&labels[..]), None].map(|labels| {
        let mut detector = detector(mount, ObstacleOptions::default());
        let image = DepthImage { depth_m: &depth_m, labels, confidence: None };
        detector.detect(&image, 0).unwrap().clone()
    })
}

/// Rays per sector of the true range: one pixel of the camera is about ten.
const RAYS: usize = 40;

/// Obstacles along the rays of a sector by the blocks' footprints, meters; infinite for none.
fn true_ranges(found: &Obstacles, sector: usize, scene: &[Block]) -> Vec<f64> {
    let range = |ray: usize| {
        let share = sector as f64 + ray as f64 / RAYS as f64;
        let angle = f64::from(found.angle_min_rad) + f64::from(found.angle_step_rad) * share;
        let direction = [angle.cos(), angle.sin(), 1e-12];
        let in_way = scene.iter().filter(|block| block.max[2] > 0.06 && block.min[2] < 1.79);
        let hits = in_way.filter_map(|block| {
            let flat = Block {
                min: [block.min[0], block.min[1], -1.0],
                max: [block.max[0], block.max[1], 1.0],
                ..*block
            };
            flat.hit([0.0, 0.0, 0.0], direction)
        });
        hits.fold(f64::INFINITY, f64::min)
    };
    (0..=RAYS).map(range).collect()
}

/// The nearest obstacle that fills half of the sector: a narrower one, and the part of an oblique side that
/// is nearer, may be less than a pixel.
fn surely_seen_m(ranges: &[f64]) -> f64 {
    let halves = ranges.windows(RAYS / 2 + 1).map(|half| half.iter().copied().fold(0.0, f64::max));
    halves.fold(f64::INFINITY, f64::min)
}

/// Every sector within 5 cm of the truth, or unknown; none free past an obstacle.
fn check_sectors(found: &Obstacles, scene: &[Block]) {
    for (index, sector) in found.sectors.iter().enumerate() {
        let ranges = true_ranges(found, index, scene);
        let nearest = ranges.iter().copied().fold(f64::INFINITY, f64::min);
        let truth = surely_seen_m(&ranges);
        let context = format!("sector {index}: {truth:.3} m, {sector:?}");
        let range_m = f64::from(sector.range_m);
        if sector.state() == SectorState::Occupied {
            assert!(range_m > nearest - 0.05, "nearer than {nearest:.3} m: {context}");
        }
        // What is nearer than the nearest visible floor may be below the image: all of it, or the front of
        // it.
        let may_be_hidden = truth < f64::from(sector.seen_from_m);
        assert!(may_be_hidden || range_m < truth + 0.05, "wrongly free: {context}");
    }
}

fn slope_deg(ground: &Ground) -> f32 {
    ground.slope_x.hypot(ground.slope_y).atan().to_degrees()
}

fn count(found: &Obstacles, state: SectorState) -> usize {
    found.sectors.iter().filter(|sector| sector.state() == state).count()
}

#[test]
fn an_empty_floor_is_free_up_to_the_range() {
    for found in obstacles(mount(0.25, -4.0), &[GROUND]) {
        assert!(found.ground.is_refined && slope_deg(&found.ground) < 0.1, "{:?}", found.ground);
        // The camera looks up: near the robot, a part of the outermost sectors is out of view.
        let (edges, inner) = ([found.sectors[0], found.sectors[71]], &found.sectors[1..71]);
        assert_eq!(edges.map(|sector| sector.state()), [SectorState::Unknown; 2]);
        assert_eq!(count(&found, SectorState::Free), 70);
        assert!(inner.iter().all(|sector| (4.0..5.1).contains(&sector.range_m)), "{inner:?}");
        assert!(found.sectors.iter().all(|sector| (0.5..1.0).contains(&sector.seen_from_m)));
        assert_eq!(found.points, []);
    }
}

#[test]
fn boxes_before_a_wall_are_found_where_they_are() {
    let scene = [
        GROUND,
        Block::new((3.0, 3.1), (-9.0, 9.0), (0.0, 2.5), WALL),
        Block::new((1.5, 1.8), (-0.3, 0.0), (0.0, 0.2), TABLE),
        Block::new((1.0, 1.1), (0.3, 0.4), (0.0, 0.07), TABLE),
    ];
    for (height_m, pitch_deg) in [(0.25, -4.0), (0.25, 5.0), (0.6, 15.0), (1.2, 30.0)] {
        for found in obstacles(mount(height_m, pitch_deg), &scene) {
            check_sectors(&found, &scene);
            let occupied = count(&found, SectorState::Occupied);
            // A camera that looks down sees only floor in its lower corners.
            assert!(occupied >= if pitch_deg < 10.0 { 68 } else { 20 }, "{height_m} m: {occupied} sectors");
            let near = found.sectors.iter().filter(|sector| sector.obstacle_m < 1.9).count();
            assert!(near >= 15, "{height_m} m, {pitch_deg} degrees: {near} sectors see the boxes");
            assert!(!found.points.is_empty() && found.points.len() <= 5000);
            assert!(found.points.iter().all(|point| (0.04..1.85).contains(&point.height)));
        }
    }
}

#[test]
fn no_sector_is_free_past_a_box_that_is_partly_out_of_view() {
    let mounts = [
        mount(0.3, -6.0),
        mount(0.4, 12.0),
        mount(0.9, 30.0),
        rolled(0.5, 10.0, 8.0),
        rolled(0.8, 20.0, -15.0),
        rolled(0.4, 5.0, 25.0),
        rolled(0.5, 10.0, 90.0),
        Mount::new([0.1, 0.15, 0.4], [0.0, 0.2, 0.1]).unwrap(),
    ];
    for mount in mounts {
        let mut detector = detector(mount, ObstacleOptions::default());
        let (first_rad, step_rad) = (detector.last().angle_min_rad, detector.last().angle_step_rad);
        let sectors = [0.3, 0.7, 1.5, 4.2].into_iter().flat_map(|edge| [edge, 72.0 - edge]);
        let angles = sectors.map(|sector| f64::from(first_rad) + f64::from(step_rad) * sector);
        let places = angles.flat_map(|angle| [0.6, 1.0, 1.8, 3.3].map(|range_m| (angle, range_m)));
        for (angle, range_m) in places {
            let (x, y, half) = (range_m * angle.cos(), range_m * angle.sin(), 0.02 + 0.02 * range_m);
            let small = Block::new((x - half, x + half), (y - half, y + half), (0.0, 0.1), TABLE);
            let (depth_m, _) = render(&mount, &[GROUND, small]);
            let image = DepthImage { depth_m: &depth_m, labels: None, confidence: None };
            check_sectors(detector.detect(&image, 0).unwrap(), &[GROUND, small]);
        }
    }
}

#[test]
fn sectors_at_the_edge_of_the_view_are_free_as_far_as_their_whole_width_is_in_view() {
    let [found, _] = obstacles(mount(0.9, 30.0), &[GROUND]);
    let ranges: Vec<f32> = found.sectors.iter().map(|sector| sector.range_m).collect();
    assert!(ranges[..12].is_sorted() && ranges[60..].is_sorted_by(|a, b| a >= b), "{ranges:?}");
    assert!(
        ranges[1] < 1.0 && ranges[70] < 1.0 && ranges[12..60].iter().all(|range_m| *range_m > 4.0),
        "{ranges:?}"
    );
    assert!(found.sectors[12..60].iter().all(|sector| sector.state() == SectorState::Free));
    assert_eq!([0, 71].map(|edge| found.sectors[edge].state()), [SectorState::Unknown; 2]);
}

#[test]
fn a_box_has_its_heights_and_its_class() {
    let scene = [GROUND, Block::new((1.5, 1.8), (-0.3, 0.3), (0.0, 0.4), TABLE)];
    let [with_labels, without] = obstacles(mount(0.5, 5.0), &scene);
    let ahead = with_labels.sectors[36];
    assert_eq!((ahead.state(), ahead.label, with_labels.used_labels), (SectorState::Occupied, TABLE, true));
    assert!((ahead.max_height_m - 0.4).abs() < 0.03 && ahead.min_height_m < 0.1, "{ahead:?}");
    let is_table = |point: &ObstaclePoint| point.label == TABLE && point.confidence == 255;
    assert!(!with_labels.points.is_empty() && with_labels.points.iter().all(is_table));
    assert_eq!((without.sectors[36].label, without.used_labels), (NO_LABEL, false));
}

#[test]
fn a_table_top_counts_although_the_floor_below_it_is_free() {
    let legs = |y: f64| Block::new((1.2, 1.25), (y, y + 0.05), (0.0, 0.7), TABLE);
    let scene = [
        GROUND,
        Block::new((1.2, 2.0), (-0.6, 0.6), (0.7, 0.75), TABLE),
        legs(-0.6),
        legs(0.55),
        Block::new((4.0, 4.1), (-9.0, 9.0), (0.0, 2.5), WALL),
    ];
    for found in obstacles(mount(0.25, -10.0), &scene) {
        check_sectors(&found, &scene);
        let ahead = found.sectors[36];
        assert!((ahead.range_m - 1.2).abs() < 0.05 && ahead.min_height_m > 0.6, "{ahead:?}");
    }
}

#[test]
fn objects_that_the_robot_passes_under_or_drives_over_are_no_obstacles() {
    let scene = [
        GROUND,
        Block::new((1.0, 2.0), (-1.0, 1.0), (1.9, 2.0), WALL),
        Block::new((1.0, 1.3), (-1.0, 1.0), (0.0, 0.03), TABLE),
    ];
    for found in obstacles(mount(0.5, -10.0), &scene) {
        assert_eq!(found.points, []);
        assert_eq!(count(&found, SectorState::Occupied), 0);
        assert!(count(&found, SectorState::Free) > 60);
    }
}

#[test]
fn stairs_and_an_edge_are_drops() {
    let floor = Block::new((-10.0, 1.5), (-10.0, 10.0), (-0.01, 0.0), FLOOR);
    let step = |i: i32| {
        let (x, z) = (1.5 + 0.28 * f64::from(i), -0.17 * f64::from(i + 1));
        Block::new((x, x + 0.28), (-10.0, 10.0), (z - 3.0, z), FLOOR)
    };
    let landing = Block::new((-10.0, 60.0), (-30.0, 30.0), (-2.1, -2.05), FLOOR);
    let stairs: Vec<Block> = [floor, landing].into_iter().chain((0..12).map(step)).collect();
    let cliff = [floor, Block::new((-10.0, 30.0), (-10.0, 10.0), (-2.1, -2.0), FLOOR)];
    for scene in [&stairs[..], &cliff[..]] {
        for (height_m, pitch_deg) in [(0.4, 10.0), (0.8, 20.0)] {
            for found in obstacles(mount(height_m, pitch_deg), scene) {
                let drops = count(&found, SectorState::Drop);
                assert!(drops > 60, "{height_m} m: {drops} sectors, {:?}", found.sectors[36]);
                for (index, sector) in found.sectors.iter().enumerate() {
                    let angle = found.angle_min_rad + (index as f32 + 0.5) * found.angle_step_rad;
                    let edge = 1.5 / angle.cos();
                    let is_right = match sector.state() {
                        SectorState::Drop => (sector.range_m - edge).abs() < 0.1,
                        _ => sector.range_m < edge + 0.05,
                    };
                    assert!(is_right, "{edge} m, {sector:?}");
                }
            }
        }
    }
}

#[test]
fn glass_is_unknown_and_a_window_in_a_wall_is_wall() {
    // Depth sees through the pane: the labels know.
    let (mut depth_m, mut labels) = render(&mount(0.25, -4.0), &[GROUND]);
    let pane = Block::new((1.5, 1.51), (-9.0, 9.0), (0.0, 2.2), WINDOW);
    let (pane_depth, _) = render(&mount(0.25, -4.0), &[pane]);
    for ((label, pane), depth) in labels.iter_mut().zip(&pane_depth).zip(&mut depth_m) {
        if !pane.is_nan() && (depth.is_nan() || *depth > *pane) {
            *label = WINDOW;
        }
    }
    let mut detector = detector(mount(0.25, -4.0), ObstacleOptions::default());
    let image = DepthImage { depth_m: &depth_m, labels: Some(&labels), confidence: None };
    let found = detector.detect(&image, 0).unwrap();
    for sector in &found.sectors {
        assert_eq!(sector.state(), SectorState::Unknown, "{sector:?}");
        assert!(sector.range_m < 1.85, "{sector:?}");
    }

    let wall = Block::new((3.0, 3.1), (-9.0, 9.0), (0.0, 2.5), WALL);
    let window = Block::new((2.99, 3.0), (-0.5, 0.5), (0.8, 2.0), WINDOW);
    let [found, _] = obstacles(mount(0.25, -4.0), &[GROUND, wall, window]);
    assert_eq!(count(&found, SectorState::Occupied), 70, "all but the outermost");
    let screen = Block::new((1.2, 1.25), (-0.5, 0.5), (0.5, 1.0), 10);
    let [found, _] = obstacles(mount(0.25, -10.0), &[GROUND, wall, screen]);
    assert_eq!(found.sectors[36].state(), SectorState::Unknown, "a hanging screen");
    assert!(found.sectors[36].range_m < 1.25);
}

#[test]
fn pixels_without_depth_are_never_free() {
    let (mut depth_m, labels) = render(&mount(0.25, -4.0), &[GROUND]);
    for row in depth_m.chunks_mut(SIZE.0 as usize) {
        row[..160].fill(f32::NAN);
    }
    let mut detector = detector(mount(0.25, -4.0), ObstacleOptions::default());
    let image = DepthImage { depth_m: &depth_m, labels: Some(&labels), confidence: None };
    let found = detector.detect(&image, 0).unwrap();
    let states: Vec<_> = found.sectors.iter().map(ObstacleSector::state).collect();
    assert!(states[1..34].iter().all(|state| *state == SectorState::Free), "right half");
    assert!(states[38..].iter().all(|state| *state == SectorState::Unknown), "left half");
}

#[test]
fn an_image_of_nan_or_nonsense_is_unknown_everywhere() {
    for value in [f32::NAN, 0.0, -1.0, f32::INFINITY] {
        let mut detector = detector(mount(0.25, -4.0), ObstacleOptions::default());
        let image =
            DepthImage { depth_m: &[value; PIXELS], labels: Some(&[FLOOR; PIXELS]), confidence: None };
        let found = detector.detect(&image, 0).unwrap();
        assert_eq!(count(found, SectorState::Unknown), 72, "{value}");
        assert!(found.points.is_empty() && !found.ground.is_refined);
    }
}

#[test]
fn a_camera_that_never_sees_the_floor_reports_it_and_nothing_is_free() {
    let up = mount(0.25, -60.0);
    let detector = crate::detector(up, ObstacleOptions::default());
    assert_eq!(detector.floor_in_view(), 0.0);
    let [found, _] = obstacles(up, &[GROUND]);
    assert_eq!(count(&found, SectorState::Unknown), 72);
    assert!(crate::detector(mount(0.25, -4.0), ObstacleOptions::default()).floor_in_view() > 0.2);
}

#[test]
fn isolated_and_flying_pixels_are_no_obstacles() {
    let (mut depth_m, _) = render(&mount(0.25, -4.0), &[GROUND]);
    for index in (0..PIXELS).step_by(977) {
        depth_m[index] = 0.8; // one pixel of its own in the air, or before the floor
    }
    let mut detector = detector(mount(0.25, -4.0), ObstacleOptions::default());
    let image = DepthImage { depth_m: &depth_m, labels: None, confidence: None };
    assert_eq!(detector.detect(&image, 0).unwrap().points, []);

    // A post in front of a far wall, with depth that flows over its edges as networks draw it.
    let wall = Block::new((4.0, 4.1), (-9.0, 9.0), (0.0, 2.5), WALL);
    let post = Block::new((1.0, 1.1), (-0.1, 0.1), (0.0, 1.5), TABLE);
    let (sharp, _) = render(&mount(0.25, -4.0), &[GROUND, wall, post]);
    let at = |row: usize, column: i64| sharp[row * 320 + column.clamp(0, 319) as usize];
    let smooth: Vec<f32> = (0..PIXELS)
        .map(|index| {
            let (row, column) = (index / 320, (index % 320) as i64);
            (-2..=2).map(|step| at(row, column + step)).sum::<f32>() / 5.0
        })
        .collect();
    let image = DepthImage { depth_m: &smooth, labels: None, confidence: None };
    let found = detector.detect(&image, 0).unwrap();
    let between = found.points.iter().filter(|point| (1.3..3.7).contains(&point.x)).count();
    assert!(between <= 12, "{between} of {} points are in the air", found.points.len());
}

#[test]
fn a_tilt_that_is_not_in_the_mount_is_found_within_a_degree() {
    let scene = [
        GROUND,
        Block::new((3.0, 3.1), (-9.0, 9.0), (0.0, 2.5), WALL),
        Block::new((1.5, 1.8), (-0.3, 0.0), (0.0, 0.2), TABLE),
    ];
    for (pitch_deg, roll_deg) in [(-2.0, 0.0), (2.0, 1.5), (0.5, -2.0)] {
        let truth =
            Mount::new([0.0, 0.0, 0.25], [f64::to_radians(roll_deg), f64::to_radians(pitch_deg), 0.0])
                .unwrap();
        let (depth_m, labels) = render(&truth, &scene);
        for labels in [Some(&labels[..]), None] {
            let mut detector = detector(mount(0.25, 0.0), ObstacleOptions::default());
            let image = DepthImage { depth_m: &depth_m, labels, confidence: None };
            let ground = detector.detect(&image, 0).unwrap().ground;
            // Seen from a camera that is believed to be level, the floor rises where the camera really looks
            // down.
            let tilt = |slope: f32| f64::from(slope.atan().to_degrees());
            assert!((tilt(ground.slope_x) - pitch_deg).abs() < 0.3, "{pitch_deg} {ground:?}");
            assert!((tilt(ground.slope_y) + roll_deg).abs() < 0.5, "{roll_deg} {ground:?}");
            assert!(ground.height_m.abs() < 0.02, "{ground:?}");
        }
    }
}

#[test]
fn a_robot_that_pitches_finds_a_box_at_its_place_only_with_its_attitude() {
    let scene = [GROUND, Block::new((2.0, 2.3), (-0.4, 0.4), (0.0, 0.4), TABLE)];
    let level = Mount::new([0.1, 0.0, 0.4], [0.0, 0.2, 0.0]).unwrap();
    let ahead = |found: &Obstacles| {
        let sector = found.sectors[(-found.angle_min_rad / found.angle_step_rad) as usize];
        (sector.state(), (sector.range_m - 2.0).abs() < 0.05)
    };
    for (roll_rad, pitch_rad) in [(0.0, -0.2), (0.0, 0.2), (0.1, 0.15)] {
        let tilted = level.on_tilted_base(roll_rad, pitch_rad).unwrap();
        let (depth_m, labels) = render(&tilted, &scene);
        for labels in [Some(&labels[..]), None] {
            let mut fresh = detector(tilted, ObstacleOptions::default());
            let mut detector = detector(level, ObstacleOptions::default());
            let image = DepthImage { depth_m: &depth_m, labels, confidence: None };
            let without = detector.detect(&image, 0).unwrap();
            assert_ne!(ahead(without), (SectorState::Occupied, true), "{pitch_rad}");
            detector.set_mount(tilted);
            let with = detector.detect(&image, 0).unwrap();
            assert_eq!(ahead(with), (SectorState::Occupied, true), "{pitch_rad}");
            check_sectors(with, &scene);
            assert!(with.ground.is_refined && slope_deg(&with.ground) < 0.5, "{:?}", with.ground);
            // As text, because unknown values are NaN.
            assert_eq!(format!("{with:?}"), format!("{:?}", fresh.detect(&image, 0).unwrap()));
        }
    }
}

#[test]
fn a_position_on_the_robot_and_a_yaw_turn_the_results() {
    let yaw = 0.5;
    let mount = Mount::new([0.2, 0.1, 0.3], [0.0, 0.05, yaw]).unwrap();
    let scene = [GROUND, Block::new((2.0, 2.1), (1.0, 1.3), (0.0, 0.5), TABLE)];
    for found in obstacles(mount, &scene) {
        assert!((found.angle_min_rad + 36.0 * found.angle_step_rad - yaw as f32).abs() < 0.02);
        check_sectors(&found, &scene);
        assert!(count(&found, SectorState::Occupied) > 5);
        let inside =
            |point: &ObstaclePoint| (1.99..2.11).contains(&point.x) && (0.99..1.31).contains(&point.y);
        assert!(!found.points.is_empty() && found.points.iter().all(inside), "{:?}", found.points);
    }
}

#[test]
fn a_camera_that_looks_straight_down_sees_all_around() {
    let scene = [GROUND, Block::new((0.3, 0.4), (-0.05, 0.05), (0.0, 0.3), TABLE)];
    let down = Mount::new([0.0, 0.0, 1.5], [0.0, std::f64::consts::FRAC_PI_2, 0.0]).unwrap();
    for found in obstacles(down, &scene) {
        assert!((found.angle_step_rad * 72.0 - std::f32::consts::TAU).abs() < 1e-3);
        check_sectors(&found, &scene);
        assert!(count(&found, SectorState::Occupied) >= 2);
        assert!(count(&found, SectorState::Free) > 50, "{:?}", found.sectors);
    }
}

#[test]
fn a_larger_image_gives_what_its_second_pixels_give() {
    let scene = [GROUND, Block::new((1.5, 1.8), (-0.3, 0.3), (0.0, 0.4), TABLE)];
    let (depth_m, labels) = render(&mount(0.5, 5.0), &scene);
    let place = |pixel: usize| (pixel / 640 / 2) * 320 + pixel % 640 / 2;
    // Pixels between the samples do not count.
    let is_sample = |pixel: usize| (pixel / 640).is_multiple_of(2) && pixel.is_multiple_of(2);
    let large_m: Vec<f32> =
        (0..4 * PIXELS).map(|i| if is_sample(i) { depth_m[place(i)] } else { 0.1 }).collect();
    let large_labels: Vec<u8> =
        (0..4 * PIXELS).map(|i| if is_sample(i) { labels[place(i)] } else { WINDOW }).collect();
    let camera = Camera::pinhole(Intrinsics::new(524.0, 524.0, 320.6, 238.4, 640, 480).unwrap());
    let classes = NYU13_CLASSES.map(str::to_owned);
    let options = ObstacleOptions::default();
    let mut detector = ObstacleDetector::new(&camera, mount(0.5, 5.0), &classes, options).unwrap();
    let image = DepthImage { depth_m: &large_m, labels: Some(&large_labels), confidence: None };
    let large = detector.detect(&image, 0).unwrap();
    let [small, _] = obstacles(mount(0.5, 5.0), &scene);
    for (large, small) in large.sectors.iter().zip(&small.sectors) {
        assert_eq!((large.state(), large.label), (small.state(), small.label));
        assert!((large.range_m - small.range_m).abs() < 0.01, "{large:?} {small:?}");
    }
    assert!(large.points.len().abs_diff(small.points.len()) <= 5 && large.points.len() > 50);
}

/// As a network blurs a leg into the floor behind it.
#[test]
fn a_thing_whose_depth_is_that_of_the_floor_is_found_by_its_labels_unless_depth_is_certain() {
    let mount = mount(0.5, 0.0);
    let leg = Block::new((1.5, 1.6), (-0.1, 0.1), (0.0, 0.4), TABLE);
    let (_, labels) = render(&mount, &[GROUND, leg]);
    let (depth_m, _) = render(&mount, &[GROUND]);
    let nearest_m = |labels, confidence: Option<u8>| {
        let confidence = confidence.map(|value| vec![value; PIXELS]);
        let mut detector = detector(mount, ObstacleOptions::default());
        let image = DepthImage { depth_m: &depth_m, labels, confidence: confidence.as_deref() };
        let found = detector.detect(&image, 0).unwrap();
        found.sectors.iter().map(|sector| sector.obstacle_m).fold(f32::INFINITY, f32::min)
    };
    let found_m = nearest_m(Some(&labels[..]), Some(100));
    assert!((1.4..=1.6).contains(&found_m), "within a cell: {found_m} m");
    for (labels, confidence) in [(Some(&labels[..]), Some(255)), (Some(&labels[..]), None), (None, Some(100))]
    {
        assert!(nearest_m(labels, confidence).is_infinite(), "depth decides");
    }
}

/// As a network makes a chair 1.6 times too far, and blurs its leg into the floor behind it.
#[test]
fn a_seat_is_brought_nearer_with_the_leg_that_stands_beside_it() {
    let leg = Block::new((1.5, 1.6), (0.1, 0.2), (0.0, 0.4), TABLE);
    let seat = Block::new((1.5, 1.6), (-0.2, 0.1), (0.3, 0.4), TABLE);
    let wall = Block::new((4.5, 4.6), (-9.0, 9.0), (0.0, 2.0), WALL);
    for x in [0.0, 0.4, -0.4] {
        let mount = Mount::new([x, 0.0, 0.5], [0.0; 3]).unwrap();
        let (exact_m, labels) = render(&mount, &[GROUND, wall, leg, seat]);
        let (behind_m, _) = render(&mount, &[GROUND, wall]);
        let blurred = |pixel: usize| match labels[pixel] {
            TABLE => (1.6 * exact_m[pixel]).min(behind_m[pixel]),
            _ => exact_m[pixel],
        };
        let depth_m: Vec<f32> = (0..PIXELS).map(blurred).collect();
        let mut detector = detector(self::mount(0.3, 10.0), ObstacleOptions::default());
        detector.set_mount(mount);
        let mut seen = |confidence: u8| {
            let confidence = vec![confidence; PIXELS];
            let image =
                DepthImage { depth_m: &depth_m, labels: Some(&labels), confidence: Some(&confidence) };
            let found = detector.detect(&image, 0).unwrap();
            // From the middle of the seat to the leg.
            [0.0, 0.15_f32].map(|y| {
                let angle = (y / 1.5).atan();
                found.sectors[((angle - found.angle_min_rad) / found.angle_step_rad) as usize]
            })
        };
        let too_far_m = 1.6 * (1.5 - x as f32) + x as f32;
        let [seat, _] = seen(255);
        assert!((seat.obstacle_m - too_far_m).abs() < 0.1, "certain depth stays: {seat:?}");
        let [seat, leg] = seen(100);
        for sector in [seat, leg] {
            assert!((sector.obstacle_m - 1.5).abs() < 0.15, "camera at {x} m: {sector:?}");
            assert_eq!(sector.label, TABLE);
        }
        assert!((0.25..0.45).contains(&seat.max_height_m), "the seat's true height: {seat:?}");
        assert_eq!(leg.min_height_m, 0.0, "it stands on the floor: {leg:?}");
    }
}

#[test]
fn buffers_of_another_size_are_refused_by_name() {
    let mut detector = detector(mount(0.25, 0.0), ObstacleOptions::default());
    let depth_m = vec![1.0; PIXELS];
    for (depth_m, labels, confidence, name) in [
        (&depth_m[1..], None, None, "depth"),
        (&depth_m[..], Some(&[0_u8; 5][..]), None, "label"),
        (&depth_m[..], None, Some(&[0_u8; 5][..]), "confidence"),
    ] {
        let error = detector.detect(&DepthImage { depth_m, labels, confidence }, 0).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Buffer);
        assert!(matches!(error, ObstacleError::Size { buffer, .. } if buffer == name), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(24) })]

    #[test]
    fn no_direction_is_free_past_a_random_box(
        x in 0.9..3.5f64, y in -1.0..1.0f64, depth in 0.1..0.6f64, width in 0.08..0.8f64, height in 0.08..1.2f64,
        camera_height in 0.2..0.9f64, pitch_deg in -4.0..12.0f64,
    ) {
        let scene = [GROUND, Block::new((x, x + depth), (y, y + width), (0.0, height), TABLE)];
        for found in obstacles(mount(camera_height, pitch_deg), &scene) {
            check_sectors(&found, &scene);
        }
    }

    #[test]
    fn nothing_panics_on_arbitrary_depth(
        seed in 0u64..1_000_000, height in 0.01..3.0f64, roll in -3.0..3.0f64, pitch in -1.2..1.5f64,
        sectors in 1usize..360, max_points in 1usize..50,
    ) {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as u32
        };
        let depth_m: Vec<f32> = (0..PIXELS).map(|_| match next() % 20 {
            0 => f32::NAN,
            1 => f32::INFINITY,
            2 => -1.0,
            n => n as f32 * 0.3,
        }).collect();
        let labels: Vec<u8> = (0..PIXELS).map(|_| next() as u8).collect();
        // It looks up by 69 degrees at most, where 80 are allowed.
        let mount = Mount::new([0.1, -0.2, height], [roll, pitch, 3.0]).unwrap();
        let mut detector = detector(mount, ObstacleOptions { sectors, max_points, ..Default::default() });
        let image = DepthImage { depth_m: &depth_m, labels: Some(&labels), confidence: Some(&labels) };
        let found = detector.detect(&image, 0).unwrap();
        prop_assert!(found.points.len() <= max_points && found.sectors.len() == sectors);
        prop_assert!(found.sectors.iter().all(|sector| (0.0..=5.0).contains(&sector.range_m)));
    }
}
