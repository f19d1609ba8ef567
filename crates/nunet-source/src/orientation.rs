//! Rotates a camera together with its image. EXIF, or the user, states how the camera was held. The image is
//! rotated upright, so the camera that the source states is rotated the same way: its sides and focal lengths
//! may swap, the principal point moves, and the lens is mirrored.

use image::metadata::Orientation;
use nunet_core::camera::{Camera, CameraError, Intrinsics};

/// How the stored image becomes the upright one: with `swap`, columns and rows are exchanged first; then
/// each axis with its flag set is reversed.
struct ImageTransform {
    swap: bool,
    backwards_x: bool,
    backwards_y: bool,
}

impl ImageTransform {
    fn of(orientation: Orientation) -> Self {
        let (swap, backwards_x, backwards_y) = match orientation {
            Orientation::NoTransforms => (false, false, false),
            Orientation::FlipHorizontal => (false, true, false),
            Orientation::Rotate180 => (false, true, true),
            Orientation::FlipVertical => (false, false, true),
            Orientation::Rotate90FlipH => (true, false, false),
            Orientation::Rotate90 => (true, true, false),
            Orientation::Rotate270FlipH => (true, true, true),
            Orientation::Rotate270 => (true, false, true),
        };
        Self { swap, backwards_x, backwards_y }
    }

    /// A vector of the image plane.
    fn vector(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [x, y] = if self.swap { [y, x] } else { [x, y] };
        [if self.backwards_x { -x } else { x }, if self.backwards_y { -y } else { y }]
    }
}

/// The camera of an image that was rotated by `orientation`; `camera` describes the stored image.
///
/// # Errors
/// [`CameraError::TiltedSensor`].
pub(crate) fn oriented_camera(camera: &Camera, orientation: Orientation) -> Result<Camera, CameraError> {
    if orientation == Orientation::NoTransforms {
        return Ok(*camera);
    }
    let transform = ImageTransform::of(orientation);
    let Intrinsics { fx_px, fy_px, cx_px, cy_px, width, height, .. } = camera.intrinsics;
    let sides = |x: f64, y: f64| if transform.swap { (y, x) } else { (x, y) };
    let (fx, fy) = sides(fx_px, fy_px);
    let (cx, cy) = sides(cx_px, cy_px);
    let (width, height) = if transform.swap { (height, width) } else { (width, height) };
    let mirrored = |backwards: bool, center: f64, side: u32| {
        if backwards { f64::from(side) - 1.0 - center } else { center }
    };
    let (cx, cy) = (mirrored(transform.backwards_x, cx, width), mirrored(transform.backwards_y, cy, height));
    let intrinsics = Intrinsics::new(fx, fy, cx, cy, width, height)?;
    let distortion = camera.distortion.transformed(|vector| transform.vector(vector))?;
    Ok(Camera { intrinsics, distortion })
}

#[cfg(test)]
mod tests {
    use image::{DynamicImage, GrayImage, Luma};
    use nunet_core::camera::{BrownConrady, Distortion};

    use super::*;

    const ALL: [Orientation; 8] = [
        Orientation::NoTransforms,
        Orientation::FlipHorizontal,
        Orientation::Rotate180,
        Orientation::FlipVertical,
        Orientation::Rotate90FlipH,
        Orientation::Rotate90,
        Orientation::Rotate270FlipH,
        Orientation::Rotate270,
    ];

    /// A point in space is seen where the turned image shows what the stored one showed of it.
    #[test]
    fn a_rotated_camera_projects_points_onto_the_rotated_image() {
        let coefficients =
            [-0.2, 0.05, 0.01, -0.02, 0.01, 0.1, 0.02, 0.003, 0.004, -0.003, 0.002, 0.001, 0.0, 0.0];
        let distortion = Distortion::BrownConrady(BrownConrady::new(&coefficients).unwrap());
        let intrinsics = Intrinsics::new(50.0, 60.0, 20.0, 15.0, 64, 48).unwrap();
        let camera = Camera { intrinsics, distortion };
        for orientation in ALL {
            let seen = oriented_camera(&camera, orientation).unwrap();
            for [x, y] in [[0.1, 0.05], [-0.2, 0.15], [0.3, -0.1]] {
                let [column, row] = camera.project([x, y, 1.0]).unwrap();
                let [x, y] = ImageTransform::of(orientation).vector([x, y]);
                let found = seen.project([x, y, 1.0]).unwrap();
                let expected = shown(orientation, (column, row));
                let off = (found[0] - expected.0).abs().max((found[1] - expected.1).abs());
                assert!(off < 1e-9, "{orientation:?}: {found:?} instead of {expected:?}");
            }
        }
    }

    /// Where `image` shows a pixel after turning, for any place between pixels: from three marked ones.
    fn shown(orientation: Orientation, (column, row): (f64, f64)) -> (f64, f64) {
        let place = |x: u32, y: u32| {
            let mut image = GrayImage::new(64, 48);
            image.put_pixel(x, y, Luma([255]));
            let mut image = DynamicImage::ImageLuma8(image);
            image.apply_orientation(orientation);
            let image = image.into_luma8();
            let at = image.iter().position(|&value| value == 255).unwrap() as u32;
            (f64::from(at % image.width()), f64::from(at / image.width()))
        };
        let (origin, right, down) = (place(0, 0), place(1, 0), place(0, 1));
        let along =
            |origin: f64, right: f64, down: f64| origin + column * (right - origin) + row * (down - origin);
        (along(origin.0, right.0, down.0), along(origin.1, right.1, down.1))
    }

    #[test]
    fn a_half_turn_mirrors_the_principal_point() {
        let camera = Camera::pinhole(Intrinsics::new(50.0, 50.0, 20.0, 15.0, 64, 48).unwrap());
        let turned = oriented_camera(&camera, Orientation::Rotate180).unwrap();
        assert_eq!((turned.intrinsics.cx_px, turned.intrinsics.cy_px), (43.0, 32.0));
    }

    #[test]
    fn a_tilted_sensor_is_refused() {
        let mut coefficients = [0.0; 14];
        coefficients[12] = 0.01;
        let distortion = Distortion::BrownConrady(BrownConrady::new(&coefficients).unwrap());
        let camera =
            Camera { intrinsics: Intrinsics::new(50.0, 50.0, 20.0, 15.0, 64, 48).unwrap(), distortion };
        assert_eq!(oriented_camera(&camera, Orientation::Rotate90), Err(CameraError::TiltedSensor));
        assert_eq!(oriented_camera(&camera, Orientation::NoTransforms), Ok(camera), "an upright image");
    }
}
