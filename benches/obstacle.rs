//! From depth to obstacles.
#![allow(missing_docs, reason = "criterion's macros make undocumented items")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nunet_core::camera::{Camera, Intrinsics, Mount};
use nunet_core::depth::DepthImage;
use nunet_core::obstacle::{ObstacleDetector, ObstacleOptions};

const SIZE: (u32, u32) = (640, 480);

/// Depth and labels of a corridor: floor, walls on both sides, and a wall with a box ahead.
fn corridor(height_m: f32) -> (Vec<f32>, Vec<u8>) {
    let pixel = |index: u32| {
        let (x, y) = ((index % 640) as f32 - 320.0, (index / 640) as f32 - 240.0);
        let (x, y) = (x / 519.0, y / 519.0);
        let floor = if y > 0.0 { height_m / y } else { f32::INFINITY };
        let (side, ahead) = (1.2 / x.abs(), if x.abs() < 0.1 && y > -0.05 { 1.5 } else { 4.0 });
        let nearest = floor.min(side).min(ahead);
        (nearest, if nearest == floor { 4 } else { 11 })
    };
    (0..SIZE.0 * SIZE.1).map(pixel).unzip()
}

fn obstacle(criterion: &mut Criterion) {
    let intrinsics = Intrinsics::new(519.0, 519.0, 320.0, 240.0, SIZE.0, SIZE.1).expect("a camera");
    let camera = Camera::pinhole(intrinsics);
    let mount = Mount::new([0.0, 0.0, 0.5], [0.0; 3]).expect("a mount");
    let classes = nunet_types::NYU13_CLASSES.map(str::to_owned);
    let (depth_m, labels) = corridor(0.5);
    let (labels, confidence) = (&labels[..], &vec![128; depth_m.len()][..]);
    for (case, labels, confidence) in [
        ("geometry", None, None),
        ("labels", Some(labels), None),
        ("confidence", Some(labels), Some(confidence)),
    ] {
        let options = ObstacleOptions::default();
        let mut detector = ObstacleDetector::new(&camera, mount, &classes, options).expect("options");
        let image = DepthImage { depth_m: &depth_m, labels, confidence };
        criterion.bench_function(&format!("obstacle/{case}/640x480"), |bencher| {
            bencher.iter(|| {
                detector.detect(black_box(&image), 0).expect("buffers of the camera's size").points.len()
            });
        });
    }
    // A robot that tilts has another mount in each frame.
    let tilted = Mount::new([0.0, 0.0, 0.5], [0.0, 0.05, 0.0]).expect("a mount");
    let mut detector =
        ObstacleDetector::new(&camera, mount, &classes, ObstacleOptions::default()).expect("options");
    let mut mounts = [tilted, mount].into_iter().cycle();
    criterion.bench_function("obstacle/mount/640x480", |bencher| {
        bencher.iter(|| mounts.by_ref().take(1).for_each(|mount| detector.set_mount(mount)));
    });
    criterion.bench_function("obstacle/new/640x480", |bencher| {
        bencher.iter(|| ObstacleDetector::new(&camera, mount, &classes, ObstacleOptions::default()));
    });
}

criterion_group!(benches, obstacle);
criterion_main!(benches);
