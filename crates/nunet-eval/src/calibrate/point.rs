//! A point at a known distance.

use std::str::FromStr;

use nunet_core::camera::RayTable;
use nunet_types::{ImageSize, PixelRect};

use super::{CalibrateError, Calibrator};
use crate::median::median;

/// Depth is the median over a square of this side around a point, in pixels of the depth map.
const PATCH_PX: usize = 9;

/// Column and row in an image, pixels. It is parsed from `u,v`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pixel(pub [f64; 2]);

impl FromStr for Pixel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
        match numbers.as_deref() {
            Ok(&[u, v]) if u.is_finite() && v.is_finite() => Ok(Self([u, v])),
            _ => Err(format!("expected two numbers `u,v`, got `{text}`")),
        }
    }
}

/// A point at a known distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Column and row in the image, pixels; `None` for its center.
    pub at: Option<[f64; 2]>,
    /// The straight-line distance from the camera to the point, meters.
    pub distance_m: f64,
}

impl Point {
    /// Checks the distance.
    ///
    /// # Errors
    /// A distance that is not positive.
    pub fn check(&self) -> Result<(), CalibrateError> {
        let distance = self.distance_m;
        if distance > 0.0 && distance.is_finite() {
            Ok(())
        } else {
            Err(CalibrateError::Distance { distance })
        }
    }
}

impl Calibrator {
    /// True depth over the network's depth around a point; `None` if there is no depth.
    pub(super) fn at_point(&self, point: &Point, image: ImageSize) -> Result<Option<f64>, CalibrateError> {
        let (width, height) = (f64::from(image.width), f64::from(image.height));
        let [u, v] = point.at.unwrap_or([(width - 1.0) / 2.0, (height - 1.0) / 2.0]);
        let inside = |place: f64, side: f64| (-0.5..=side - 0.5).contains(&place);
        if !inside(u, width) || !inside(v, height) {
            return Err(CalibrateError::Outside { u, v, size: image });
        }
        let (size, view) = (self.pipeline.size(), self.pipeline.framing().view());
        let (u, v) = (u - f64::from(view.x), v - f64::from(view.y));
        let (width, height) = (f64::from(view.width), f64::from(view.height));
        if !inside(u, width) || !inside(v, height) {
            let (u, v) = (u + f64::from(view.x), v + f64::from(view.y));
            return Err(CalibrateError::OutsideView { u, v, view });
        }
        let place = |place: f64, from: f64, to: u32| {
            let place = (place + 0.5) * f64::from(to) / from - 0.5;
            (place.round().max(0.0) as usize).min(to as usize - 1)
        };
        let (column, row) = (place(u, width, size.width), place(v, height, size.height));
        let around = |place: usize, side: u32| {
            place.saturating_sub(PATCH_PX / 2)..(place + PATCH_PX / 2 + 1).min(side as usize)
        };
        let stride = size.width as usize;
        let patch = around(row, size.height)
            .flat_map(|row| self.depth_m[row * stride..][around(column, size.width)].iter().copied());
        let known: Vec<f64> = patch.filter(|depth| depth.is_finite()).map(f64::from).collect();
        // The table of this pixel alone: one of the whole image takes milliseconds.
        let pixel = PixelRect { x: column as u32, y: row as u32, width: 1, height: 1 };
        let ray = RayTable::new(&self.pipeline.points_camera().cropped(pixel));
        let [x, y] = ray.rays()[0].map(f64::from);
        let true_m = point.distance_m / (x * x + y * y + 1.0).sqrt();
        Ok(median(known).map(|predicted_m| true_m / predicted_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_two_finite_numbers() {
        assert_eq!(" 10, -2.5".parse::<Pixel>(), Ok(Pixel([10.0, -2.5])));
        for wrong in ["", "10", "1,2,3", "1,x", "nan,1", "1,inf"] {
            assert!(wrong.parse::<Pixel>().is_err(), "{wrong}");
        }
    }
}
