//! Focal lengths and principal point.

use std::num::NonZeroU32;

use nunet_types::{ImageSize, PixelRect};

use super::CameraError;
use super::accepted_range::accepted_range;

/// fx and fy differ by at most this factor, or one of them is wrong. Pixels are square. An image that was
/// squeezed, by an anamorphic lens or to another aspect ratio, has a factor of up to 2.4.
const MAX_FOCAL_RATIO: f64 = 3.0;

/// Pinhole intrinsics in pixels at a stated image size, pixel centers at whole numbers.
///
/// A point `(x, y, z)` in the camera's optical frame (x right, y down, z forward) appears at column
/// `fx * x / z + cx` and row `fy * y / z + cy`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Intrinsics {
    /// Focal length along the rows, pixels.
    pub fx_px: f64,
    /// Focal length along the columns, pixels.
    pub fy_px: f64,
    /// Column of the principal point; 0 is the center of the leftmost pixel.
    pub cx_px: f64,
    /// Row of the principal point; 0 is the center of the topmost pixel.
    pub cy_px: f64,
    /// Width of the image that these numbers are for, pixels.
    pub width: u32,
    /// Height of the image that these numbers are for, pixels.
    pub height: u32,
}

impl Intrinsics {
    /// Checked intrinsics for an image of `width` x `height` pixels.
    ///
    /// # Errors
    /// A number that is not finite, focal lengths that are not positive or out of range, a principal point
    /// far outside the image, a side of 0 pixels.
    pub fn new(
        fx_px: f64,
        fy_px: f64,
        cx_px: f64,
        cy_px: f64,
        width: u32,
        height: u32,
    ) -> Result<Self, CameraError> {
        if width == 0 || height == 0 {
            return Err(CameraError::Size { width, height });
        }
        check_focal("fx", fx_px, width)?;
        check_focal("fy", fy_px, height)?;
        check_ratio(fx_px, fy_px)?;
        check_center("cx", cx_px, width)?;
        check_center("cy", cy_px, height)?;
        Ok(Self { fx_px, fy_px, cx_px, cy_px, width, height })
    }

