//! Filters of depth, one after the other.
#![allow(missing_docs, reason = "criterion's macros make undocumented items")]

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nunet_core::filter::{Appearance, Decimation, FilterChain, FilterOptions};
use nunet_core::graph::StageTimes;
use nunet_types::ImageSize;

const SIZE: ImageSize = ImageSize::new(640, 480);
const PIXELS: usize = 640 * 480;

fn options(text: &str) -> FilterOptions {
    FilterOptions::new(&[text.parse().expect("a filter")]).expect("one filter")
}

/// A slanted wall with a step, noise, and a hole in every hundred pixels.
fn depth_map() -> Vec<f32> {
    let depth = |i: usize| match i * 7919 % 100 {
        0 => f32::NAN,
        noise => (if i % 640 < 300 { 1.5 } else { 3.0 }) + (i / 640) as f32 * 0.001 + noise as f32 * 1e-4,
    };
    (0..PIXELS).map(depth).collect()
}

fn decimation(criterion: &mut Criterion) {
    let (depth_m, rgb, labels) = (depth_map(), vec![100; 3 * PIXELS], vec![7; PIXELS]);
    for factor in [2, 4, 8] {
        let options = options(&format!("decimation={factor}")).decimation().expect("a decimation");
        let mut decimation = Decimation::new(options, SIZE).expect("blocks that fit");
        decimation.network_depth().copy_from_slice(&depth_m);
        let mut small = vec![0.0; options.reduced(SIZE).pixel_count()];
        for (case, for_cloud) in [("", false), ("_cloud", true)] {
            criterion.bench_function(&format!("filter/decimation_{factor}{case}/640x480"), |bencher| {
                bencher.iter(|| {
                    let full = Appearance { rgb: black_box(&rgb), labels: Some(black_box(&labels)) };
                    decimation
                        .reduce(full, black_box(&mut small), None, for_cloud)
                        .expect("buffers of the size");
                });
            });
        }
    }
}

fn keeping_the_size(criterion: &mut Criterion) {
    let depth_m = depth_map();
    for text in ["spatial", "spatial=magnitude:5,fill:5", "temporal", "holes=farthest", "holes=left"] {
        let mut chain = FilterChain::new(&options(text), SIZE);
        let name = text.replace(['=', ':', ','], "_");
        criterion.bench_function(&format!("filter/{name}/640x480"), |bencher| {
            bencher.iter_batched_ref(
                || depth_m.clone(),
                |depth_m| {
                    let mut stages = StageTimes::default();
                    chain.apply(black_box(depth_m), &(|| 0), &mut stages).expect("a map of the size");
                },
                BatchSize::LargeInput,
            );
        });
    }
}

criterion_group!(benches, decimation, keeping_the_size);
criterion_main!(benches);
