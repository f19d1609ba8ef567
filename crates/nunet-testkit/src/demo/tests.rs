//! The room against its own geometry, computed another way.

use super::path::pose;
use super::solid::{FACES, Shape};
use super::texture::OnFace;
use super::vector::Vec3;
use super::*;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;
const PIXELS: usize = (WIDTH * HEIGHT) as usize;

/// How far a point lies outside a solid, meters; negative inside. Found without casting a ray.
fn distance_outside(solid: &Solid, point: Vec3) -> f32 {
    let p = solid.own_point(point);
    let beyond = |x: f32, y: f32, z: f32| {
        let outside = Vec3::new(x.max(0.0), y.max(0.0), z.max(0.0)).length();
        outside + x.max(y).max(z).min(0.0)
    };
    match solid.shape {
        Shape::Cuboid { half } => beyond(p.x.abs() - half.x, p.y.abs() - half.y, p.z.abs() - half.z),
        Shape::Hollow { half } => -beyond(p.x.abs() - half.x, p.y.abs() - half.y, p.z.abs() - half.z),
        Shape::Cylinder { radius, half_height } => {
            beyond((p.x * p.x + p.y * p.y).sqrt() - radius, f32::MIN, p.z.abs() - half_height)
        }
        Shape::Ball { radius } => p.length() - radius,
    }
}

fn distance_to_nearest(solids: &[Solid], point: Vec3) -> f32 {
    solids.iter().map(|solid| distance_outside(solid, point)).fold(f32::INFINITY, f32::min)
}

fn image(seed: u64, frame_index: u64) -> (Vec<u8>, Vec<f32>, Vec<u8>) {
    let (mut rgb, mut depth_m, mut labels) = (vec![0; 3 * PIXELS], vec![0.0; PIXELS], vec![0; PIXELS]);
    let mut scene = DemoScene::new(seed, WIDTH, HEIGHT);
    scene.render(frame_index, &mut rgb, Some(&mut depth_m), Some(&mut labels));
    (rgb, depth_m, labels)
}

#[test]
fn rays_meet_shapes_at_hand_computed_depths_and_faces() {
    let from = Vec3::new(0.0, -5.0, 0.0);
    let ahead = Vec3::new(0.0, 1.0, 0.0);
    let half = Vec3::new(1.0, 2.0, 3.0);
    assert_eq!(Shape::Cuboid { half }.meet(from, ahead), (3.0, 2));
    assert_eq!(Shape::Hollow { half }.meet(Vec3::ZERO, ahead), (2.0, 3));
    assert_eq!(Shape::Cylinder { radius: 1.5, half_height: 1.0 }.meet(from, ahead), (3.5, 0));
    assert_eq!(Shape::Ball { radius: 0.5 }.meet(from, ahead * 0.5), (9.0, 0));
    let above = Vec3::new(0.2, 0.0, 4.0);
    assert_eq!(
        Shape::Cylinder { radius: 1.5, half_height: 1.0 }.meet(above, Vec3::new(0.0, 0.0, -1.0)),
        (3.0, 1)
    );
    for shape in [Shape::Cuboid { half }, Shape::Ball { radius: 1.0 }] {
        assert_eq!(shape.meet(Vec3::new(9.0, -5.0, 0.0), ahead).0, f32::INFINITY);
        assert_eq!(shape.meet(from, -ahead).0, f32::INFINITY);
    }
}

#[test]
fn a_surfaces_points_have_the_coordinates_they_were_made_from() {
    let half = Vec3::new(0.5, 1.0, 1.5);
    let shapes = [
        Shape::Cuboid { half },
        Shape::Cylinder { radius: 0.4, half_height: 1.0 },
        Shape::Ball { radius: 0.7 },
    ];
    for (shape, face) in shapes.into_iter().flat_map(|shape| (0..FACES as u8).map(move |face| (shape, face)))
    {
        let Some((width, height)) = shape.face_size(face) else {
            continue;
        };
        for (i, j) in (1..8).flat_map(|i| (1..8).map(move |j| (i, j))) {
            let (u, v) = (width * i as f32 / 8.0, height * j as f32 / 8.0);
            let (point, normal) = shape.point(face, OnFace { u, v });
            let back = shape.chart(face, point);
            assert!((back.u - u).abs() < 1e-4 && (back.v - v).abs() < 1e-4, "{shape:?} {face} {u} {v}");
            assert!((normal.length() - 1.0).abs() < 1e-5);
        }
    }
}

