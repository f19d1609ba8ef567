//! JPEG.

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

use super::pixels::{PackedPixels, pixels, shrink};
use crate::frame::ViewFrame;

/// Sufficient for viewing, at about 0.7 bits per pixel.
const QUALITY: u8 = 60;

/// The image of a frame, averaged over blocks of `stride` x `stride` pixels; empty if there is none.
pub(crate) fn image_jpeg(frame: &ViewFrame, stride: u32) -> Vec<u8> {
    let Some((image, bytes)) = frame.image() else { return Vec::new() };
    let PackedPixels { size, channels, is_bgr, bytes } = shrink(pixels(image, bytes), stride);
    let color = match (channels, is_bgr) {
        (1, _) => ColorType::Luma,
        (_, true) => ColorType::Bgr,
        (_, false) => ColorType::Rgb,
    };
    encode(&bytes, size.width, size.height, color)
}

/// Packed RGB.
pub(crate) fn rgb_jpeg(rgb: &[u8], width: u32, height: u32) -> Vec<u8> {
    encode(rgb, width, height, ColorType::Rgb)
}

fn encode(bytes: &[u8], width: u32, height: u32, color: ColorType) -> Vec<u8> {
    let mut jpeg = Vec::new();
    let mut encoder = Encoder::new(&mut jpeg, QUALITY);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    // Sides are at most 32768 and the buffer has the size of the image, so encoding cannot fail.
    let side = |side: u32| u16::try_from(side).unwrap_or(u16::MAX);
    let encoded = encoder.encode(bytes, side(width), side(height), color);
    if encoded.is_err() {
        jpeg.clear();
    }
    jpeg
}

#[cfg(test)]
mod tests {
    use nunet_types::{ImageSize, PixelFormat};

    use super::*;

    #[test]
    fn a_jpeg_shows_the_colors_of_the_image_at_the_reduced_size() {
        for (format, pixel) in [(PixelFormat::Rgb8, [200, 30, 60]), (PixelFormat::Bgr8, [60, 30, 200])] {
            let mut frame = ViewFrame::default();
            frame.set_image(&pixel.repeat(64 * 48), ImageSize::new(64, 48), 192, format);
            let image = image::load_from_memory(&image_jpeg(&frame, 2)).unwrap().to_rgb8();
            assert_eq!(image.dimensions(), (32, 24));
            let got = image.get_pixel(16, 12).0;
            let close = got.iter().zip([200, 30, 60]).all(|(got, expected)| got.abs_diff(expected) < 8);
            assert!(close, "{format}: {got:?}");
        }
    }

    #[test]
    fn a_gray_image_is_a_gray_jpeg_and_no_image_is_empty() {
        let mut frame = ViewFrame::default();
        assert!(image_jpeg(&frame, 1).is_empty());
        frame.set_image(&[77; 64], ImageSize::new(8, 8), 8, PixelFormat::Mono8);
        let image = image::load_from_memory(&image_jpeg(&frame, 1)).unwrap();
        assert_eq!(image.color(), image::ColorType::L8);
    }
}
