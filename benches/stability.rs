//! Drift and flicker of depth from one frame to the next.
#![allow(missing_docs, reason = "criterion's macros make undocumented items")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nunet_core::stability::StabilityGauge;
use nunet_types::ImageSize;

const SIZE: ImageSize = ImageSize::new(640, 480);

fn stability(criterion: &mut Criterion) {
    let noise = |i: usize| (i as u32).wrapping_mul(2_654_435_761) >> 8;
    let rgb: Vec<u8> = (0..3 * SIZE.pixel_count()).map(|i| noise(i) as u8).collect();
    // Two frames in turn, so that every change differs: sorted values would make the median cheap.
    let depth = |frame: usize| -> Vec<f32> {
        (0..SIZE.pixel_count()).map(|i| 2.0 + noise(i + 7 * frame) as f32 / 16_777_216.0).collect()
    };
    let frames = [depth(0), depth(1)];
    let mut gauge = StabilityGauge::default();
    let mut count = 0;
    criterion.bench_function("stability/640x480", |bencher| {
        bencher.iter(|| {
            count += 1;
            gauge.update(black_box(&rgb), SIZE, black_box(&frames[count % 2]), SIZE)
        });
    });
}

criterion_group!(benches, stability);
criterion_main!(benches);
