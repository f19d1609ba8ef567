//! Results at the size of the truth.

use anyhow::Context as _;
use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Luma};
use nunet_core::pipeline::Pipeline;

/// From the size of results to the size of the truth. The network saw the image stretched to its own size; a decimation
/// leaves out what fills no whole block at the right and at the bottom, and there the last column and row stand in.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    from: (u32, u32),
    covered: (u32, u32),
    to: (u32, u32),
}

impl Fit {
    pub(super) fn new(pipeline: &Pipeline, to: (u32, u32)) -> Self {
        let (network, from, factor) = (pipeline.graph().size(), pipeline.size(), pipeline.decimation().get());
        Self {
            from,
            covered: (covered(to.0, from.0 * factor, network.0), covered(to.1, from.1 * factor, network.1)),
            to,
        }
    }

    /// `[H, W]` depth of the results at the truth's size.
    ///
    /// The crate `image` takes 0 to 1 as the range of `f32` and clamps to it, which would end depth at a meter: numbers
    /// are brought there and back.
    pub(super) fn depth(&self, depth: &[f32]) -> anyhow::Result<Vec<f32>> {
        if self.from == self.to {
            return Ok(depth.to_vec());
        }
        let known = depth.iter().copied().filter(|depth| depth.is_finite());
        let (near, far) = known
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(near, far), depth| (near.min(depth), far.max(depth)));
        let range = if far > near { far - near } else { 1.0 };
        let unit: Vec<f32> = depth.iter().map(|depth| (depth - near) / range).collect();
        let resized = self.resized(&unit, FilterType::Triangle)?;
        Ok(resized.into_iter().map(|unit| unit * range + near).collect())
    }

    /// `[H, W]` labels of the results at the truth's size.
    pub(super) fn labels(&self, labels: &[u8]) -> anyhow::Result<Vec<u8>> {
        self.resized(labels, FilterType::Nearest)
    }

    fn resized<T>(&self, values: &[T], filter: FilterType) -> anyhow::Result<Vec<T>>
    where
        T: image::Primitive + 'static,
        Luma<T>: image::Pixel<Subpixel = T>,
    {
        if values.is_empty() || self.from == self.to {
            return Ok(values.to_vec());
        }
        let picture: ImageBuffer<Luma<T>, _> =
            ImageBuffer::from_raw(self.from.0, self.from.1, values.to_vec())
                .context("a result does not fill its picture")?;
        let picture = resize(&picture, self.covered.0, self.covered.1, filter);
        if self.covered == self.to {
            return Ok(picture.into_raw());
        }
        let (last_column, last_row) = (self.covered.0 - 1, self.covered.1 - 1);
        let inner = |column: u32, row: u32| *picture.get_pixel(column.min(last_column), row.min(last_row));
        Ok(ImageBuffer::<Luma<T>, Vec<T>>::from_fn(self.to.0, self.to.1, inner).into_raw())
    }
}

/// How many of `side` pixels lie over `part` of the network's `whole` pixels; at least one.
fn covered(side: u32, part: u32, whole: u32) -> u32 {
    let share = f64::from(part) / f64::from(whole);
    ((f64::from(side) * share).round() as u32).clamp(1, side.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_decimation_left_out_takes_the_last_column_and_row() {
        // A network of 7x5 and blocks of 2: 3x2 pixels cover 6x4 of it.
        let fit = Fit { from: (3, 2), covered: (covered(7, 6, 7), covered(5, 4, 5)), to: (7, 5) };
        assert_eq!(fit.covered, (6, 4));
        let labels = fit.labels(&[1, 2, 3, 4, 5, 6]).unwrap();
        #[rustfmt::skip]
        let expected = [
            1, 1, 2, 2, 3, 3, 3,
            1, 1, 2, 2, 3, 3, 3,
            4, 4, 5, 5, 6, 6, 6,
            4, 4, 5, 5, 6, 6, 6,
            4, 4, 5, 5, 6, 6, 6,
        ];
        assert_eq!(labels, expected);
    }

    #[test]
    fn depth_beyond_a_metre_and_numbers_below_zero_keep_their_values() {
        let fit = Fit { from: (2, 1), covered: (4, 1), to: (4, 1) };
        for (depth, expected) in [([7.5, 7.5], [7.5; 4]), ([-3.0, 5.0], [-3.0, -1.0, 3.0, 5.0])] {
            let got = fit.depth(&depth).unwrap();
            assert!(got.iter().zip(expected).all(|(got, want)| (got - want).abs() < 1e-5), "{got:?}");
        }
    }

    #[test]
    fn without_a_rest_everything_is_covered() {
        assert_eq!((covered(640, 320, 320), covered(1, 1, 7), covered(479, 240, 240)), (640, 1, 479));
    }

    #[test]
    fn results_of_the_truths_size_are_as_they_are() {
        let fit = Fit { from: (2, 1), covered: (2, 1), to: (2, 1) };
        let depth = fit.depth(&[1.0, f32::NAN]).unwrap();
        assert!(depth[0] == 1.0 && depth[1].is_nan());
    }
}
