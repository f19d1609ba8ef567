//! From network outputs to depth.
#![allow(missing_docs, reason = "criterion's macros make undocumented items")]

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nunet_core::depth::{BorderFill, DepthEncoding, DepthRange, OutputScale};
use nunet_types::ImageSize;

fn decode(criterion: &mut Criterion) {
    let range = DepthRange::new(0.5, 10.0).expect("a range");
    // Some of them out of range in every encoding.
    let values: Vec<f32> = (0..640 * 480).map(|i| (i % 1200) as f32 * 0.01 - 0.5).collect();
    for encoding in DepthEncoding::ALL {
        criterion.bench_function(&format!("depth/decode_{encoding}/640x480"), |bencher| {
            let decode = |values: &mut Vec<f32>| encoding.decode(values, OutputScale::IDENTITY, range, 1.1);
            bencher.iter_batched_ref(
                || values.clone(),
                |values| black_box(decode(values)),
                BatchSize::LargeInput,
            );
        });
    }
    let border = BorderFill::new(ImageSize::new(640, 480)).expect("a large image");
    let mut values = values;
    criterion.bench_function("depth/border/640x480", |bencher| {
        bencher.iter(|| border.apply(black_box(&mut values)));
    });
}

criterion_group!(benches, decode);
criterion_main!(benches);