#[test]
fn depth_ends_on_the_first_surface() {
    let solids = room::furnished(3);
    let intrinsics = DemoScene::new(3, WIDTH, HEIGHT).intrinsics();
    let mut renderer = Renderer::new(intrinsics, solids.len());
    for frame_index in [0, 217, 451, 700] {
        let pose = pose(3, frame_index);
        renderer.trace(&solids, &pose);
        for (pixel, depth_m) in renderer.depth_m().iter().enumerate().step_by(37) {
            let x = (f64::from(pixel as u32 % WIDTH) - intrinsics.cx_px) / intrinsics.fx_px;
            let y = (f64::from(pixel as u32 / WIDTH) - intrinsics.cy_px) / intrinsics.fy_px;
            let ray = pose.forward + pose.right * x as f32 + pose.down * y as f32;
            let end = distance_to_nearest(&solids, pose.position + ray * *depth_m);
            assert!(end.abs() < 1e-4, "pixel {pixel} of frame {frame_index} ends {end} m from a surface");
            for step in 1..100 {
                let point = pose.position + ray * (*depth_m * step as f32 / 100.0);
                assert!(distance_to_nearest(&solids, point) > -1e-4, "pixel {pixel} of frame {frame_index}");
            }
        }
    }
}

#[test]
fn the_camera_stays_outside_all_solids() {
    for seed in 0..4 {
        let solids = room::furnished(seed);
        for frame_index in (0..1000).chain(u64::MAX - 10..=u64::MAX) {
            let clearance = distance_to_nearest(&solids, pose(seed, frame_index).position);
            assert!(clearance > 0.2, "{clearance} m at frame {frame_index} of seed {seed}");
        }
    }
}

#[test]
fn the_cameras_axes_are_square_to_each_other() {
    for frame_index in 0..1000 {
        let pose = pose(1, frame_index);
        let (across, turned) = (pose.right.dot(pose.down), pose.right.cross(pose.down) - pose.forward);
        assert!(across.abs() < 1e-5 && turned.length() < 1e-5, "frame {frame_index}: {pose:?}");
    }
}

#[test]
fn a_seed_and_an_index_give_the_same_bytes_again() {
    let (rgb, depth_m, labels) = image(5, 77);
    let mut scene = DemoScene::new(5, WIDTH, HEIGHT);
    let mut again = vec![0; 3 * PIXELS];
    scene.render(400, &mut again, None, None);
    assert_ne!(again, rgb);
    let (mut again_depth_m, mut again_labels) = (vec![0.0; PIXELS], vec![0; PIXELS]);
    scene.render(77, &mut again, Some(&mut again_depth_m), Some(&mut again_labels));
    assert_eq!((again, again_depth_m, again_labels), (rgb.clone(), depth_m, labels));
    assert_ne!(image(6, 77).0, rgb);
}

#[test]
fn a_mirrored_turned_or_recolored_image_is_another() {
    let (rgb, _, _) = image(0, 0);
    let (width, height) = (WIDTH as usize, HEIGHT as usize);
    let pixel = |x: usize, y: usize, channel: usize| i32::from(rgb[3 * (y * width + x) + channel]);
    let difference = |other: &dyn Fn(usize, usize, usize) -> i32| -> f64 {
        let mut sum = 0;
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            sum += (0..3).map(|channel| (pixel(x, y, channel) - other(x, y, channel)).abs()).sum::<i32>();
        }
        f64::from(sum) / rgb.len() as f64
    };
    let mirrored = difference(&|x, y, channel| pixel(width - 1 - x, y, channel));
    let upside_down = difference(&|x, y, channel| pixel(x, height - 1 - y, channel));
    let transposed = difference(&|x, y, channel| pixel(y * width / height, x * height / width, channel));
    let bgr = difference(&|x, y, channel| pixel(x, y, 2 - channel));
    for (name, difference) in
        [("mirrored", mirrored), ("upside down", upside_down), ("transposed", transposed), ("bgr", bgr)]
    {
        assert!(difference > 15.0, "{name}: only {difference} of 255 apart");
    }
}

#[test]
fn every_class_is_seen_and_no_other_label() {
    let mut seen = [0; CLASS_NAMES.len()];
    let mut scene = DemoScene::new(0, WIDTH, HEIGHT);
    let (mut rgb, mut labels) = (vec![0; 3 * PIXELS], vec![255; PIXELS]);
    for frame_index in (0..800).step_by(50) {
        scene.render(frame_index, &mut rgb, None, Some(&mut labels));
        for label in &labels {
            seen[usize::from(*label)] += 1;
        }
    }
    for (name, pixels) in CLASS_NAMES.iter().zip(seen) {
        assert!(pixels > 1000, "{name}: {pixels} pixels in 16 frames");
    }
}

#[test]
fn a_camera_of_another_size_sees_the_same_room() {
    assert_eq!(DemoScene::new(0, 640, 480).intrinsics().fx_px, 518.858);
    let odd = DemoScene::new(0, 321, 1).intrinsics();
    assert_eq!((odd.width, odd.height), (321, 1));
}
