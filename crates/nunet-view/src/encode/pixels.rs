//! Images of any pixel format as packed colors or grays, every n-th pixel.

use std::borrow::Cow;

use nunet_types::{ImageSize, PixelFormat};
use yuv::{YuvBiPlanarImage, YuvConversionMode, YuvPackedImage, YuvRange, YuvStandardMatrix};

use crate::frame::ImageInfo;

/// What webcams send: the default of drivers for YUV without a color space.
const RANGE: YuvRange = YuvRange::Limited;
const MATRIX: YuvStandardMatrix = YuvStandardMatrix::Bt601;
/// Why the conversions of `yuv` cannot fail here.
const FITS: &str = "the image was checked and the buffer sized for it";

/// Packed pixels.
#[derive(Debug, PartialEq)]
pub(super) struct PackedPixels<'a> {
    pub(super) size: ImageSize,
    /// 1 (gray) or 3.
    pub(super) channels: usize,
    /// Whether three channels are blue, green, red.
    pub(super) is_bgr: bool,
    pub(super) bytes: Cow<'a, [u8]>,
}

/// The image at its own size. `bytes` hold it, as [`crate::frame::ViewFrame::set_image`] checks.
pub(super) fn pixels(image: ImageInfo, bytes: &[u8]) -> PackedPixels<'_> {
    let ImageInfo { size, format, .. } = image;
    let packed = pack(image, bytes);
    let channels = if format == PixelFormat::Mono8 { 1 } else { 3 };
    let bytes = match format {
        PixelFormat::Rgb8 | PixelFormat::Bgr8 | PixelFormat::Mono8 => packed,
        PixelFormat::Yuyv => Cow::Owned(yuyv_to_rgb(&packed, size)),
        PixelFormat::Nv12 => Cow::Owned(nv12_to_rgb(&packed, size)),
    };
    PackedPixels { size, channels, is_bgr: format == PixelFormat::Bgr8, bytes }
}

/// The rows without padding.
fn pack(image: ImageInfo, bytes: &[u8]) -> Cow<'_, [u8]> {
    let row = image.format.min_stride(image.size.width);
    if image.row_stride == row {
        return Cow::Borrowed(bytes);
    }
    let rows = bytes.chunks(image.row_stride as usize);
    Cow::Owned(rows.flat_map(|padded| padded.iter().take(row as usize)).copied().collect())
}

fn yuyv_to_rgb(yuy: &[u8], ImageSize { width, height }: ImageSize) -> Vec<u8> {
    let mut rgb = vec![0; 3 * width as usize * height as usize];
    let yuyv = YuvPackedImage { yuy, yuy_stride: PixelFormat::Yuyv.min_stride(width), width, height };
    yuv::yuyv422_to_rgb(&yuyv, &mut rgb, 3 * width, RANGE, MATRIX).expect(FITS);
    rgb
}

fn nv12_to_rgb(bytes: &[u8], ImageSize { width, height }: ImageSize) -> Vec<u8> {
    let mut rgb = vec![0; 3 * width as usize * height as usize];
    let stride = PixelFormat::Nv12.min_stride(width);
    let (y_plane, uv_plane) = bytes.split_at(stride as usize * height as usize);
    let nv12 = YuvBiPlanarImage { y_plane, y_stride: stride, uv_plane, uv_stride: stride, width, height };
    yuv::yuv_nv12_to_rgb(&nv12, &mut rgb, 3 * width, RANGE, MATRIX, YuvConversionMode::Balanced).expect(FITS);
    rgb
}

/// The mean of each whole block of `stride` x `stride` pixels; pixels that fill no block are skipped. An
/// image smaller than a block stays as it is.
pub(super) fn shrink(pixels: PackedPixels<'_>, stride: u32) -> PackedPixels<'_> {
    let size = ImageSize::new(pixels.size.width / stride, pixels.size.height / stride);
    if stride == 1 || size.pixel_count() == 0 {
        return pixels;
    }
    let (channels, block) = (pixels.channels, stride as usize);
    let row_bytes = pixels.size.width as usize * channels;
    let count = stride * stride;
    let mut bytes = Vec::with_capacity(size.pixel_count() * channels);
    let mut sums = vec![0_u32; size.width as usize * channels];
    for rows in pixels.bytes.chunks_exact(row_bytes * block).take(size.height as usize) {
        sums.fill(0);
        for row in rows.chunks_exact(row_bytes) {
            add_blocks(row, channels, block, &mut sums);
        }
        bytes.extend(sums.iter().map(|sum| ((sum + count / 2) / count) as u8));
    }
    PackedPixels { size, bytes: Cow::Owned(bytes), ..pixels }
}

/// Adds the pixels of a row to the sums of their blocks.
fn add_blocks(row: &[u8], channels: usize, block: usize, sums: &mut [u32]) {
    for (pixels, sums) in row.chunks_exact(channels * block).zip(sums.chunks_exact_mut(channels)) {
        for pixel in pixels.chunks_exact(channels) {
            for (sum, value) in sums.iter_mut().zip(pixel) {
                *sum += u32::from(*value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, height: u32, row_stride: u32, format: PixelFormat) -> ImageInfo {
        ImageInfo { size: ImageSize::new(width, height), row_stride, format }
    }

    #[test]
    fn padding_is_removed() {
        let bytes = [1, 2, 3, 9, 4, 5, 6];
        assert_eq!(&*pixels(image(1, 2, 4, PixelFormat::Rgb8), &bytes).bytes, [1, 2, 3, 4, 5, 6]);
        assert_eq!(&*pixels(image(1, 2, 3, PixelFormat::Rgb8), &bytes[..6]).bytes, [1, 2, 3, 9, 4, 5]);
    }

    #[test]
    fn gray_yuv_becomes_gray_in_both_formats_and_for_odd_sides() {
        // Black is 16 and white is 235.
        let yuyv = image(3, 1, 8, PixelFormat::Yuyv);
        let rgb = pixels(yuyv, &[16, 128, 235, 128, 16, 128, 0, 128]);
        assert_eq!(&*rgb.bytes, [0, 0, 0, 255, 255, 255, 0, 0, 0]);
        let nv12 = image(3, 1, 4, PixelFormat::Nv12);
        let rgb = pixels(nv12, &[16, 235, 16, 0, 128, 128, 128, 128]);
        assert_eq!(&*rgb.bytes, [0, 0, 0, 255, 255, 255, 0, 0, 0]);
    }

    #[test]
    fn a_block_becomes_its_mean_and_what_fills_no_block_is_skipped() {
        let bytes: Vec<u8> = vec![0, 4, 9, 8, 4, 9, 7, 7, 7];
        let shrunk = shrink(pixels(image(3, 3, 3, PixelFormat::Mono8), &bytes), 2);
        assert_eq!((shrunk.size, &*shrunk.bytes), (ImageSize::new(1, 1), &[4][..]));
        let tiny = shrink(pixels(image(3, 1, 3, PixelFormat::Mono8), &bytes[..3]), 2);
        assert_eq!(tiny.size, ImageSize::new(3, 1), "smaller than a block");
    }
}
