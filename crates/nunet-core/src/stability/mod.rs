//! Drift and flicker of depth between two frames, where the image did not change.
//!
//! If neither camera nor scene moves, depth must stay the same. What changes nevertheless is an error of the
//! network: of its scale (all of depth by one factor), or of each pixel by itself.
//!
//! Image and depth are sampled on a grid of 64x48 points, whatever their sizes. A point is a pixel with the
//! ones to its right and below. The image did not change there if no channel of these differs by more than
//! [`MAX_CHANGE`]. On a plain wall, points are unchanged even while the camera moves. Therefore points on
//! texture decide whether the camera moves: if less than half of them are unchanged, or there are hardly any,
//! the result is unknown.
//!
//! # Example: depth that becomes 10 percent larger
//! ```
//! use nunet_core::stability::StabilityGauge;
//! use nunet_types::ImageSize;
//!
//! let size = ImageSize::new(64, 48);
//! let rgb: Vec<u8> = (0..64 * 48 * 3).map(|i| if i / 3 % 4 < 2 { 200 } else { 50 }).collect();
//! let mut gauge = StabilityGauge::default();
//! assert_eq!(gauge.update(&rgb, size, &vec![2.0; 64 * 48], size), None, "the first frame");
//! let change = gauge.update(&rgb, size, &vec![2.2; 64 * 48], size).expect("the image did not change");
//! assert!((change.drift - 0.1).abs() < 1e-6 && change.flicker < 1e-6);
//! ```

use nunet_types::ImageSize;

const COLUMNS: usize = 64;
const ROWS: usize = 48;
/// Points of the grid.
const POINTS: usize = COLUMNS * ROWS;
/// Channels of an unchanged point differ by at most this, of 255: more than the noise of most cameras.
const MAX_CHANGE: u8 = 8;
/// A point is on texture if a channel differs by at least this between its pixels: then a motion of half a
/// pixel changes it by more than [`MAX_CHANGE`].
const MIN_TEXTURE: u8 = 24;
/// With fewer points on texture, or fewer with depth, the result is unknown.
const MIN_POINTS: usize = 30;

/// The change of depth from one frame to the next, where the image did not change. Shares: 0.01 is one
/// percent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StabilityChange {
    /// The median of `depth / previous depth - 1`: how much the scale grew.
    pub drift: f32,
    /// The median distance of these values from their median: how much points change besides the scale. Not
    /// negative.
    pub flicker: f32,
}

/// A point of the last frame.
#[derive(Debug, Clone, Copy, Default)]
struct Point {
    /// Here, to the right, below.
    rgb: [[u8; 3]; 3],
    is_textured: bool,
    /// NaN without a measurement.
    depth_m: f32,
}

/// Compares each frame with the one before. Allocates once.
#[derive(Debug, Clone)]
pub struct StabilityGauge {
    /// The sizes of the last image and depth map; `None` if there is nothing to compare with.
    sizes: Option<(ImageSize, ImageSize)>,
    last: Vec<Point>,
    changes: Vec<f32>,
}

impl Default for StabilityGauge {
    fn default() -> Self {
        Self { sizes: None, last: vec![Point::default(); POINTS], changes: Vec::with_capacity(POINTS) }
    }
}

impl StabilityGauge {
    /// Forgets the last frame: the next one has another camera, scale or scene.
    pub fn reset(&mut self) {
        self.sizes = None;
    }

    /// Compares a frame with the last one. `rgb` is `[H, W, 3]`, 8 bits; `depth_m` is `[H, W]` of any size,
    /// whose values count if they are finite and positive. Both show the same view.
    ///
    /// `None` for the first frame, after another size, when the image changed (the camera moves, the light
    /// changes), and without texture or depth. Allocates nothing.
    pub fn update(
        &mut self,
        rgb: &[u8],
        image_size: ImageSize,
        depth_m: &[f32],
        depth_size: ImageSize,
    ) -> Option<StabilityChange> {
        let sizes = (image_size, depth_size);
        let fits = |values: usize, size: ImageSize| size.pixel_count() > 0 && values >= size.pixel_count();
        if !fits(rgb.len() / 3, image_size) || !fits(depth_m.len(), depth_size) {
            self.reset();
            return None;
        }
        let is_comparable = self.sizes.replace(sizes) == Some(sizes);
        self.changes.clear();
        let (mut textured, mut still) = (0_usize, 0_usize);
        for (index, last) in self.last.iter_mut().enumerate() {
            let point = Point::of(index, rgb, image_size, depth_m, depth_size);
            let is_unchanged = (0..3).all(|i| difference(point.rgb[i], last.rgb[i]) <= MAX_CHANGE);
            textured += usize::from(last.is_textured);
            still += usize::from(last.is_textured & is_unchanged);
            let change = point.depth_m / last.depth_m - 1.0;
            if is_unchanged && change.is_finite() {
                self.changes.push(change);
            }
            *last = point;
        }
        let is_still = textured >= MIN_POINTS && 2 * still >= textured;
        (is_comparable && is_still && self.changes.len() >= MIN_POINTS).then(|| self.summarize())
    }

    fn summarize(&mut self) -> StabilityChange {
        let drift = median(&mut self.changes);
        self.changes.iter_mut().for_each(|change| *change = (*change - drift).abs());
        StabilityChange { drift, flicker: median(&mut self.changes) }
    }
}

impl Point {
    /// The point at the center of a cell of the grid.
    fn of(index: usize, rgb: &[u8], size: ImageSize, depth_m: &[f32], depth_size: ImageSize) -> Self {
        let [x, y] = pixel(index, size);
        let (width, height) = (size.width as usize, size.height as usize);
        let at = |x: usize, y: usize| {
            let first = 3 * (y.min(height - 1) * width + x.min(width - 1));
            [rgb[first], rgb[first + 1], rgb[first + 2]]
        };
        let rgb = [at(x, y), at(x + 1, y), at(x, y + 1)];
        let [depth_x, depth_y] = pixel(index, depth_size);
        let depth_m = depth_m[depth_y * depth_size.width as usize + depth_x];
        Self {
            rgb,
            is_textured: rgb.iter().any(|there| difference(rgb[0], *there) >= MIN_TEXTURE),
            depth_m: if depth_m > 0.0 && depth_m < f32::INFINITY { depth_m } else { f32::NAN },
        }
    }
}

/// The pixel of a point in an image.
fn pixel(index: usize, size: ImageSize) -> [usize; 2] {
    let center = |cell: usize, cells: usize, pixels: u32| (2 * cell + 1) * pixels as usize / (2 * cells);
    [center(index % COLUMNS, COLUMNS, size.width), center(index / COLUMNS, ROWS, size.height)]
}

/// The largest difference of a channel.
fn difference(a: [u8; 3], b: [u8; 3]) -> u8 {
    a[0].abs_diff(b[0]).max(a[1].abs_diff(b[1])).max(a[2].abs_diff(b[2]))
}

/// The median, of an even number the upper one; the slice must not be empty. Changes the order.
fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

#[cfg(test)]
mod tests;
