//! From depth to points.
#![allow(missing_docs, reason = "criterion's macros make undocumented items")]

use std::hint::black_box;
use std::num::NonZeroU32;

use criterion::{Criterion, criterion_group, criterion_main};
use nunet_core::camera::{Camera, Intrinsics, RayTable};
use nunet_core::cloud::{CloudOptions, CloudPoint, NO_LABEL, cloud_size, organized_cloud};
use nunet_core::filter::Appearance;
use nunet_types::ImageSize;

const SIZE: ImageSize = ImageSize::new(640, 480);
const BLANK: CloudPoint = CloudPoint { x: 0.0, y: 0.0, z: 0.0, b: 0, g: 0, r: 0, label: NO_LABEL };

fn cloud(criterion: &mut Criterion) {
    let intrinsics =
        Intrinsics::new(518.858, 519.470, 325.582, 253.736, SIZE.width, SIZE.height).expect("a camera");
    let camera = Camera::pinhole(intrinsics);
    let rays = RayTable::new(&camera);
    let pixels = rays.rays().len();
    let depth_m: Vec<f32> = (0..pixels).map(|i| 1.0 + (i % 640) as f32 * 0.01).collect();
    let rgb = vec![128; 3 * pixels];
    let labels = vec![7; pixels];
    for (case, labels, stride) in [
        ("organized", None, 1),
        ("organized_labels", Some(&labels[..]), 1),
        ("stride_2", Some(&labels[..]), 2),
    ] {
        let stride = NonZeroU32::new(stride).expect("one or two");
        let points = cloud_size(SIZE, stride).pixel_count();
        let appearance = Appearance { rgb: &rgb, labels };
        let options = CloudOptions { stride, max_range_m: 10.0 };
        let mut out = vec![BLANK; points];
        criterion.bench_function(&format!("cloud/{case}/640x480"), |bencher| {
            bencher.iter(|| {
                organized_cloud(black_box(&depth_m), &rays, &appearance, options, black_box(&mut out))
                    .expect("buffers of the camera's size");
            });
        });
    }
    criterion.bench_function("cloud/ray_table/640x480", |bencher| {
        bencher.iter(|| black_box(RayTable::new(black_box(&camera))));
    });
}

criterion_group!(benches, cloud);
criterion_main!(benches);
