//! Computes the organized cloud in the camera's optical frame.

use std::num::NonZeroU32;

use nunet_types::ImageSize;

pub use nunet_types::{CloudPoint, NO_LABEL};

use crate::camera::RayTable;
use crate::error_kind::ErrorKind;
use crate::filter::Appearance;

/// Width and height of the cloud of every `stride`-th column and row of a depth map.
#[must_use]
pub fn cloud_size(size: ImageSize, stride: NonZeroU32) -> ImageSize {
    let ImageSize { width, height } = size;
    ImageSize { width: width.div_ceil(stride.get()), height: height.div_ceil(stride.get()) }
}

/// The options of a cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudOptions {
    /// Each n-th column and row.
    pub stride: NonZeroU32,
    /// A point farther from the camera has no coordinates, meters; infinite for no limit.
    pub max_range_m: f32,
}

/// Fills `out` with the points of columns and rows 0, `stride`, 2 `stride`, ... of a depth map.
///
/// `depth_m` is `[height][width]` at the size of `rays`, meters along the optical axis, and `appearance` has
/// the same size; `out` is [`cloud_size`] points, rows from the top. A point without depth, without a ray, or
/// out of range keeps its place with NaN coordinates.
///
/// # Errors
/// A buffer of another size.
pub fn organized_cloud(
    depth_m: &[f32],
    rays: &RayTable,
    appearance: &Appearance<'_>,
    options: CloudOptions,
    out: &mut [CloudPoint],
) -> Result<(), CloudError> {
    let Appearance { rgb, labels } = *appearance;
    let CloudOptions { stride, max_range_m } = options;
    let (width, height) = (rays.width(), rays.height());
    let check = |buffer, got, expected| {
        if got == expected { Ok(()) } else { Err(CloudError::Size { buffer, got, expected, width, height }) }
    };
    let pixels = rays.rays().len();
    let points = cloud_size(ImageSize { width, height }, stride).pixel_count();
    check("depth", depth_m.len(), pixels)?;
    check("rgb", rgb.len(), 3 * pixels)?;
    check("labels", labels.map_or(pixels, <[u8]>::len), pixels)?;
    check("points", out.len(), points)?;

    let max_squared = max_range_m * max_range_m;
    let pixels = CloudInput { depth_m, rays: rays.rays(), rgb: rgb.as_chunks().0, max_squared };
    match labels {
        Some(labels) => pixels.fill(width as usize, stride, out, |pixel| labels[pixel]),
        None => pixels.fill(width as usize, stride, out, |_| NO_LABEL),
    }
    Ok(())
}

/// The inputs of points, one element per pixel.
struct CloudInput<'a> {
    depth_m: &'a [f32],
    rays: &'a [[f32; 2]],
    rgb: &'a [[u8; 3]],
    /// The square of the largest distance from the camera.
    max_squared: f32,
}

impl CloudInput<'_> {
    /// Generic over the label, so that the loop has no branch for it.
    fn fill(&self, width: usize, stride: NonZeroU32, out: &mut [CloudPoint], label: impl Fn(usize) -> u8) {
        let step = stride.get() as usize;
        for (out_row, points) in out.chunks_exact_mut(width.div_ceil(step)).enumerate() {
            let first = out_row * step * width;
            for (out_column, point) in points.iter_mut().enumerate() {
                let pixel = first + out_column * step;
                *point = self.point(pixel, label(pixel));
            }
        }
    }

    #[inline]
    fn point(&self, pixel: usize, label: u8) -> CloudPoint {
        let [ray_x, ray_y] = self.rays[pixel];
        let [r, g, b] = self.rgb[pixel];
        let z = self.depth_m[pixel];
        let (x, y) = (ray_x * z, ray_y * z);
        // False for NaN too, which x and y are where there is no depth or no ray.
        let is_valid = x * x + y * y + z * z <= self.max_squared;
        let [x, y, z] = if is_valid { [x, y, z] } else { [f32::NAN; 3] };
        CloudPoint { x, y, z, b, g, r, label }
    }
}

/// Why the buffers of a cloud are invalid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CloudError {
    /// A buffer of another size than the depth map.
    #[error(
        "the cloud's buffer `{buffer}` has {got} elements, expected {expected} for depth of {width}x{height}"
    )]
    Size {
        /// The buffer.
        buffer: &'static str,
        /// Elements given.
        got: usize,
        /// Elements needed.
        expected: usize,
        /// Width of the depth map, pixels.
        width: u32,
        /// Height of the depth map, pixels.
        height: u32,
    },
}

