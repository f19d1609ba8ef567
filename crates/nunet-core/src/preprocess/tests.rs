//! Preprocessing, compared with hand-computed values and simple loops.

use super::*;
use proptest::prelude::*;

/// Bytes without symmetry or period, in the range that limited-range YUV uses.
fn noise(len: usize) -> Vec<u8> {
    (0..len as u32).map(|i| 16 + ((i.wrapping_mul(2_654_435_761).rotate_left(9) >> 11) % 220) as u8).collect()
}

fn prepared(
    bytes: &[u8],
    size: impl Into<ImageSize>,
    stride: u32,
    format: PixelFormat,
    to: impl Into<ImageSize>,
) -> Vec<u8> {
    let (size, to) = (size.into(), to.into());
    let frame = ImageView::new(bytes, size.width, size.height, stride, format).unwrap();
    Preprocessor::new(to.width, to.height).prepare(&frame).rgb.to_vec()
}

/// BT.601 limited range, in floating point (ITU-R BT.601-7, section 2.5).
fn rgb_from_yuv(y: u8, u: u8, v: u8) -> [f64; 3] {
    let (y, u, v) = (f64::from(y) - 16.0, f64::from(u) - 128.0, f64::from(v) - 128.0);
    let y = y * 255.0 / 219.0;
    [y + 1.596_027 * v, y - 0.391_762 * u - 0.812_968 * v, y + 2.017_232 * u].map(|c| c.clamp(0.0, 255.0))
}

/// The RGB of one pixel, read by the definition of its format.
fn reference_pixel(
    bytes: &[u8],
    size: ImageSize,
    stride: u32,
    format: PixelFormat,
    x: u32,
    y: u32,
) -> [f64; 3] {
    let at = |row: u32, column: u32| bytes[row as usize * stride as usize + column as usize];
    match format {
        PixelFormat::Rgb8 => [0, 1, 2].map(|c| f64::from(at(y, 3 * x + c))),
        PixelFormat::Bgr8 => [2, 1, 0].map(|c| f64::from(at(y, 3 * x + c))),
        PixelFormat::Mono8 => [f64::from(at(y, x)); 3],
        PixelFormat::Yuyv => {
            let pair = x / 2 * 4;
            rgb_from_yuv(at(y, 2 * x), at(y, pair + 1), at(y, pair + 3))
        }
        PixelFormat::Nv12 => {
            let (row, column) = (size.height + y / 2, x / 2 * 2);
            rgb_from_yuv(at(y, x), at(row, column), at(row, column + 1))
        }
    }
}

fn any_format() -> impl Strategy<Value = PixelFormat> {
    prop::sample::select(PixelFormat::ALL.to_vec())
}

#[test]
fn a_frame_that_fits_is_returned_without_a_copy() {
    let bytes = noise(6 * 4 * 3 + 5);
    let frame = ImageView::packed(&bytes, 6, 4, PixelFormat::Rgb8).unwrap();
    let mut preprocessor = Preprocessor::new(6, 4);
    let prepared = preprocessor.prepare(&frame);
    assert_eq!(prepared.rgb.as_ptr(), bytes.as_ptr());
    assert_eq!((prepared.rgb.len(), prepared.bytes_copied), (72, 0));
}

#[test]
fn bytes_written_are_counted() {
    let bytes = noise(8 * 4 * 3);
    let frame = ImageView::packed(&bytes, 8, 4, PixelFormat::Bgr8).unwrap();
    assert_eq!(Preprocessor::new(8, 4).prepare(&frame).bytes_copied, 96);
    let frame = ImageView::packed(&bytes, 8, 4, PixelFormat::Rgb8).unwrap();
    assert_eq!(Preprocessor::new(4, 2).prepare(&frame).bytes_copied, 24);
    let frame = ImageView::packed(&bytes, 8, 4, PixelFormat::Yuyv).unwrap();
    assert_eq!(Preprocessor::new(4, 2).prepare(&frame).bytes_copied, 96 + 24);
}

#[test]
fn the_converted_image_stays_at_one_address() {
    let bytes = noise(64 * 48 * 3);
    let mut preprocessor = Preprocessor::new(16, 12);
    let addresses = [(64, 48, PixelFormat::Rgb8), (33, 21, PixelFormat::Nv12), (16, 12, PixelFormat::Bgr8)]
        .map(|(w, h, format)| {
            preprocessor.prepare(&ImageView::packed(&bytes, w, h, format).unwrap()).rgb.as_ptr()
        });
    assert!(addresses.iter().all(|address| *address == addresses[0]));
}

#[test]
fn half_the_size_weighs_four_pixels_by_hand_computed_weights() {
    // Distances 0.25 and 0.75 of a target pixel weigh 0.84375 and 0.15625; what lies outside the image has
    // none.
    let rgb = prepared(&[10, 20, 0, 255], (4, 1), 4, PixelFormat::Mono8, (2, 1));
    assert_eq!(rgb, [14, 14, 14, 118, 118, 118]);
}

