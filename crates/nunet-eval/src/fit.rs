//! Results at the size of the image.

use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Luma};
use nunet_core::pipeline::Pipeline;
use nunet_types::{ImageSize, NO_LABEL};

/// Resizes results to the size of the image. The view was stretched to the network's size. Decimation drops
/// incomplete blocks at the right and at the bottom, so the last column and row are repeated there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    from: ImageSize,
    covered: ImageSize,
    /// The view.
    to: ImageSize,
    /// Where the view begins in the image.
    at: (u32, u32),
    image: ImageSize,
}

impl Fit {
    pub(crate) fn new(pipeline: &Pipeline) -> Self {
        let (view, image) = (pipeline.framing().view(), pipeline.framing().image());
        let to = view.size();
        let (network, from) = (pipeline.graph().size(), pipeline.size());
        let factor = pipeline.decimation().get();
        let covered = ImageSize {
            width: covered(to.width, from.width * factor, network.width),
            height: covered(to.height, from.height * factor, network.height),
        };
        Self { from, covered, to, at: (view.x, view.y), image }
    }

    /// `[H, W]` depth of the results at the image's size, NaN outside the view.
    ///
    /// The crate `image` takes 0 to 1 as the range of `f32` and clamps to it, which would end depth at a
    /// meter: numbers are brought there and back.
    pub(crate) fn depth(&self, depth: &[f32]) -> Vec<f32> {
        self.in_image(self.depth_of_view(depth), f32::NAN)
    }

    /// Surrounds the view with `outside`.
    fn in_image<T: Copy>(&self, view: Vec<T>, outside: T) -> Vec<T> {
        if view.is_empty() || self.to == self.image {
            return view;
        }
        let mut image = vec![outside; self.image.pixel_count()];
        let (columns, rows) = (self.at.0 as usize, self.at.1 as usize);
        let lines = image.chunks_exact_mut(self.image.width as usize).skip(rows);
        for (line, from) in lines.zip(view.chunks_exact(self.to.width as usize)) {
            line[columns..columns + from.len()].copy_from_slice(from);
        }
        image
    }

    fn depth_of_view(&self, depth: &[f32]) -> Vec<f32> {
        if self.from == self.to {
            return depth.to_vec();
        }
        let known = depth.iter().copied().filter(|depth| depth.is_finite());
        let (near, far) = known
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(near, far), depth| (near.min(depth), far.max(depth)));
        let range = if far > near { far - near } else { 1.0 };
        let unit: Vec<f32> = depth.iter().map(|depth| (depth - near) / range).collect();
        let resized = self.resized(&unit, FilterType::Triangle);
        resized.into_iter().map(|unit| unit * range + near).collect()
    }

    /// `[H, W]` labels of the results at the image's size, [`NO_LABEL`] outside the view.
    pub(crate) fn labels(&self, labels: &[u8]) -> Vec<u8> {
        self.in_image(self.resized(labels, FilterType::Nearest), NO_LABEL)
    }

    /// `[H, W]` confidence of the results at the image's size, 0 outside the view.
    pub(crate) fn confidence(&self, confidence: &[u8]) -> Vec<u8> {
        self.in_image(self.resized(confidence, FilterType::Triangle), 0)
    }

    fn resized<T>(&self, values: &[T], filter: FilterType) -> Vec<T>
    where
        T: image::Primitive + 'static,
        Luma<T>: image::Pixel<Subpixel = T>,
    {
        if values.is_empty() || self.from == self.to {
            return values.to_vec();
        }
        let place = |column: u32, row: u32| row as usize * self.from.width as usize + column as usize;
        let image: ImageBuffer<Luma<T>, Vec<T>> =
            ImageBuffer::from_fn(self.from.width, self.from.height, |column, row| {
                Luma([values[place(column, row)]])
            });
        let ImageSize { width, height } = self.covered;
        let resized = resize(&image, width, height, filter);
        if self.covered == self.to {
            return resized.into_raw();
        }
        let inner = |column: u32, row: u32| *resized.get_pixel(column.min(width - 1), row.min(height - 1));
        ImageBuffer::<Luma<T>, Vec<T>>::from_fn(self.to.width, self.to.height, inner).into_raw()
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

    fn size(width: u32, height: u32) -> ImageSize {
        ImageSize { width, height }
    }

    fn whole(from: ImageSize, to: ImageSize) -> Fit {
        Fit { from, covered: to, to, at: (0, 0), image: to }
    }

    #[test]
    fn results_lie_where_the_view_lies_in_the_image() {
        let fit =
            Fit { from: size(2, 1), covered: size(2, 1), to: size(2, 1), at: (1, 1), image: size(4, 3) };
        let depth = fit.depth(&[3.0, 5.0]);
        assert_eq!((depth.len(), depth[5], depth[6]), (12, 3.0, 5.0));
        assert_eq!(depth.iter().filter(|depth| depth.is_nan()).count(), 10);
        let mut expected = [NO_LABEL; 12];
        expected[5..7].copy_from_slice(&[7, 8]);
        assert_eq!(fit.labels(&[7, 8]), expected);
        assert!(fit.labels(&[]).is_empty(), "a network without labels");
    }

    #[test]
    fn pixels_outside_whole_blocks_take_the_last_column_and_row() {
        // A network of 7x5 and blocks of 2: 3x2 pixels cover 6x4 of it.
        let covered = size(covered(7, 6, 7), covered(5, 4, 5));
        let fit = Fit { from: size(3, 2), covered, to: size(7, 5), at: (0, 0), image: size(7, 5) };
        assert_eq!(fit.covered, size(6, 4));
        let labels = fit.labels(&[1, 2, 3, 4, 5, 6]);
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
    fn depth_beyond_a_meter_and_numbers_below_zero_keep_their_values() {
        let fit = whole(size(2, 1), size(4, 1));
        for (depth, expected) in [([7.5, 7.5], [7.5; 4]), ([-3.0, 5.0], [-3.0, -1.0, 3.0, 5.0])] {
            let got = fit.depth(&depth);
            assert!(got.iter().zip(expected).all(|(got, want)| (got - want).abs() < 1e-5), "{got:?}");
        }
    }

    #[test]
    fn whole_blocks_cover_everything() {
        assert_eq!((covered(640, 320, 320), covered(1, 1, 7), covered(479, 240, 240)), (640, 1, 479));
    }

    #[test]
    fn results_of_the_truths_size_are_as_they_are() {
        let fit = whole(size(2, 1), size(2, 1));
        let depth = fit.depth(&[1.0, f32::NAN]);
        assert!(depth[0] == 1.0 && depth[1].is_nan());
    }
}
