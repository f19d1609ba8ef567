//! Converts pixel formats to RGB, at the same size.

use nunet_types::ImageSize;
use yuv::{YuvBiPlanarImage, YuvConversionMode, YuvPackedImage, YuvRange, YuvStandardMatrix};

use crate::frame::{ImageView, PixelFormat};

/// The color space of webcams: the default of drivers for YUV without a stated one.
const RANGE: YuvRange = YuvRange::Limited;
const MATRIX: YuvStandardMatrix = YuvStandardMatrix::Bt601;

/// Why the conversions of `yuv` cannot fail here.
const FITS: &str = "the view was checked and the buffer sized for it";

/// Writes `frame` as packed RGB into `rgb`, which holds exactly as many pixels.
///
/// A packed frame is converted in one call. A padded one is converted row by row, because its last row may
/// end with its last pixel, which `yuv` refuses or drops.
pub(super) fn to_rgb(frame: &ImageView<'_>, rgb: &mut [u8]) {
    let ImageSize { width, height } = frame.size();
    if frame.format() == PixelFormat::Nv12 {
        return nv12_to_rgb(frame, rgb);
    }
    if frame.is_packed() {
        return rows_to_rgb(frame.format(), frame.bytes(), width, height, rgb);
    }
    let row_bytes = frame.format().min_stride(width) as usize;
    let rows = frame.bytes().chunks(frame.row_stride() as usize);
    for (row, rgb_row) in rows.zip(rgb.chunks_exact_mut(3 * width as usize)) {
        rows_to_rgb(frame.format(), &row[..row_bytes], width, 1, rgb_row);
    }
}

/// Packed rows of any format except NV12.
fn rows_to_rgb(format: PixelFormat, rows: &[u8], width: u32, height: u32, rgb: &mut [u8]) {
    match format {
        PixelFormat::Rgb8 => rgb.copy_from_slice(rows),
        PixelFormat::Bgr8 => yuv::bgr_to_rgb(rows, 3 * width, rgb, 3 * width, width, height).expect(FITS),
        PixelFormat::Mono8 => spread_gray(rows, rgb),
        PixelFormat::Yuyv => {
            let yuyv = YuvPackedImage { yuy: rows, yuy_stride: format.min_stride(width), width, height };
            yuv::yuyv422_to_rgb(&yuyv, rgb, 3 * width, RANGE, MATRIX).expect(FITS);
        }
        PixelFormat::Nv12 => unreachable!("NV12 has planes"),
    }
}

/// As [`to_rgb`] for two planes. A band is the whole image, or the two rows that share a row of chroma.
fn nv12_to_rgb(frame: &ImageView<'_>, rgb: &mut [u8]) {
    let ImageSize { width, height } = frame.size();
    let (stride, uv_stride) = (frame.row_stride(), frame.format().min_stride(width));
    let bytes = |stride: u32, rows: u32| stride as usize * rows as usize;
    let band = if frame.is_packed() { height } else { 2 };
    let (luma, chroma) = frame.bytes().split_at(bytes(stride, height));
    let luma = luma.chunks(bytes(stride, band));
    let chroma = chroma.chunks(bytes(stride, band.div_ceil(2)));
    for ((y_plane, uv_plane), rgb) in luma.zip(chroma).zip(rgb.chunks_mut(bytes(3 * width, band))) {
        let height = (y_plane.len() / stride as usize) as u32;
        let uv_plane = &uv_plane[..bytes(uv_stride, height.div_ceil(2))];
        let nv12 = YuvBiPlanarImage { y_plane, y_stride: stride, uv_plane, uv_stride, width, height };
        yuv::yuv_nv12_to_rgb(&nv12, rgb, 3 * width, RANGE, MATRIX, YuvConversionMode::Balanced).expect(FITS);
    }
}

/// Writes each pixel of `gray` three times into `rgb`.
pub(super) fn spread_gray(gray: &[u8], rgb: &mut [u8]) {
    for (pixel, gray) in rgb.as_chunks_mut::<3>().0.iter_mut().zip(gray) {
        *pixel = [*gray; 3];
    }
}

/// Swaps RGB and BGR, in place.
pub(super) fn swap_red_and_blue(pixels: &mut [u8]) {
    for pixel in pixels.as_chunks_mut::<3>().0 {
        pixel.swap(0, 2);
    }
}
