//! Depth for people's eyes: a color map with its scale beside it.
//!
//! The only place where depth is stretched between its own nearest and farthest point.

use colorgrad::Gradient;
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_7X13;
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::text::{Baseline, Text};
use image::{Rgb, RgbImage};

use super::Results;

/// Width of the scale's column beside the image, pixels.
const SCALE_WIDTH: u32 = 84;
/// Width of the color bar within it.
const BAR_WIDTH: u32 = 16;
const MARGIN: u32 = 8;
/// Marks along the bar.
const MARKS: u32 = 5;
/// No measurement: a gray that the color map has not.
const NONE: Rgb<u8> = Rgb([150, 150, 150]);
const PAPER: Rgb<u8> = Rgb([255, 255, 255]);
/// Share of points beyond each end of the scale, so that a few outliers do not take all colors.
const OUTLIERS: f64 = 0.01;

/// Depth in colors (near is red, far is blue, no measurement is gray) with a scale, `SCALE_WIDTH` wider than the depth map.
pub fn depth_picture(results: &Results<'_>) -> RgbImage {
    let (width, height) = results.size;
    let range = range(results.depth);
    let mut picture = RgbImage::from_pixel(width + SCALE_WIDTH, height, PAPER);
    image::imageops::replace(&mut picture, &paint(results.depth, results.size, range), 0, 0);
    draw_scale(&mut picture, &colorgrad::preset::turbo(), width, range, results.metric);
    picture
}

/// Numbers in colors, from red for `near` to blue for `far`; no measurement is gray.
pub(crate) fn paint(depth: &[f32], (width, height): (u32, u32), (near, far): (f32, f32)) -> RgbImage {
    let gradient = colorgrad::preset::turbo();
    let mut picture = RgbImage::from_pixel(width, height, NONE);
    for (pixel, &depth) in picture.pixels_mut().zip(depth).filter(|(_, depth)| depth.is_finite()) {
        *pixel = colour_of(&gradient, depth, near, far);
    }
    picture
}

fn colour_of(gradient: &impl Gradient, depth: f32, near: f32, far: f32) -> Rgb<u8> {
    let share = ((depth - near) / (far - near).max(f32::EPSILON)).clamp(0.0, 1.0);
    let [r, g, b, _] = gradient.at(1.0 - share).to_rgba8();
    Rgb([r, g, b])
}

/// The depths between which colors are spread.
pub(crate) fn range(depth: &[f32]) -> (f32, f32) {
    let mut valid: Vec<f32> = depth.iter().copied().filter(|value| value.is_finite()).collect();
    if valid.is_empty() {
        return (0.0, 1.0);
    }
    let outliers = (valid.len() as f64 * OUTLIERS) as usize;
    let last = valid.len() - 1 - outliers;
    let far = *valid.select_nth_unstable_by(last, f32::total_cmp).1;
    let near = *valid.select_nth_unstable_by(outliers, f32::total_cmp).1;
    (near, far)
}

fn draw_scale(
    picture: &mut RgbImage,
    gradient: &impl Gradient,
    left: u32,
    (near, far): (f32, f32),
    metric: bool,
) {
    let height = picture.height();
    let bar = height.saturating_sub(2 * MARGIN).max(1);
    let depth_at = |row: u32| near + (far - near) * row as f32 / (bar - 1).max(1) as f32;
    for row in 0..bar {
        let colour = colour_of(gradient, depth_at(row), near, far);
        for column in 0..BAR_WIDTH {
            put(picture, left + MARGIN + column, MARGIN + row, colour);
        }
    }
    let unit = if metric { " m" } else { "" };
    for mark in 0..MARKS {
        let row = (bar - 1) * mark / (MARKS - 1);
        let text = format!("{:.2}{unit}", depth_at(row));
        draw_text(picture, &text, left + MARGIN + BAR_WIDTH + 3, (row + MARGIN).saturating_sub(6));
    }
}

fn put(picture: &mut RgbImage, x: u32, y: u32, colour: Rgb<u8>) {
    if let Some(pixel) = picture.get_pixel_mut_checked(x, y) {
        *pixel = colour;
    }
}

/// Black letters, 13 pixels high, from `x` and `y` to the right and below.
pub(crate) fn draw_text(picture: &mut RgbImage, text: &str, x: u32, y: u32) {
    let style = MonoTextStyle::new(&FONT_7X13, Rgb888::BLACK);
    let at = Point::new(i32::try_from(x).unwrap_or(i32::MAX), i32::try_from(y).unwrap_or(i32::MAX));
    let drawn = Text::with_baseline(text, at, style, Baseline::Top).draw(&mut Canvas(picture));
    let Ok(_) = drawn;
}

/// Lets `embedded-graphics` draw into a picture of the `image` crate.
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
        for Pixel(at, colour) in pixels {
            if let (Ok(x), Ok(y)) = (u32::try_from(at.x), u32::try_from(at.y)) {
                put(self.0, x, y, Rgb([colour.r(), colour.g(), colour.b()]));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn results(depth: &[f32], size: (u32, u32)) -> Results<'_> {
        Results { size, depth, metric: true, labels: None, cloud: None }
    }

    #[test]
    fn near_and_far_have_different_colours_and_no_measurement_is_grey() {
        let depth = [1.0, 1.0, 5.0, f32::NAN];
        let picture = depth_picture(&results(&depth, (2, 2)));
        assert_eq!(picture.dimensions(), (2 + SCALE_WIDTH, 2));
        assert_eq!(picture.get_pixel(0, 0), picture.get_pixel(1, 0));
        assert_ne!(picture.get_pixel(0, 0), picture.get_pixel(0, 1));
        assert_eq!(picture.get_pixel(1, 1), &NONE);
    }

    #[test]
    fn a_map_without_any_measurement_is_still_a_picture() {
        let picture = depth_picture(&results(&[f32::NAN; 64], (8, 8)));
        assert_eq!(picture.get_pixel(7, 7), &NONE);
    }

    #[test]
    fn a_few_outliers_do_not_take_the_whole_scale() {
        let mut depth = vec![2.0; 990];
        depth.extend([1000.0; 5]);
        depth.extend((0..5).map(|step| 1.0 + step as f32 * 0.01));
        assert_eq!(range(&depth), (2.0, 2.0));
    }

    #[test]
    fn the_scale_has_text() {
        let depth = vec![1.5; 100 * 100];
        let picture = depth_picture(&results(&depth, (100, 100)));
        let black = picture.pixels().filter(|pixel| pixel.0 == [0, 0, 0]).count();
        assert!(black > 100, "{black} black pixels");
    }
}
