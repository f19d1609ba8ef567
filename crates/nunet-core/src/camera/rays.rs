//! Where each pixel looks: the table that turns depth into points.

use nalgebra::{Matrix3, Vector3};

use super::{Camera, Intrinsics};

/// For each pixel the direction it sees, as the point of its ray at depth 1: `[x / z, y / z]`.
///
/// `[height][width]`, camera's optical frame (x right, y down, z forward). A pixel that sees no point in front of the
/// camera has NaN: one of a fisheye at 90 degrees and more, or one in a corner where the lens model throws nothing. A lens
/// with distortion fills the same table, so that nothing after it knows of lenses.
#[derive(Debug, Clone, PartialEq)]
pub struct RayTable {
    width: u32,
    height: u32,
    rays: Vec<[f32; 2]>,
}

impl RayTable {
    /// The rays of all pixels of `camera`, at the size of its intrinsics.
    #[must_use]
    pub fn new(camera: &Camera) -> Self {
        let Intrinsics { width, height, .. } = camera.intrinsics;
        let lens_from_pixel = lens_from_pixel(&camera.intrinsics);
        let ray = |(column, row): (u32, u32)| -> [f32; 2] {
            let seen = lens_from_pixel * Vector3::new(f64::from(column), f64::from(row), 1.0);
            match camera.distortion.ray(seen.xy().into()) {
                Some(ray) => [ray.x as f32, ray.y as f32],
                None => [f32::NAN; 2],
            }
        };
        let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        Self { width, height, rays: pixels.map(ray).collect() }
    }

    /// Pixels from left to right.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels from top to bottom.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All rays, row after row from the top.
    #[must_use]
    pub fn rays(&self) -> &[[f32; 2]] {
        &self.rays
    }
}

/// The matrix that takes a pixel `(column, row, 1)` to where the lens threw it, on the plane at depth 1.
fn lens_from_pixel(intrinsics: &Intrinsics) -> Matrix3<f64> {
    let Intrinsics { fx_px, fy_px, cx_px, cy_px, .. } = *intrinsics;
    #[rustfmt::skip]
    let pixel_from_lens = Matrix3::new(
        fx_px, 0.0,   cx_px,
        0.0,   fy_px, cy_px,
        0.0,   0.0,   1.0,
    );
    pixel_from_lens.try_inverse().expect("intrinsics have positive focal lengths")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_hand_computed_table_of_two_by_two_pixels() {
        let intrinsics = Intrinsics::new(2.0, 4.0, 0.5, 1.0, 2, 2).unwrap();
        let table = RayTable::new(&Camera::pinhole(intrinsics));
        assert_eq!(table.rays(), [[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.0], [0.25, 0.0]]);
    }

    proptest! {
        #[test]
        fn every_ray_projects_back_onto_its_pixel(
            width in 1u32..80, height in 1u32..60, focal in 0.3..3.0f64, off in -0.4..0.4f64,
        ) {
            let (w, h) = (f64::from(width), f64::from(height));
            let (fx, fy, cx, cy) = (focal * w, 1.1 * focal * h, (0.5 + off) * w, (0.5 - off) * h);
            let table = RayTable::new(&Camera::pinhole(Intrinsics::new(fx, fy, cx, cy, width, height).unwrap()));
            for (i, [x, y]) in table.rays().iter().enumerate() {
                let (column, row) = (i as u32 % width, i as u32 / width);
                prop_assert!((f64::from(*x) * fx + cx - f64::from(column)).abs() < 1e-3);
                prop_assert!((f64::from(*y) * fy + cy - f64::from(row)).abs() < 1e-3);
            }
        }
    }
}