impl CloudError {
    /// [`ErrorKind::Buffer`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Buffer
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Intrinsics};
    use proptest::prelude::*;

    const ONE: NonZeroU32 = NonZeroU32::MIN;
    const BLANK: CloudPoint = CloudPoint { x: 0.0, y: 0.0, z: 0.0, b: 0, g: 0, r: 0, label: 0 };

    fn rays(fx: f64, fy: f64, cx: f64, cy: f64, width: u32, height: u32) -> RayTable {
        RayTable::new(&Camera::pinhole(Intrinsics::new(fx, fy, cx, cy, width, height).unwrap()))
    }

    fn cloud(
        depth_m: &[f32],
        rays: &RayTable,
        rgb: &[u8],
        labels: Option<&[u8]>,
        stride: NonZeroU32,
        out: &mut [CloudPoint],
    ) -> Result<(), CloudError> {
        let options = CloudOptions { stride, max_range_m: f32::INFINITY };
        organized_cloud(depth_m, rays, &Appearance { rgb, labels }, options, out)
    }

    #[test]
    fn a_point_is_16_bytes_with_the_color_at_12_and_the_label_at_15() {
        assert_eq!(size_of::<CloudPoint>(), 16);
        assert_eq!(std::mem::offset_of!(CloudPoint, b), 12);
        assert_eq!(std::mem::offset_of!(CloudPoint, r), 14);
        assert_eq!(std::mem::offset_of!(CloudPoint, label), 15);
    }

    #[test]
    fn a_hand_computed_cloud_of_two_points() {
        let rays = rays(2.0, 4.0, 0.5, 1.0, 2, 1);
        let mut out = [BLANK; 2];
        cloud(&[2.0, 4.0], &rays, &[1, 2, 3, 4, 5, 6], Some(&[7, 8]), ONE, &mut out).unwrap();
        assert_eq!(out[0], CloudPoint { x: -0.5, y: -0.5, z: 2.0, b: 3, g: 2, r: 1, label: 7 });
        assert_eq!(out[1], CloudPoint { x: 1.0, y: -1.0, z: 4.0, b: 6, g: 5, r: 4, label: 8 });
    }

    #[test]
    fn a_point_without_depth_keeps_its_place_and_color() {
        let mut out = [BLANK; 2];
        let rays = rays(2.0, 4.0, 0.5, 0.0, 2, 1);
        cloud(&[f32::NAN, 1.0], &rays, &[9; 6], None, ONE, &mut out).unwrap();
        assert!(out[0].x.is_nan() && out[0].y.is_nan() && out[0].z.is_nan());
        assert_eq!((out[0].r, out[0].label, out[1].z), (9, NO_LABEL, 1.0));
    }

    #[test]
    fn a_stride_keeps_every_nth_column_and_row_and_the_last_odd_one() {
        let (width, height) = (5u32, 3u32);
        let stride = NonZeroU32::new(2).unwrap();
        let depth: Vec<f32> = (1..=15).map(|z| z as f32).collect();
        let mut out = vec![BLANK; 6];
        let rays = rays(5.0, 3.0, 2.0, 1.0, width, height);
        cloud(&depth, &rays, &[0; 45], None, stride, &mut out).unwrap();
        assert_eq!(cloud_size(ImageSize { width, height }, stride), ImageSize::new(3, 2));
        assert_eq!(out.iter().map(|point| point.z).collect::<Vec<_>>(), [1.0, 3.0, 5.0, 11.0, 13.0, 15.0]);
    }

    #[test]
    fn a_point_out_of_range_keeps_its_place_without_coordinates() {
        // The rays are (0, 0), (1, 0), (2, 0) and (3, 0).
        let rays = rays(1.0, 1.0, 0.0, 0.0, 4, 1);
        let mut out = [BLANK; 4];
        let options = CloudOptions { stride: ONE, max_range_m: 3.0 };
        let appearance = Appearance { rgb: &[5; 12], labels: None };
        organized_cloud(&[3.0, 2.0, 2.0, 0.5], &rays, &appearance, options, &mut out).unwrap();
        assert_eq!((out[0].z, out[1].z, out[3].x), (3.0, 2.0, 1.5));
        assert!(out[2].x.is_nan() && out[2].y.is_nan() && out[2].z.is_nan(), "4.5 m away");
        assert_eq!(out[2].r, 5);
    }

    #[test]
    fn a_buffer_of_another_size_is_refused_by_name() {
        let rays = rays(2.0, 2.0, 0.5, 0.5, 2, 2);
        let mut out = [BLANK; 4];
        let error = cloud(&[1.0; 4], &rays, &[0; 11], None, ONE, &mut out).unwrap_err();
        let expected = CloudError::Size { buffer: "rgb", got: 11, expected: 12, width: 2, height: 2 };
        assert_eq!(error, expected);
    }

    proptest! {
        #[test]
        fn every_point_projects_back_onto_its_pixel(
            width in 8u32..40, height in 8u32..30, stride in 1u32..5, focal in 0.3..3.0f64, depth in 0.1..50f32,
        ) {
            let stride = NonZeroU32::new(stride).unwrap();
            let fx = focal * f64::from(width.max(height));
            let fy = fx;
            let (cx, cy) = (0.4 * f64::from(width), 0.6 * f64::from(height));
            let full = Intrinsics::new(fx, fy, cx, cy, width, height).unwrap();
            let pixels = (width * height) as usize;
            let depth_m: Vec<f32> = (0..pixels).map(|i| depth * (1.0 + (i % 7) as f32)).collect();
            let ImageSize { width: cloud_width, height: cloud_height } =
                cloud_size(ImageSize { width, height }, stride);
            let mut out = vec![BLANK; (cloud_width * cloud_height) as usize];
            let rays = RayTable::new(&Camera::pinhole(full));
            cloud(&depth_m, &rays, &vec![0; 3 * pixels], None, stride, &mut out).unwrap();

            let kept = full.subsampled(stride);
            prop_assert_eq!((kept.width, kept.height), (cloud_width, cloud_height));
            for (i, point) in out.iter().enumerate() {
                let column = f64::from(point.x / point.z) * kept.fx_px + kept.cx_px;
                let row = f64::from(point.y / point.z) * kept.fy_px + kept.cy_px;
                prop_assert!((column - f64::from(i as u32 % cloud_width)).abs() < 1e-3);
                prop_assert!((row - f64::from(i as u32 / cloud_width)).abs() < 1e-3);
            }
        }
    }
}
