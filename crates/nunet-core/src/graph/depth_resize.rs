//! Depth of another size than the image, resized to it.

use nunet_types::{ImageSize, PixelRect};

/// Resizes the output of a foreign network to the size of its image, bilinearly.
///
/// Values are resized before they are decoded, as the authors of such networks do. Pixel centers follow the
/// half-pixel rule, and the border is repeated. Indices and weights are computed once; a frame allocates
/// nothing.
pub(crate) struct DepthResize {
    columns: Vec<Tap>,
    rows: Vec<Tap>,
    source_width: usize,
}

/// The two source pixels of a target pixel along one axis.
#[derive(Clone, Copy)]
struct Tap {
    first: usize,
    second: usize,
    /// Of the second pixel.
    weight: f32,
}

impl DepthResize {
    /// From width and height `source` to `target`, pixels, none of them 0.
    pub(crate) fn new(source: ImageSize, target: ImageSize) -> Self {
        Self::of_part(PixelRect::whole(source), source, target)
    }

    /// From a `part` of an image of size `source` to `target`. Pixels outside the part have no influence.
    pub(crate) fn of_part(part: PixelRect, source: ImageSize, target: ImageSize) -> Self {
        Self {
            columns: taps(part.x, part.width, target.width),
            rows: taps(part.y, part.height, target.height),
            source_width: source.width as usize,
        }
    }

    /// Fills `target` from `source`, both row by row from the top.
    pub(crate) fn fill(&self, source: &[f32], target: &mut [f32]) {
        let row_of = |row: usize| &source[row * self.source_width..(row + 1) * self.source_width];
        for (row, target_row) in self.rows.iter().zip(target.chunks_exact_mut(self.columns.len())) {
            let (above, below) = (row_of(row.first), row_of(row.second));
            for (column, value) in self.columns.iter().zip(target_row) {
                let upper = column.mix(above[column.first], above[column.second]);
                let lower = column.mix(below[column.first], below[column.second]);
                *value = row.mix(upper, lower);
            }
        }
    }
}

impl Tap {
    fn mix(self, first: f32, second: f32) -> f32 {
        // Zero times NaN or infinity would be NaN.
        if self.weight == 0.0 {
            return first;
        }
        // Exact where both are equal, unlike a weighted sum.
        first + self.weight * (second - first)
    }
}

/// For `source` pixels from pixel `start` on.
fn taps(start: u32, source: u32, target: u32) -> Vec<Tap> {
    let (start, last) = (start as usize, source as usize - 1);
    let tap = |pixel: u32| {
        let place = (f64::from(pixel) + 0.5) * f64::from(source) / f64::from(target) - 0.5;
        let place = place.clamp(0.0, last as f64);
        let first = place as usize;
        let weight = (place - first as f64) as f32;
        Tap { first: start + first, second: start + (first + 1).min(last), weight }
    };
    (0..target).map(tap).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twice_the_size_follows_the_half_pixel_rule() {
        let mut target = [0.0; 8];
        DepthResize::new(ImageSize::new(2, 1), ImageSize::new(4, 2)).fill(&[1.0, 3.0], &mut target);
        assert_eq!(target, [1.0, 1.5, 2.5, 3.0, 1.0, 1.5, 2.5, 3.0]);
    }

    #[test]
    fn half_the_size_is_the_mean_of_the_middle() {
        let source = [1.0, 3.0, 5.0, 7.0, 1.0, 3.0, 5.0, 7.0];
        let mut target = [0.0; 2];
        DepthResize::new(ImageSize::new(4, 2), ImageSize::new(2, 1)).fill(&source, &mut target);
        assert_eq!(target, [2.0, 6.0]);
    }

    #[test]
    fn pixels_outside_the_part_have_no_influence() {
        let nan = f32::NAN;
        #[rustfmt::skip]
        let source = [
            nan, nan, nan, nan,
            nan, 1.0, 3.0, nan,
            nan, nan, nan, nan,
        ];
        let part = PixelRect { x: 1, y: 1, width: 2, height: 1 };
        let mut target = [0.0; 8];
        DepthResize::of_part(part, (4, 3).into(), (4, 2).into()).fill(&source, &mut target);
        assert_eq!(target, [1.0, 1.5, 2.5, 3.0, 1.0, 1.5, 2.5, 3.0]);
    }

    #[test]
    fn neighbors_without_weight_have_no_influence() {
        let (nan, infinite) = (f32::NAN, f32::INFINITY);
        let source = [1.0, nan, 2.0, infinite, 3.0, nan, infinite, 4.0, 5.0];
        let mut target = [0.0; 81];
        DepthResize::new(ImageSize::new(3, 3), ImageSize::new(9, 9)).fill(&source, &mut target);
        // The center of each source pixel is the center of three by three target pixels.
        for (index, expected) in source.into_iter().enumerate() {
            let value = target[(3 * (index / 3) + 1) * 9 + 3 * (index % 3) + 1];
            assert_eq!(value.to_bits(), expected.to_bits(), "{index}: {value}");
        }
        assert_eq!(target[0], 1.0, "the border is repeated");
        assert!(target[2].is_nan(), "between 1.0 and NaN");
    }

    #[test]
    fn a_plane_stays_a_plane_inside() {
        let (source, target) = (ImageSize::new(7, 5), ImageSize::new(21, 20));
        let plane = |(x, y): (f64, f64)| 2.0 + 0.5 * x + 0.25 * y;
        let pixels = |ImageSize { width, height }: ImageSize| {
            (0..height).flat_map(move |y| (0..width).map(move |x| (f64::from(x), f64::from(y))))
        };
        let input: Vec<f32> = pixels(source).map(|at| plane(at) as f32).collect();
        let mut output = vec![0.0; 420];
        DepthResize::new(source, target).fill(&input, &mut output);
        for ((x, y), value) in pixels(target).zip(output) {
            let at = ((x + 0.5) / 3.0 - 0.5, (y + 0.5) / 4.0 - 0.5);
            if (0.0..=6.0).contains(&at.0) && (0.0..=4.0).contains(&at.1) {
                assert!((f64::from(value) - plane(at)).abs() < 1e-5, "{x} {y}");
            }
        }
    }
}
