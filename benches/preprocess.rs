//! From a camera's image to the network's.
#![allow(missing_docs, reason = "criterion's macros make undocumented items")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::preprocess::{ChannelOrder, Preprocessor, TensorFormat, TensorLayout};
use nunet_types::ImageSize;

const NETWORK: ImageSize = ImageSize::new(640, 480);

fn image(format: PixelFormat, ImageSize { width, height }: ImageSize) -> Vec<u8> {
    let len = format.byte_len(width, height, format.min_stride(width));
    (0..len as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect()
}

fn prepare(criterion: &mut Criterion) {
    let cases = [
        ("as_it_lies", PixelFormat::Rgb8, NETWORK),
        ("convert", PixelFormat::Bgr8, NETWORK),
        ("convert", PixelFormat::Mono8, NETWORK),
        ("convert", PixelFormat::Yuyv, NETWORK),
        ("convert", PixelFormat::Nv12, NETWORK),
        ("resize", PixelFormat::Rgb8, ImageSize::new(1280, 720)),
        ("resize", PixelFormat::Rgb8, ImageSize::new(1920, 1080)),
        ("resize", PixelFormat::Rgb8, ImageSize::new(320, 240)),
        ("resize", PixelFormat::Bgr8, ImageSize::new(1280, 720)),
        ("resize", PixelFormat::Mono8, ImageSize::new(1280, 720)),
        ("resize", PixelFormat::Yuyv, ImageSize::new(1280, 720)),
        ("resize", PixelFormat::Nv12, ImageSize::new(1280, 720)),
    ];
    for (case, format, size) in cases {
        let ImageSize { width, height } = size;
        let bytes = image(format, size);
        let frame = ImageView::packed(&bytes, width, height, format).expect("a whole image");
        let mut preprocessor = Preprocessor::new(NETWORK.width, NETWORK.height);
        let id = format!("preprocess/{case}_{format}/{size}_to_{NETWORK}");
        criterion.bench_function(&id, |bencher| {
            bencher.iter(|| black_box(preprocessor.prepare(black_box(&frame)).bytes_copied));
        });
    }
}

fn tensor(criterion: &mut Criterion) {
    let rgb = image(PixelFormat::Rgb8, NETWORK);
    let mut out = vec![0.0; rgb.len()];
    for (case, layout, channels) in [
        ("nchw_rgb", TensorLayout::Nchw, ChannelOrder::Rgb),
        ("nhwc_rgb", TensorLayout::Nhwc, ChannelOrder::Rgb),
        ("nhwc_bgr", TensorLayout::Nhwc, ChannelOrder::Bgr),
    ] {
        let (mean, std) = ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]);
        let format = TensorFormat { layout, channels, scale: 1.0 / 255.0, mean, std };
        criterion.bench_function(&format!("preprocess/tensor_{case}/640x480"), |bencher| {
            bencher.iter(|| format.fill(black_box(&rgb), black_box(&mut out)));
        });
    }
}

criterion_group!(benches, prepare, tensor);
criterion_main!(benches);
