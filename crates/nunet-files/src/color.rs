//! Depth as a color image with a color bar.
//!
//! Only here is depth stretched to the range of each map.

use colorgrad::Gradient;
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_7X13;
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::text::{Baseline, Text};
use image::{Rgb, RgbImage};
use nunet_types::ImageSize;

use crate::results::ResultArrays;

/// Width of the scale's column beside the image, pixels.
const SCALE_WIDTH: u32 = 84;
/// Width of the color bar within it.
const BAR_WIDTH: u32 = 16;
const MARGIN: u32 = 8;
/// Marks along the bar.
const MARKS: u32 = 5;
/// No measurement: a gray that is not in the color map.
const NONE: Rgb<u8> = Rgb([150, 150, 150]);
const PAPER: Rgb<u8> = Rgb([255, 255, 255]);
/// Share of points beyond each end of the scale, so that a few outliers do not take all colors.
const OUTLIERS: f64 = 0.01;

/// Depth in colors (near is red, far is blue, no measurement is gray) with a scale, `SCALE_WIDTH` wider than
/// the depth map.
#[must_use]
pub fn depth_image(results: &ResultArrays<'_>) -> RgbImage {
    let ImageSize { width, height } = results.size;
    let range = color_range(results.depth, None, None);
    let mut image = RgbImage::from_pixel(width + SCALE_WIDTH, height, PAPER);
    image::imageops::replace(&mut image, &colorize(results.depth, results.size, range), 0, 0);
    draw_scale(&mut image, &colorgrad::preset::turbo(), width, range, results.metric);
    image
}

/// Numbers in colors, from red for `near` to blue for `far`; no measurement is gray. Pixels that `depth`
/// lacks are gray as well.
#[must_use]
pub fn colorize(depth: &[f32], size: ImageSize, (near, far): (f32, f32)) -> RgbImage {
    let gradient = colorgrad::preset::turbo();
    let mut image = RgbImage::from_pixel(size.width, size.height, NONE);
    for (pixel, &depth) in image.pixels_mut().zip(depth).filter(|(_, depth)| depth.is_finite()) {
        *pixel = color_of(&gradient, depth, near, far);
    }
    image
}

fn color_of(gradient: &impl Gradient, depth: f32, near: f32, far: f32) -> Rgb<u8> {
    let share = ((depth - near) / (far - near).max(f32::EPSILON)).clamp(0.0, 1.0);
    let [r, g, b, _] = gradient.at(1.0 - share).to_rgba8();
    Rgb([r, g, b])
}

/// The depths of the reddest and of the bluest color. One that is not given is the first or last percentile
/// of the map; a map without depth gets an arbitrary range.
#[must_use]
pub fn color_range(depth: &[f32], near: Option<f32>, far: Option<f32>) -> (f32, f32) {
    if let (Some(near), Some(far)) = (near, far) {
        return (near, far);
    }
    match (near, far, percentiles(depth)) {
        (near, far, Some(own)) => (near.unwrap_or(own.0), far.unwrap_or(own.1)),
        (Some(near), None, None) => (near, near + 1.0),
        (None, Some(far), None) => (far - 1.0, far),
        (_, _, None) => (0.0, 1.0),
    }
}

/// The first and the last percentile; `None` without any depth.
fn percentiles(depth: &[f32]) -> Option<(f32, f32)> {
    let mut valid: Vec<f32> = depth.iter().copied().filter(|value| value.is_finite()).collect();
    let outliers = (valid.len() as f64 * OUTLIERS) as usize;
    let last = valid.len().checked_sub(1 + outliers)?;
    let far = *valid.select_nth_unstable_by(last, f32::total_cmp).1;
    let near = *valid.select_nth_unstable_by(outliers, f32::total_cmp).1;
    Some((near, far))
}

