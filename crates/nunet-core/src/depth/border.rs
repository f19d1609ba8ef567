//! The outermost pixels of a network's output.

use nunet_types::ImageSize;

/// How many of a network's outermost pixels are replaced on each side.
///
/// Convolutions pad the image with zeros, which makes depth at the border too near. Measured on the rendered
/// rooms of `models/clip` with `wnet_c.onnx`, relative to the inside: 0.56, 0.66, 0.85 at the three leftmost
/// columns, 0.85, 0.87, 0.92 at the top, 0.80, 0.86, 0.97 at the bottom, and 0.97 or more from the fourth
/// pixel on. `unet.onnx` and the float network are the same within 0.03. These are the weights of 2026-11-22;
/// the first `wnet_c.onnx` of 2026-11-30 has 0.89, 0.91, 0.93 at the left and 0.81, 0.83, 0.88 at the bottom.
const BORDER_PX: usize = 3;

/// The smallest image side at which the ring is replaced. Smaller networks were not measured.
const MIN_SIDE_PX: usize = 128;

/// Replaces the outermost pixels of a network's output by the nearest pixel inside.
///
/// A border that is too near looks like a fence to a planner. Replacing was chosen over NaN, which would cost
/// 2 % of the image: on `models/clip` the mean relative error of the ring falls from 0.175 to 0.093 (the next
/// twelve pixels have 0.107), and the part of it that is more than 20 % too near from 27 % to 3 %.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BorderFill {
    width: usize,
    height: usize,
}

impl BorderFill {
    /// For outputs of `width` x `height` pixels; `None` for a small network.
    #[must_use]
    pub fn new(ImageSize { width, height }: ImageSize) -> Option<Self> {
        let (width, height) = (width as usize, height as usize);
        (width.min(height) >= MIN_SIDE_PX).then_some(Self { width, height })
    }

    /// Replaces the ring in `values`, `[height][width]`. Values of another length are left alone.
    pub fn apply<T: Copy>(self, values: &mut [T]) {
        let Self { width, height } = self;
        if values.len() != width * height {
            return;
        }
        for row in values.chunks_exact_mut(width) {
            let (left, right) = (row[BORDER_PX], row[width - 1 - BORDER_PX]);
            row[..BORDER_PX].fill(left);
            row[width - BORDER_PX..].fill(right);
        }
        let (top, bottom) = (BORDER_PX, height - 1 - BORDER_PX);
        for ring in 0..BORDER_PX {
            values.copy_within(top * width..(top + 1) * width, ring * width);
            values.copy_within(bottom * width..(bottom + 1) * width, (height - 1 - ring) * width);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ring_becomes_the_nearest_pixel_inside_and_the_inside_stays() {
        let (width, height) = (140_usize, 128_usize);
        let values: Vec<f32> = (0..width * height).map(|i| i as f32).collect();
        let mut filled = values.clone();
        BorderFill::new(ImageSize::new(140, 128)).unwrap().apply(&mut filled);
        for (i, &value) in filled.iter().enumerate() {
            let column = (i % width).clamp(BORDER_PX, width - 1 - BORDER_PX);
            let row = (i / width).clamp(BORDER_PX, height - 1 - BORDER_PX);
            assert_eq!(value, values[row * width + column], "{} {}", i % width, i / width);
        }
    }

    #[test]
    fn small_networks_and_values_of_another_size_are_left_alone() {
        assert_eq!(BorderFill::new(ImageSize::new(127, 200)), None);
        let mut values = [1.0, 2.0];
        BorderFill::new(ImageSize::new(140, 128)).unwrap().apply(&mut values);
        assert_eq!(values, [1.0, 2.0]);
    }
}