    /// Width and height of the image that these numbers are for.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        ImageSize::new(self.width, self.height)
    }

    /// The intrinsics after the whole image is resized to `width` x `height` pixels, each axis by its own
    /// factor.
    ///
    /// Pixel centers lie at whole numbers, so the image's left edge is at -0.5: `cx' = (cx + 0.5) * s - 0.5`.
    ///
    /// # Errors
    /// A side of 0 pixels.
    pub fn scaled_to(&self, width: u32, height: u32) -> Result<Self, CameraError> {
        if width == 0 || height == 0 {
            return Err(CameraError::Size { width, height });
        }
        let scale_x = f64::from(width) / f64::from(self.width);
        let scale_y = f64::from(height) / f64::from(self.height);
        Ok(Self {
            fx_px: self.fx_px * scale_x,
            fy_px: self.fy_px * scale_y,
            cx_px: (self.cx_px + 0.5) * scale_x - 0.5,
            cy_px: (self.cy_px + 0.5) * scale_y - 0.5,
            width,
            height,
        })
    }

    /// The intrinsics for an image of another size and the same aspect ratio.
    ///
    /// # Errors
    /// A size of another aspect ratio, by more than the rounding to whole pixels: such an image was cropped
    /// or stretched, and the intrinsics do not say where.
    pub fn fitted_to(&self, width: u32, height: u32) -> Result<Self, CameraError> {
        let Self { width: calibrated_width, height: calibrated_height, .. } = *self;
        let cross = |a: u32, b: u32| u64::from(a) * u64::from(b);
        let off = cross(width, calibrated_height).abs_diff(cross(calibrated_width, height));
        // One side follows from the other to less than a pixel: |W - w H / h| < 1, or |H - h W / w| < 1.
        if off >= u64::from(calibrated_width.max(calibrated_height)) {
            return Err(CameraError::Aspect { calibrated_width, calibrated_height, width, height });
        }
        self.scaled_to(width, height)
    }

    /// The intrinsics of a part of the image: the principal point moves, the focal lengths stay.
    #[must_use]
    pub fn cropped(&self, PixelRect { x, y, width, height }: PixelRect) -> Self {
        let (cx_px, cy_px) = (self.cx_px - f64::from(x), self.cy_px - f64::from(y));
        Self { cx_px, cy_px, width, height, ..*self }
    }

    /// The intrinsics of an image of size `canvas` in which this image lies at `place`, which has its size.
    #[must_use]
    pub fn padded(&self, place: PixelRect, canvas: ImageSize) -> Self {
        let (cx_px, cy_px) = (self.cx_px + f64::from(place.x), self.cy_px + f64::from(place.y));
        Self { cx_px, cy_px, width: canvas.width, height: canvas.height, ..*self }
    }

    /// The intrinsics of the image made of columns and rows 0, `stride`, 2 `stride`, ... of this one.
    ///
    /// Unlike [`Intrinsics::scaled_to`] the kept pixels stay where they are, so the principal point is only
    /// divided.
    #[must_use]
    pub fn subsampled(&self, stride: NonZeroU32) -> Self {
        let step = f64::from(stride.get());
        Self {
            fx_px: self.fx_px / step,
            fy_px: self.fy_px / step,
            cx_px: self.cx_px / step,
            cy_px: self.cy_px / step,
            width: self.width.div_ceil(stride.get()),
            height: self.height.div_ceil(stride.get()),
        }
    }

    /// The intrinsics of the image in which each whole block of `factor` x `factor` pixels of this one is one
    /// pixel. Columns at the right and rows at the bottom that do not fill a block are cut off.
    ///
    /// A new pixel's center is its block's center, so the half-pixel rule of [`Intrinsics::scaled_to`]
    /// applies: `cx' = (cx + 0.5) / factor - 0.5`. (librealsense only divides the principal point, which is
    /// off by `(factor - 1) / 2` of the old pixels.)
    #[must_use]
    pub fn decimated(&self, factor: NonZeroU32) -> Self {
        let pixels = f64::from(factor.get());
        Self {
            fx_px: self.fx_px / pixels,
            fy_px: self.fy_px / pixels,
            cx_px: (self.cx_px + 0.5) / pixels - 0.5,
            cy_px: (self.cy_px + 0.5) / pixels - 0.5,
            width: self.width / factor,
            height: self.height / factor,
        }
    }
}

pub(super) fn check_finite(name: &'static str, value: f64) -> Result<(), CameraError> {
    if value.is_finite() { Ok(()) } else { Err(CameraError::NotFinite { name, value }) }
}

pub(super) fn check_positive(name: &'static str, value: f64) -> Result<(), CameraError> {
    check_finite(name, value)?;
    if value > 0.0 { Ok(()) } else { Err(CameraError::NotPositive { name, value }) }
}

fn check_focal(name: &'static str, value: f64, side: u32) -> Result<(), CameraError> {
    check_positive(name, value)?;
    check_range(name, value, side)
}

fn check_center(name: &'static str, value: f64, side: u32) -> Result<(), CameraError> {
    check_finite(name, value)?;
    check_range(name, value, side)
}

fn check_range(name: &'static str, value: f64, side: u32) -> Result<(), CameraError> {
    let (min, max) = accepted_range(name, side);
    if (min..=max).contains(&value) { Ok(()) } else { Err(CameraError::OutOfRange { name, value, side }) }
}

