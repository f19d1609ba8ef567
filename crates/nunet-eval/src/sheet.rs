//! The contact sheet: best, median and worst images beside their truth.

use image::imageops::{FilterType, replace, resize};
use image::{Rgb, RgbImage};
use nunet_files::{color_range, colorize, draw_text};
use nunet_types::ImageSize;

use crate::comparison::stretched;

/// Width of one image on the sheet.
const CELL_WIDTH: u32 = 320;
/// The largest height of one image. A taller one is squeezed, because all rows of the sheet are in memory at
/// once.
const MAX_CELL_HEIGHT: u32 = 4 * CELL_WIDTH;
const GAP: u32 = 6;
const CAPTION_HEIGHT: u32 = 18;
const PAPER: Rgb<u8> = Rgb([255, 255, 255]);
/// The relative error that is painted in the darkest red.
const FULL_ERROR: f32 = 0.5;
/// How many of each kind.
const EACH: usize = 3;
const WIDTH: u32 = (CELL_WIDTH + GAP) * 4 + GAP;
const COLUMNS: [&str; 4] = ["image", "truth", "prediction", "error, red = 50 % or more"];

/// The places of the images to show: best first, then those around the median, then the worst.
pub(crate) fn chosen(errors: &[f64]) -> Vec<(&'static str, usize)> {
    let mut order: Vec<usize> = (0..errors.len()).collect();
    order.sort_by(|&a, &b| errors[a].total_cmp(&errors[b]));
    let each = EACH.min(order.len().div_ceil(3));
    let middle = (order.len() - each) / 2;
    let groups = [("best", 0), ("median", middle), ("worst", order.len() - each)];
    let mut shown = Vec::new();
    for (name, first) in groups {
        for &place in order.iter().skip(first).take(each) {
            if shown.iter().all(|&(_, other)| other != place) {
                shown.push((name, place));
            }
        }
    }
    shown
}

/// One row: everything `[H, W]` of one size.
#[derive(Debug)]
pub(crate) struct SheetRow<'a> {
    pub(crate) caption: String,
    pub(crate) size: ImageSize,
    pub(crate) rgb: &'a [u8],
    pub(crate) truth: &'a [f32],
    pub(crate) predicted: &'a [f32],
    pub(crate) metric: bool,
}

impl SheetRow<'_> {
    /// The four images of the row side by side, its caption above them.
    pub(crate) fn strip(&self) -> RgbImage {
        let height = self.cell_height();
        let mut strip = RgbImage::from_pixel(WIDTH, height + CAPTION_HEIGHT + GAP, PAPER);
        draw_text(&mut strip, &self.caption, GAP, 2);
        for (column, cell) in (0..).zip(self.cells().into_iter().flatten()) {
            let cell = resize(&cell, CELL_WIDTH, height, FilterType::Triangle);
            replace(&mut strip, &cell, i64::from(left_of(column)), i64::from(CAPTION_HEIGHT));
        }
        strip
    }

    /// Follows the aspect ratio, from 1 to [`MAX_CELL_HEIGHT`].
    fn cell_height(&self) -> u32 {
        let ImageSize { width, height } = self.size;
        let exact = u64::from(CELL_WIDTH) * u64::from(height) / u64::from(width);
        exact.clamp(1, u64::from(MAX_CELL_HEIGHT)) as u32
    }

    fn cells(&self) -> Option<[RgbImage; 4]> {
        let ImageSize { width, height } = self.size;
        let rgb = RgbImage::from_raw(width, height, self.rgb.to_vec())?;
        let (truth, predicted) = if self.metric {
            (self.truth.to_vec(), self.predicted.to_vec())
        } else {
            (stretched(self.truth, self.truth), stretched(self.predicted, self.truth))
        };
        let both = color_range(&truth, None, None);
        let error = |(&p, &t): (&f32, &f32)| -((p - t).abs() / if self.metric { t } else { 1.0 });
        let errors: Vec<f32> = predicted.iter().zip(&truth).map(error).collect();
        Some([
            rgb,
            colorize(&truth, self.size, both),
            colorize(&predicted, self.size, both),
            colorize(&errors, self.size, (-FULL_ERROR, 0.0)),
        ])
    }
}

fn left_of(column: u32) -> u32 {
    GAP + column * (CELL_WIDTH + GAP)
}

/// The names of the columns, and strips below each other.
pub(crate) fn stacked(strips: &[RgbImage]) -> RgbImage {
    let head = CAPTION_HEIGHT + GAP;
    let height = head + strips.iter().map(RgbImage::height).sum::<u32>();
    let mut sheet = RgbImage::from_pixel(WIDTH, height, PAPER);
    for (column, name) in (0..).zip(COLUMNS) {
        draw_text(&mut sheet, name, left_of(column), GAP);
    }
    let mut top = head;
    for strip in strips {
        replace(&mut sheet, strip, 0, i64::from(top));
        top += strip.height();
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn best_median_and_worst_are_chosen_by_error() {
        let errors: Vec<f64> = [5.0, 1.0, 9.0, 3.0, 7.0, 2.0, 8.0, 4.0, 6.0, 0.0, 10.0].to_vec();
        let shown: Vec<_> = chosen(&errors).into_iter().map(|(name, place)| (name, errors[place])).collect();
        let expected = [
            ("best", 0.0),
            ("best", 1.0),
            ("best", 2.0),
            ("median", 4.0),
            ("median", 5.0),
            ("median", 6.0),
            ("worst", 8.0),
            ("worst", 9.0),
            ("worst", 10.0),
        ];
        assert_eq!(shown, expected);
    }

    #[test]
    fn of_few_images_each_is_shown_once() {
        assert_eq!(chosen(&[1.0]), [("best", 0)]);
        assert_eq!(chosen(&[2.0, 1.0]), [("best", 1), ("worst", 0)]);
        assert_eq!(chosen(&[]), []);
    }

    #[test]
    fn a_row_shows_four_images() {
        let (truth, predicted) = ([1.0, 2.0], [1.0, f32::NAN]);
        let row = SheetRow {
            caption: "a".to_owned(),
            size: ImageSize::new(2, 1),
            rgb: &[10, 20, 30, 40, 50, 60],
            truth: &truth,
            predicted: &predicted,
            metric: true,
        };
        let image = stacked(&[row.strip()]);
        assert_eq!(image.dimensions(), (4 * 326 + 6, 24 + 160 + 18 + 6));
        assert_eq!(image.get_pixel(8, 50), &Rgb([10, 20, 30]));
        let right_of_prediction = 6 + 2 * 326 + 318;
        assert_eq!(image.get_pixel(right_of_prediction, 50), &Rgb([150; 3]), "none is gray");
    }

    #[test]
    fn very_tall_and_very_wide_images_have_a_limited_height() {
        for (size, expected) in [((1, 20_000), 1280), ((20_000, 1), 1), ((640, 480), 240), ((1, 4), 1280)] {
            let size = ImageSize::from(size);
            let (rgb, depth) = (vec![9; 3 * size.pixel_count()], vec![1.0; size.pixel_count()]);
            let row = SheetRow {
                caption: String::new(),
                size,
                rgb: &rgb,
                truth: &depth,
                predicted: &depth,
                metric: true,
            };
            assert_eq!(row.strip().height(), expected + 18 + 6, "{size}");
        }
    }
}