#[test]
fn a_downscaled_bgr_image_has_its_channels_in_order() {
    let bgr = [[30, 20, 10]; 16].concat();
    assert_eq!(prepared(&bgr, (4, 4), 12, PixelFormat::Bgr8, (2, 2)), [[10, 20, 30]; 4].concat());
}

#[test]
fn one_pixel_upscales_to_an_image_and_an_image_downscales_to_one() {
    assert_eq!(prepared(&[7, 8, 9], (1, 1), 3, PixelFormat::Rgb8, (40, 30)), [[7, 8, 9]; 1200].concat());
    assert_eq!(prepared(&[7, 8, 9].repeat(1200), (40, 30), 120, PixelFormat::Rgb8, (1, 1)), [7, 8, 9]);
    assert_eq!(prepared(&[128; 4], (1, 1), 4, PixelFormat::Yuyv, (2, 2)), [131; 12]);
    assert_eq!(prepared(&[128; 4], (1, 1), 2, PixelFormat::Nv12, (2, 2)), [130; 12]);
}

#[test]
fn the_longest_sides_are_taken() {
    let side = crate::frame::MAX_SIDE_PX;
    for (width, height) in [(side, 2), (2, side)] {
        for &format in PixelFormat::ALL {
            let stride = format.min_stride(width);
            let bytes = vec![128; format.byte_len(width, height, stride)];
            let rgb = prepared(&bytes, (width, height), stride, format, (16, 12));
            assert!(
                rgb.iter().all(|value| (127..=131).contains(value)),
                "{format} {width}x{height}: {:?}",
                &rgb[..12]
            );
        }
    }
}

proptest! {
    #[test]
    fn every_format_becomes_its_definitions_rgb(
        width in 1u32..70, height in 1u32..9, padding in 0u32..20, format in any_format(),
    ) {
        let stride = format.min_stride(width) + padding;
        let bytes = noise(format.byte_len(width, height, stride));
        let rgb = prepared(&bytes, (width, height), stride, format, (width, height));
        // `yuv` computes in whole numbers with 6 to 13 bits of fraction.
        let tolerance = if matches!(format, PixelFormat::Yuyv | PixelFormat::Nv12) { 4.0 } else { 0.0 };
        for (i, pixel) in rgb.chunks_exact(3).enumerate() {
            let (x, y) = (i as u32 % width, i as u32 / width);
            let expected = reference_pixel(&bytes, ImageSize { width, height }, stride, format, x, y);
            for (got, expected) in pixel.iter().zip(expected) {
                prop_assert!((f64::from(*got) - expected).abs() <= tolerance, "{x},{y}: {pixel:?} {expected}");
            }
        }
    }

    #[test]
    fn every_ratio_weighs_pixels_by_the_filter(
        width in 1u32..90, height in 1u32..50, to_width in 1u32..90, to_height in 1u32..50, padding in 0u32..9,
    ) {
        prop_assume!((width, height) != (to_width, to_height));
        let stride = 3 * width + padding;
        let bytes = noise(PixelFormat::Rgb8.byte_len(width, height, stride));
        let rgb = prepared(&bytes, (width, height), stride, PixelFormat::Rgb8, (to_width, to_height));
        for (i, got) in rgb.iter().enumerate() {
            let (pixel, channel) = (i as u32 / 3, i as u32 % 3);
            let (columns, rows) = (weights(width, to_width, pixel % to_width), weights(height, to_height, pixel / to_width));
            let value = |x: usize, y: usize| f64::from(bytes[y * stride as usize + 3 * x + channel as usize]);
            let row = |y: usize| columns.iter().enumerate().map(|(x, weight)| weight * value(x, y)).sum::<f64>();
            let expected: f64 = rows.iter().enumerate().map(|(y, weight)| weight * row(y)).sum();
            // Rounded after each axis.
            prop_assert!((f64::from(*got) - expected).abs() <= 1.6, "{pixel}: {got} {expected}");
        }
    }

    #[test]
    fn a_uniform_image_stays_uniform_at_every_size(
        width in 1u32..60, height in 1u32..60, to_width in 1u32..60, to_height in 1u32..60, value: u8,
    ) {
        let flat = vec![value; 3 * (width * height) as usize];
        let rgb = prepared(&flat, (width, height), 3 * width, PixelFormat::Rgb8, (to_width, to_height));
        prop_assert!(rgb.iter().all(|got| got.abs_diff(value) <= 1));
    }
}

/// What each of `from` pixels contributes to pixel `target` of `to`.
fn weights(from: u32, to: u32, target: u32) -> Vec<f64> {
    let scale = f64::from(from) / f64::from(to);
    let center = (f64::from(target) + 0.5) * scale;
    let weight = |pixel: u32| {
        let t = ((f64::from(pixel) + 0.5 - center) / scale.max(1.0)).abs();
        if t < 1.0 { 2.0 * t.powi(3) - 3.0 * t.powi(2) + 1.0 } else { 0.0 }
    };
    let weights: Vec<f64> = (0..from).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}
