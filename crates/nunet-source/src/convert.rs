//! Converts pixel layouts of cameras and recordings to those that the pipeline reads.

use nunet_core::frame::PixelFormat;
use nunet_types::ImageSize;

use crate::Frame;

/// The pattern of a Bayer mosaic, by the row and column of red. Blue is diagonal to it; green is at the other
/// two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Bayer {
    pub(crate) red: (usize, usize),
}

impl Bayer {
    pub(crate) const RGGB: Self = Self { red: (0, 0) };
    pub(crate) const BGGR: Self = Self { red: (1, 1) };
    pub(crate) const GBRG: Self = Self { red: (1, 0) };
    pub(crate) const GRBG: Self = Self { red: (0, 1) };
}

/// How the bytes of an image are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RawLayout {
    /// A layout that the pipeline reads.
    Direct(PixelFormat),
    /// Channels of 8 or 16 bits (little-endian, of which the upper byte counts), of which the first ones are
    /// the format's.
    Channels { format: PixelFormat, channels: usize, bytes: usize },
    /// U, Y, V, Y.
    Uyvy,
    /// A plane of Y, then pairs of V and U.
    Nv21,
    /// Planes of Y, U, V; V first where `v_first`.
    Planes { v_first: bool },
    /// A mosaic of 8 or 16 bits.
    Mosaic { pattern: Bayer, bytes: usize },
}

/// An image in memory.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RawImageView<'a> {
    pub(crate) layout: RawLayout,
    pub(crate) size: ImageSize,
    /// Bytes from row to row.
    pub(crate) row_stride: u32,
    pub(crate) bytes: &'a [u8],
}

impl RawLayout {
    /// Bytes of one row without padding, in the first plane.
    pub(crate) fn min_stride(self, width: u32) -> u32 {
        match self {
            Self::Direct(format) => format.min_stride(width),
            Self::Channels { channels, bytes, .. } => width.saturating_mul((channels * bytes) as u32),
            Self::Uyvy => PixelFormat::Yuyv.min_stride(width),
            Self::Nv21 => PixelFormat::Nv12.min_stride(width),
            Self::Planes { .. } => width,
            Self::Mosaic { bytes, .. } => width.saturating_mul(bytes as u32),
        }
    }

    /// The fewest bytes that hold an image.
    pub(crate) fn byte_len(self, ImageSize { width, height }: ImageSize, row_stride: u32) -> usize {
        let (rows, stride) = (height as usize, row_stride as usize);
        match self {
            Self::Direct(format) => format.byte_len(width, height, row_stride),
            Self::Nv21 => PixelFormat::Nv12.byte_len(width, height, row_stride),
            Self::Planes { .. } => stride * rows + 2 * stride.div_ceil(2) * rows.div_ceil(2),
            _ => match rows {
                0 => 0,
                rows => stride * (rows - 1) + self.min_stride(width) as usize,
            },
        }
    }
}

/// Converts an image into `frame`. Returns false if it has fewer bytes than its size needs.
pub(crate) fn fill(frame: &mut Frame, image: RawImageView<'_>) -> bool {
    let needed = image.layout.byte_len(image.size, image.row_stride);
    let Some(bytes) = image.bytes.get(..needed) else { return false };
    let image = RawImageView { bytes, ..image };
    match image.layout {
        RawLayout::Direct(format) => {
            image.lay(frame, format, image.row_stride, needed).copy_from_slice(bytes);
        }
        RawLayout::Channels { format, channels, bytes } => {
            image.pick_channels(frame, format, channels, bytes);
        }
        RawLayout::Uyvy => {
            let out = image.lay(frame, PixelFormat::Yuyv, image.row_stride, needed);
            out.copy_from_slice(bytes);
            out.as_chunks_mut().0.iter_mut().for_each(|[a, b]| std::mem::swap(a, b));
        }
        RawLayout::Nv21 => {
            let out = image.lay(frame, PixelFormat::Nv12, image.row_stride, needed);
            out.copy_from_slice(bytes);
            let luma = image.row_stride as usize * image.size.height as usize;
            out[luma..].as_chunks_mut().0.iter_mut().for_each(|[v, u]| std::mem::swap(v, u));
        }
        RawLayout::Planes { v_first } => image.interleave_planes(frame, v_first),
        RawLayout::Mosaic { pattern, bytes } => image.demosaic(frame, pattern, bytes),
    }
    true
}