fn draw_scale(
    image: &mut RgbImage,
    gradient: &impl Gradient,
    left: u32,
    (near, far): (f32, f32),
    metric: bool,
) {
    let height = image.height();
    let bar = height.saturating_sub(2 * MARGIN).max(1);
    let depth_at = |row: u32| near + (far - near) * row as f32 / (bar - 1).max(1) as f32;
    for row in 0..bar {
        let color = color_of(gradient, depth_at(row), near, far);
        for column in 0..BAR_WIDTH {
            put(image, left + MARGIN + column, MARGIN + row, color);
        }
    }
    let unit = if metric { " m" } else { "" };
    for mark in 0..MARKS {
        let row = (bar - 1) * mark / (MARKS - 1);
        let text = format!("{:.2}{unit}", depth_at(row));
        draw_text(image, &text, left + MARGIN + BAR_WIDTH + 3, (row + MARGIN).saturating_sub(6));
    }
}

fn put(image: &mut RgbImage, x: u32, y: u32, color: Rgb<u8>) {
    if let Some(pixel) = image.get_pixel_mut_checked(x, y) {
        *pixel = color;
    }
}

/// Black letters, 13 pixels high, from `x` and `y` to the right and below.
pub fn draw_text(image: &mut RgbImage, text: &str, x: u32, y: u32) {
    let style = MonoTextStyle::new(&FONT_7X13, Rgb888::BLACK);
    let at = Point::new(i32::try_from(x).unwrap_or(i32::MAX), i32::try_from(y).unwrap_or(i32::MAX));
    let drawn = Text::with_baseline(text, at, style, Baseline::Top).draw(&mut Canvas(image));
    let Ok(_) = drawn;
}

/// Lets `embedded-graphics` draw into an image of the `image` crate.
struct Canvas<'a>(&'a mut RgbImage);

impl OriginDimensions for Canvas<'_> {
    fn size(&self) -> Size {
        Size::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Canvas<'_> {
    type Color = Rgb888;
    type Error = std::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Self::Error> {
        for Pixel(at, color) in pixels {
            if let (Ok(x), Ok(y)) = (u32::try_from(at.x), u32::try_from(at.y)) {
                put(self.0, x, y, Rgb([color.r(), color.g(), color.b()]));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn results(depth: &[f32], width: u32, height: u32) -> ResultArrays<'_> {
        let size = ImageSize { width, height };
        ResultArrays { size, depth, metric: true, labels: None, confidence: None, cloud: None }
    }

    #[test]
    fn near_and_far_have_different_colors_and_no_measurement_is_gray() {
        let depth = [1.0, 1.0, 5.0, f32::NAN];
        let image = depth_image(&results(&depth, 2, 2));
        assert_eq!(image.dimensions(), (2 + SCALE_WIDTH, 2));
        assert_eq!(image.get_pixel(0, 0), image.get_pixel(1, 0));
        assert_ne!(image.get_pixel(0, 0), image.get_pixel(0, 1));
        assert_eq!(image.get_pixel(1, 1), &NONE);
    }

    #[test]
    fn a_map_without_any_measurement_becomes_an_image() {
        let image = depth_image(&results(&[f32::NAN; 64], 8, 8));
        assert_eq!(image.get_pixel(7, 7), &NONE);
    }

    #[test]
    fn a_few_outliers_do_not_take_the_whole_scale() {
        let mut depth = vec![2.0; 990];
        depth.extend([1000.0; 5]);
        depth.extend((0..5).map(|step| 1.0 + step as f32 * 0.01));
        assert_eq!(color_range(&depth, None, None), (2.0, 2.0));
        assert_eq!(color_range(&depth, Some(0.5), None), (0.5, 2.0));
    }

    #[test]
    fn a_map_without_depth_has_a_default_range() {
        let range = |near, far| color_range(&[f32::NAN], near, far);
        assert_eq!(
            (range(None, None), range(Some(2.0), None), range(None, Some(2.0))),
            ((0.0, 1.0), (2.0, 3.0), (1.0, 2.0))
        );
    }

    #[test]
    fn the_scale_has_text() {
        let depth = vec![1.5; 100 * 100];
        let image = depth_image(&results(&depth, 100, 100));
        let black = image.pixels().filter(|pixel| pixel.0 == [0, 0, 0]).count();
        assert!(black > 100, "{black} black pixels");
    }
}
