//! Padding of the network's image, and results without it.

use nunet_types::PixelRect;

use crate::framing::Framing;
use crate::graph::{DepthResize, GraphOutputs, SerialGraph};

/// The image with padding, and the network's results that still have it.
///
/// Results are resized to the network's size, so that buffers keep one size whatever the size of the images.
/// (Results of the padded image's inner size would need other sizes of shared memory for each size of
/// images.)
pub(super) struct Letterbox {
    pub(super) canvas: Canvas,
    pub(super) inner: Inner,
}

impl Letterbox {
    /// For a framing with padding of this color.
    pub(super) fn new(framing: &Framing, color: [u8; 3], graph: &SerialGraph) -> Self {
        let (target, network) = (framing.target(), graph.size());
        let pixels = network.pixel_count();
        let bytes = |is_there| vec![0; if is_there { pixels } else { 0 }];
        Self {
            canvas: Canvas { rgb: color.repeat(pixels), width: network.width as usize, target },
            inner: Inner {
                depth: vec![0.0; pixels],
                labels: bytes(graph.has_labels()),
                confidence: bytes(graph.has_confidence()),
                rgb: vec![0; 3 * pixels],
                resize: DepthResize::of_part(target, network, network),
                columns: nearest(target.x, target.width, network.width),
                rows: nearest(target.y, target.height, network.height),
                width: network.width as usize,
            },
        }
    }
}

/// The network's image.
pub(super) struct Canvas {
    /// `[H, W, 3]`, RGB.
    rgb: Vec<u8>,
    /// Pixels in a row.
    width: usize,
    target: PixelRect,
}

impl Canvas {
    /// The image with padding, and how many bytes were copied. `rgb` has the size of the target.
    pub(super) fn pad(&mut self, rgb: &[u8]) -> (&[u8], u64) {
        let PixelRect { x, y, width, .. } = self.target;
        let rows = self.rgb.chunks_exact_mut(3 * self.width).skip(y as usize);
        for (canvas, row) in rows.zip(rgb.chunks_exact(3 * width as usize)) {
            canvas[3 * x as usize..][..row.len()].copy_from_slice(row);
        }
        (&self.rgb, rgb.len() as u64)
    }
}

/// The network's results of the padded image, and those that were taken out of them and not into the caller's
/// memory.
pub(super) struct Inner {
    /// `[H, W]`, with padding.
    pub(super) depth: Vec<f32>,
    /// `[H, W]`, without padding; empty for a network without labels.
    pub(super) labels: Vec<u8>,
    /// `[H, W]`, without padding; empty for a network without confidence.
    pub(super) confidence: Vec<u8>,
    /// `[H, W, 3]`, without padding.
    pub(super) rgb: Vec<u8>,
    resize: DepthResize,
    /// For each column of a result the column of the canvas.
    columns: Vec<usize>,
    rows: Vec<usize>,
    width: usize,
}

impl Inner {
    /// Takes the colors out of the canvas, pixel on pixel with the results.
    pub(super) fn take_colors(&mut self, canvas: &[u8]) {
        let width = self.width;
        for (row, out) in self.rows.iter().zip(self.rgb.chunks_exact_mut(3 * width)) {
            let from = canvas[3 * row * width..][..3 * width].as_chunks::<3>().0;
            for (column, pixel) in self.columns.iter().zip(out.as_chunks_mut::<3>().0) {
                *pixel = from[*column];
            }
        }
    }

    /// Takes depth out of its padding, and labels and confidence out of those of the graph. Those that are
    /// not in `results` stay here. Returns how many bytes were written.
    pub(super) fn take_results(&mut self, results: GraphOutputs<'_>, graph: &SerialGraph) -> u64 {
        let GraphOutputs { depth, labels, confidence } = results;
        self.resize.fill(&self.depth, depth);
        let mut bytes_written = size_of_val(depth);
        let Self { labels: own_labels, confidence: own_confidence, rows, columns, width, .. } = self;
        for (padded, values) in [
            (graph.labels(), labels.unwrap_or(own_labels)),
            (graph.confidence(), confidence.unwrap_or(own_confidence)),
        ] {
            let Some(padded) = padded else { continue };
            bytes_written += values.len();
            for (row, out) in rows.iter().zip(values.chunks_exact_mut(*width)) {
                let from = &padded[row * *width..][..*width];
                for (column, value) in columns.iter().zip(out) {
                    *value = from[*column];
                }
            }
        }
        bytes_written as u64
    }
}

/// For each of `target` pixels the nearest of `source` pixels from `start` on.
fn nearest(start: u32, source: u32, target: u32) -> Vec<usize> {
    let place = |pixel: u32| {
        // The center of the pixel, (pixel + 0.5) source / target - 0.5, rounded: in whole numbers.
        let place = (u64::from(pixel) * 2 + 1) * u64::from(source) / (u64::from(target) * 2);
        start as usize + place as usize
    };
    (0..target).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_pixel_contains_the_center() {
        assert_eq!(nearest(0, 4, 4), [0, 1, 2, 3]);
        assert_eq!(nearest(5, 2, 4), [5, 5, 6, 6]);
        assert_eq!(nearest(1, 3, 4), [1, 2, 2, 3], "centers at 0.375, 1.125, 1.875, 2.625");
        assert_eq!(nearest(319, 1, 3), [319; 3]);
    }
}