impl RawImageView<'_> {
    /// Sets the size and format of `frame`, and returns its buffer.
    fn lay<'f>(
        &self,
        frame: &'f mut Frame,
        format: PixelFormat,
        row_stride: u32,
        bytes: usize,
    ) -> &'f mut [u8] {
        frame.format = Some(format);
        frame.size = self.size;
        frame.row_stride = row_stride;
        frame.buffer(bytes)
    }

    fn lay_packed<'f>(&self, frame: &'f mut Frame, format: PixelFormat) -> &'f mut [u8] {
        let ImageSize { width, height } = self.size;
        let stride = format.min_stride(width);
        self.lay(frame, format, stride, format.byte_len(width, height, stride))
    }

    fn rows(&self) -> impl Iterator<Item = &[u8]> {
        self.bytes.chunks(self.row_stride.max(1) as usize)
    }

    /// Of 16 bits, the upper byte is kept, as `cv_bridge` of ROS does. Stretching an image by its own
    /// range would change the brightness of a wall when a darker object comes into view.
    fn pick_channels(&self, frame: &mut Frame, format: PixelFormat, channels: usize, bytes: usize) {
        let width = self.size.width as usize;
        let out = self.lay_packed(frame, format);
        let kept = out.len() / (width * self.size.height as usize).max(1);
        let mut out = out.chunks_exact_mut(kept.max(1));
        for row in self.rows() {
            for pixel in row.chunks_exact(channels * bytes).take(width) {
                let Some(out) = out.next() else { return };
                for (channel, out) in out.iter_mut().enumerate() {
                    *out = pixel[channel * bytes + bytes - 1];
                }
            }
        }
    }

    /// I420 and YV12 as NV12.
    fn interleave_planes(&self, frame: &mut Frame, v_first: bool) {
        let (width, height) = (self.size.width as usize, self.size.height as usize);
        let (stride, half) = (self.row_stride as usize, (self.row_stride as usize).div_ceil(2));
        let (luma, chroma) = self.bytes.split_at(stride * height);
        let (first, second) = chroma.split_at(half * height.div_ceil(2));
        let (u, v) = if v_first { (second, first) } else { (first, second) };
        let out_stride = PixelFormat::Nv12.min_stride(self.size.width) as usize;
        let out = self.lay_packed(frame, PixelFormat::Nv12);
        for (out, row) in out.chunks_mut(out_stride).zip(luma.chunks(stride)) {
            out[..width].copy_from_slice(&row[..width]);
        }
        for (row, out) in out[out_stride * height..].chunks_mut(out_stride).enumerate() {
            for (column, [out_u, out_v]) in out.as_chunks_mut().0.iter_mut().enumerate() {
                (*out_u, *out_v) = (u[row * half + column], v[row * half + column]);
            }
        }
    }

    /// Each missing color is the mean of its neighbors that have it (bilinear). The network's image is
    /// resized, so better methods would make no difference.
    fn demosaic(&self, frame: &mut Frame, pattern: Bayer, bytes: usize) {
        let (width, height) = (self.size.width as usize, self.size.height as usize);
        let stride = self.row_stride as usize;
        let at = |row: usize, column: usize| u32::from(self.bytes[row * stride + column * bytes + bytes - 1]);
        let channel = |row: usize, column: usize| {
            let (red_row, red_column) = pattern.red;
            match ((row + red_row).is_multiple_of(2), (column + red_column).is_multiple_of(2)) {
                (true, true) => 0,
                (false, false) => 2,
                _ => 1,
            }
        };
        let out = self.lay_packed(frame, PixelFormat::Rgb8);
        for (index, out) in out.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let (row, column) = (index / width, index % width);
            let (mut sums, mut counts) = ([0; 3], [0; 3]);
            for near_row in row.saturating_sub(1)..(row + 2).min(height) {
                for near_column in column.saturating_sub(1)..(column + 2).min(width) {
                    let color = channel(near_row, near_column);
                    sums[color] += at(near_row, near_column);
                    counts[color] += 1;
                }
            }
            let own = channel(row, column);
            (sums[own], counts[own]) = (at(row, column), 1);
            *out = [0, 1, 2]
                .map(|color: usize| ((sums[color] + counts[color] / 2) / counts[color].max(1)) as u8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(layout: RawLayout, size: impl Into<ImageSize>, row_stride: u32, bytes: &[u8]) -> Frame {
        let size = size.into();
        let mut frame = Frame::default();
        assert!(fill(&mut frame, RawImageView { layout, size, row_stride, bytes }));
        frame
    }

    fn bytes(frame: &Frame) -> (PixelFormat, Vec<u8>) {
        let view = frame.view().unwrap();
        (view.format(), view.bytes().to_vec())
    }

    #[test]
    fn alpha_and_padding_are_dropped_and_the_upper_byte_of_16_bits_is_kept() {
        let layout = RawLayout::Channels { format: PixelFormat::Bgr8, channels: 4, bytes: 1 };
        let frame = filled(layout, (1, 2), 5, &[1, 2, 3, 255, 0, 4, 5, 6, 255, 0]);
        assert_eq!(bytes(&frame), (PixelFormat::Bgr8, vec![1, 2, 3, 4, 5, 6]));
        let layout = RawLayout::Channels { format: PixelFormat::Mono8, channels: 1, bytes: 2 };
        assert_eq!(bytes(&filled(layout, (2, 1), 4, &[9, 1, 9, 200])), (PixelFormat::Mono8, vec![1, 200]));
    }

    #[test]
    fn uyvy_is_yuyv_and_nv21_is_nv12() {
        assert_eq!(bytes(&filled(RawLayout::Uyvy, (2, 1), 4, &[10, 20, 30, 40])).1, [20, 10, 40, 30]);
        let frame = filled(RawLayout::Nv21, (2, 2), 2, &[1, 2, 3, 4, 5, 6]);
        assert_eq!(bytes(&frame), (PixelFormat::Nv12, vec![1, 2, 3, 4, 6, 5]));
    }

    #[test]
    fn planes_become_pairs_of_u_and_v_also_with_padding_and_odd_sides() {
        let yuv = [1, 2, 3, 4, 5, 6, 50, 51, 60, 61];
        // 2x3 pixels: two rows of color.
        for (v_first, expected) in [(false, [50, 60, 51, 61]), (true, [60, 50, 61, 51])] {
            let frame = filled(RawLayout::Planes { v_first }, (2, 3), 2, &yuv);
            assert_eq!(bytes(&frame).1, [&[1, 2, 3, 4, 5, 6][..], &expected].concat());
        }
        // 3x1 pixels in rows of four bytes: an odd width has a pair of its own.
        let frame = filled(RawLayout::Planes { v_first: false }, (3, 1), 4, &[1, 2, 3, 0, 50, 51, 60, 61]);
        assert_eq!(bytes(&frame).1[..3], [1, 2, 3]);
        assert_eq!(bytes(&frame).1[4..], [50, 60, 51, 61]);
    }

    #[test]
    fn a_mosaic_of_one_color_is_that_color_everywhere_whatever_its_pattern() {
        const COLOR: [u8; 3] = [200, 100, 50];
        for (pattern, cells) in [
            (Bayer::RGGB, [0, 1, 1, 2]),
            (Bayer::BGGR, [2, 1, 1, 0]),
            (Bayer::GBRG, [1, 2, 0, 1]),
            (Bayer::GRBG, [1, 0, 2, 1]),
        ] {
            let value = |pixel: usize| COLOR[cells[pixel / 5 % 2 * 2 + pixel % 5 % 2]];
            let mosaic: Vec<u8> = (0..15).map(value).collect();
            let frame = filled(RawLayout::Mosaic { pattern, bytes: 1 }, (5, 3), 5, &mosaic);
            assert!(bytes(&frame).1.as_chunks().0.iter().all(|&pixel| pixel == COLOR), "{pattern:?}");
            let wide: Vec<u8> = mosaic.iter().flat_map(|&value| [7, value]).collect();
            let frame = filled(RawLayout::Mosaic { pattern, bytes: 2 }, (5, 3), 10, &wide);
            assert!(
                bytes(&frame).1.as_chunks().0.iter().all(|&pixel| pixel == COLOR),
                "{pattern:?} of 16 bits"
            );
        }
    }

    #[test]
    fn too_few_bytes_are_refused() {
        let mut frame = Frame::default();
        let image =
            RawImageView { layout: RawLayout::Uyvy, size: (2, 2).into(), row_stride: 4, bytes: &[0; 7] };
        assert!(!fill(&mut frame, image));
    }
}
