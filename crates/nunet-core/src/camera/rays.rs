//! The viewing ray of each pixel: the table that turns depth into points.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Vector3};

use super::{Camera, Intrinsics};

/// The viewing ray of each pixel, as its point at depth 1: `[x / z, y / z]`.
///
/// `[height][width]`, camera's optical frame (x right, y down, z forward). A pixel without a ray has NaN: it
/// sees a point at or beyond the largest angle (90 degrees or less), or the lens model is not defined there.
/// Lens distortion is in the table, so that later stages do not depend on the lens model.
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
        Self::within_angle(camera, f64::INFINITY)
    }

    /// The rays of `camera` that are at most `max_angle_rad` from the optical axis; other pixels have none.
    ///
    /// Near 90 degrees a ray is almost parallel to the image plane: a depth of 10 m becomes a point
    /// kilometers away.
    #[must_use]
    pub fn within_angle(camera: &Camera, max_angle_rad: f64) -> Self {
        let max_tangent = if max_angle_rad < FRAC_PI_2 { max_angle_rad.tan() } else { f64::INFINITY };
        let Intrinsics { width, height, .. } = camera.intrinsics;
        let lens_from_pixel = lens_from_pixel(&camera.intrinsics);
        let ray = |(column, row): (u32, u32)| -> [f32; 2] {
            let distorted = lens_from_pixel * Vector3::new(f64::from(column), f64::from(row), 1.0);
            match camera.distortion.undistort(distorted.xy().into()) {
                Some(ray) if ray.coords.norm() <= max_tangent => [ray.x as f32, ray.y as f32],
                _ => [f32::NAN; 2],
            }
        };
        let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        Self { width, height, rays: pixels.map(ray).collect() }
    }

    /// Width, pixels.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height, pixels.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All rays, row by row from the top.
    #[must_use]
    pub fn rays(&self) -> &[[f32; 2]] {
        &self.rays
    }
}

/// The matrix that takes a pixel `(column, row, 1)` to its distorted point on the plane at depth 1.
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

    #[test]
    fn rays_beyond_the_largest_angle_are_nan() {
        // Columns 0 to 4 see tangents of 0 to 4; 75 degrees has one of 3.73.
        let intrinsics = Intrinsics::new(1.0, 1.0, 0.0, 0.0, 5, 1).unwrap();
        let table = RayTable::within_angle(&Camera::pinhole(intrinsics), 75.0_f64.to_radians());
        assert_eq!(table.rays()[..4], [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]);
        assert!(table.rays()[4].iter().all(|side| side.is_nan()));
    }

    proptest! {
        #[test]
        fn every_ray_projects_back_onto_its_pixel(
            width in 20u32..80, height in 20u32..60, focal in 0.3..3.0f64, off in -0.4..0.4f64,
        ) {
            let (w, h) = (f64::from(width), f64::from(height));
            let (fx, fy, cx, cy) = (focal * w, 1.1 * focal * w, (0.5 + off) * w, (0.5 - off) * h);
            let table = RayTable::new(&Camera::pinhole(Intrinsics::new(fx, fy, cx, cy, width, height).unwrap()));
            for (i, [x, y]) in table.rays().iter().enumerate() {
                let (column, row) = (i as u32 % width, i as u32 / width);
                prop_assert!((f64::from(*x) * fx + cx - f64::from(column)).abs() < 1e-3);
                prop_assert!((f64::from(*y) * fy + cy - f64::from(row)).abs() < 1e-3);
            }
        }
    }
}