/// Checks the ratio of the focal lengths.
pub(super) fn check_ratio(fx_px: f64, fy_px: f64) -> Result<(), CameraError> {
    if fx_px.max(fy_px) <= MAX_FOCAL_RATIO * fx_px.min(fy_px) {
        Ok(())
    } else {
        Err(CameraError::FocalRatio { fx_px, fy_px, max: MAX_FOCAL_RATIO })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn kinect() -> Intrinsics {
        Intrinsics::new(518.858, 519.470, 325.582, 253.736, 640, 480).unwrap()
    }

    #[test]
    fn half_the_size_moves_the_principal_point_by_the_half_pixel_rule() {
        let half = kinect().scaled_to(320, 240).unwrap();
        assert_eq!((half.fx_px, half.fy_px), (259.429, 259.735));
        assert!((half.cx_px - 162.541).abs() < 1e-9 && (half.cy_px - 126.618).abs() < 1e-9, "{half:?}");
    }

    #[test]
    fn each_axis_is_scaled_by_its_own_factor() {
        let wide = kinect().scaled_to(1280, 480).unwrap();
        assert_eq!((wide.fx_px, wide.fy_px, wide.cy_px), (1037.716, 519.470, 253.736));
    }

    #[test]
    fn subsampling_keeps_the_pixels_where_they_are() {
        let third = kinect().subsampled(NonZeroU32::new(3).unwrap());
        assert_eq!((third.width, third.height), (214, 160));
        assert_eq!((third.cx_px, third.fx_px), (325.582 / 3.0, 518.858 / 3.0));
    }

    #[test]
    fn the_center_of_a_block_becomes_the_center_of_a_pixel() {
        let third = kinect().decimated(NonZeroU32::new(3).unwrap());
        assert_eq!((third.width, third.height), (213, 160));
        assert_eq!(third.fx_px, 518.858 / 3.0);
        // Columns 300, 301 and 302 are block 100; a ray through the center of 301 goes through the center of
        // it.
        let ray = (301.0 - 325.582) / 518.858;
        assert!((ray * third.fx_px + third.cx_px - 100.0).abs() < 1e-9, "{third:?}");
        let half = kinect().decimated(NonZeroU32::new(2).unwrap());
        assert_eq!(Ok(half), kinect().scaled_to(320, 240));
    }

    #[test]
    fn a_principal_point_far_outside_the_image_is_refused() {
        let error = Intrinsics::new(500.0, 500.0, 320.0, 2000.0, 640, 480).unwrap_err();
        let expected = CameraError::OutOfRange { name: "cy", value: 2000.0, side: 480 };
        assert_eq!(error, expected);
    }

    #[test]
    fn focal_lengths_that_no_lens_has_are_refused() {
        let new = |fx, fy, side| Intrinsics::new(fx, fy, 0.5 * f64::from(side), 0.5, side, side);
        for (focal, side) in [(0.81, 640), (3.6, 640), (3.6, 64), (50.0, 640), (0.8, 64), (2e6, 4000)] {
            let error = new(focal, focal, side).unwrap_err();
            assert!(
                matches!(error, CameraError::OutOfRange { name: "fx", .. }),
                "{focal} of {side}: {error}"
            );
        }
        for (focal, side) in [(147.0, 640), (140.0, 640), (36_000.0, 640), (1.0, 1)] {
            assert!(new(focal, focal, side).is_ok(), "{focal} of {side}");
        }
        let error = new(500.0, 5000.0, 640).unwrap_err();
        assert_eq!(error, CameraError::FocalRatio { fx_px: 500.0, fy_px: 5000.0, max: 3.0 });
        assert!(new(5000.0, 500.0, 640).is_err() && new(500.0, 1200.0, 640).is_ok());
    }

    proptest! {
        #[test]
        fn scaling_there_and_back_changes_nothing(width in 1u32..5000, height in 1u32..5000) {
            let back = kinect().scaled_to(width, height).unwrap().scaled_to(640, 480).unwrap();
            prop_assert!((back.fx_px - kinect().fx_px).abs() < 1e-9);
            prop_assert!((back.cy_px - kinect().cy_px).abs() < 1e-9);
        }
    }
}
