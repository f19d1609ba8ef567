//! Focal lengths and principal point.

use std::num::NonZeroU32;
use std::str::FromStr;

/// Focal lengths beyond this many picture widths (or under its inverse) are a mistake of units, not a lens: a
/// telescope has some 500, a 175 degree fisheye 0.02.
const MAX_FOCAL_PER_SIDE: f64 = 1000.0;

/// The principal point may lie outside a cropped picture, by no more than this many of its sides.
const MAX_CENTRE_OUTSIDE: f64 = 1.0;

/// Pinhole intrinsics in pixels at a stated picture size, pixel centres at whole numbers.
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
    /// Column of the principal point; 0 is the centre of the leftmost pixel.
    pub cx_px: f64,
    /// Row of the principal point; 0 is the centre of the topmost pixel.
    pub cy_px: f64,
    /// Pixels from left to right of the picture that these numbers are for.
    pub width: u32,
    /// Pixels from top to bottom of the picture that these numbers are for.
    pub height: u32,
}

impl Intrinsics {
    /// Checked intrinsics for a picture of `width` x `height` pixels.
    ///
    /// # Errors
    /// A number that is not finite, a focal length that is not positive or beyond any lens, a principal point far
    /// outside the picture, a side of 0 pixels.
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
        check_centre("cx", cx_px, width)?;
        check_centre("cy", cy_px, height)?;
        Ok(Self { fx_px, fy_px, cx_px, cy_px, width, height })
    }

    /// The intrinsics after the whole picture is stretched to `width` x `height` pixels, each axis by itself.
    ///
    /// Pixel centres lie at whole numbers, so the picture's left edge is at -0.5: `cx' = (cx + 0.5) * s - 0.5`.
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

    /// The same intrinsics for a picture of another size and the same shape.
    ///
    /// # Errors
    /// A size whose sides have another ratio, by more than the rounding to whole pixels: such a picture was cropped or
    /// stretched, and nobody said where.
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

    /// The intrinsics of the picture made of columns and rows 0, `stride`, 2 `stride`, ... of this one.
    ///
    /// Unlike [`Intrinsics::scaled_to`] the kept pixels stay where they are, so the principal point is divided alone.
    #[must_use]
    pub fn decimated(&self, stride: NonZeroU32) -> Self {
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

    /// The intrinsics of the picture in which each whole block of `factor` x `factor` pixels of this one is a pixel;
    /// columns and rows at the right and at the bottom that fill no block are left out.
    ///
    /// The new pixel's middle is the block's middle, half a pixel off those around it where `factor` is even. So this is
    /// [`Intrinsics::scaled_to`]'s half-pixel rule and not [`Intrinsics::decimated`]'s: `cx' = (cx + 0.5) / factor - 0.5`.
    /// (librealsense divides the principal point alone, which is off by `(factor - 1) / 2` of the old pixels.)
    #[must_use]
    pub fn binned(&self, factor: NonZeroU32) -> Self {
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

fn check_finite(name: &'static str, value: f64) -> Result<(), CameraError> {
    if value.is_finite() { Ok(()) } else { Err(CameraError::NotFinite { name, value }) }
}

fn check_positive(name: &'static str, value: f64) -> Result<(), CameraError> {
    check_finite(name, value)?;
    if value > 0.0 { Ok(()) } else { Err(CameraError::NotPositive { name, value }) }
}

fn check_focal(name: &'static str, value: f64, side: u32) -> Result<(), CameraError> {
    check_positive(name, value)?;
    let sides = value / f64::from(side);
    if (1.0 / MAX_FOCAL_PER_SIDE..=MAX_FOCAL_PER_SIDE).contains(&sides) {
        Ok(())
    } else {
        Err(CameraError::OutOfRange { name, value, side })
    }
}

fn check_centre(name: &'static str, value: f64, side: u32) -> Result<(), CameraError> {
    check_finite(name, value)?;
    let sides = (value + 0.5) / f64::from(side);
    if (-MAX_CENTRE_OUTSIDE..=1.0 + MAX_CENTRE_OUTSIDE).contains(&sides) {
        Ok(())
    } else {
        Err(CameraError::OutOfRange { name, value, side })
    }
}

/// Intrinsics as a user writes them, `fx,fy,cx,cy` or `fx,fy,cx,cy@WxH`, before the picture's size is known.
///
/// # Example: numbers from a calibration at another size
/// ```
/// # use nunet_core::camera::{CameraError, IntrinsicsSpec};
/// let spec: IntrinsicsSpec = "1037,1038,651,507@1280x960".parse()?;
/// let intrinsics = spec.at_size(640, 480)?;
/// assert_eq!((intrinsics.fx_px, intrinsics.cx_px), (518.5, 325.25));
/// # Ok::<(), CameraError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntrinsicsSpec {
    numbers: [f64; 4],
    size: Option<(u32, u32)>,
}

impl IntrinsicsSpec {
    /// The intrinsics for a picture of `width` x `height` pixels: scaled from the size that was written, or taken as
    /// meant for this size where none was.
    ///
    /// # Errors
    /// As [`Intrinsics::new`]; a picture of another shape than that of the size that was written.
    pub fn at_size(&self, width: u32, height: u32) -> Result<Intrinsics, CameraError> {
        let [fx_px, fy_px, cx_px, cy_px] = self.numbers;
        let (own_width, own_height) = self.size.unwrap_or((width, height));
        Intrinsics::new(fx_px, fy_px, cx_px, cy_px, own_width, own_height)?.fitted_to(width, height)
    }

    /// What can be known to be wrong before the picture's size is, so that a bad argument is refused as one.
    fn check(&self) -> Result<(), CameraError> {
        match self.size {
            Some((width, height)) => self.at_size(width, height).map(|_| ()),
            None => {
                let [fx_px, fy_px, cx_px, cy_px] = self.numbers;
                check_positive("fx", fx_px)?;
                check_positive("fy", fy_px)?;
                check_finite("cx", cx_px)?;
                check_finite("cy", cy_px)
            }
        }
    }
}

impl FromStr for IntrinsicsSpec {
    type Err = CameraError;

    fn from_str(text: &str) -> Result<Self, CameraError> {
        let (numbers, size) = match text.split_once('@') {
            Some((numbers, size)) => (numbers, Some(parse_size(size)?)),
            None => (text, None),
        };
        let parts: Vec<&str> = numbers.split(',').map(str::trim).collect();
        let parts: [&str; 4] = parts
            .try_into()
            .map_err(|parts: Vec<_>| CameraError::Count { got: parts.len(), text: text.to_owned() })?;
        let mut spec = Self { numbers: [0.0; 4], size };
        for ((name, part), number) in ["fx", "fy", "cx", "cy"].into_iter().zip(parts).zip(&mut spec.numbers) {
            *number = parse_number(name, part)?;
        }
        spec.check()?;
        Ok(spec)
    }
}

fn parse_number(name: &'static str, text: &str) -> Result<f64, CameraError> {
    text.parse().map_err(|_| CameraError::NotANumber { name, text: text.to_owned() })
}

fn parse_size(text: &str) -> Result<(u32, u32), CameraError> {
    text.split_once('x')
        .and_then(|(width, height)| Some((width.trim().parse().ok()?, height.trim().parse().ok()?)))
        .ok_or_else(|| CameraError::NotASize { text: text.to_owned() })
}

/// What is wrong with a camera's numbers.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// Not four numbers.
    #[error(
        "intrinsics `{text}` hold `{got}` numbers, not 4\nhint: write `fx,fy,cx,cy` or `fx,fy,cx,cy@WxH`"
    )]
    Count {
        /// How many there are.
        got: usize,
        /// What was written.
        text: String,
    },
    /// Something else where a number belongs.
    #[error("intrinsic `{name}` is `{text}`, not a number\nhint: write `fx,fy,cx,cy` or `fx,fy,cx,cy@WxH`")]
    NotANumber {
        /// Which number.
        name: &'static str,
        /// What was written.
        text: String,
    },
    /// Something else where a size belongs.
    #[error("`{text}` is no picture size\nhint: write width and height in pixels, as in `640x480`")]
    NotASize {
        /// What was written.
        text: String,
    },
    /// NaN or infinite.
    #[error("intrinsic `{name}` is `{value}`, not a finite number")]
    NotFinite {
        /// Which number.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A focal length of zero or less.
    #[error("focal length `{name}` is `{value}`; it must be greater than 0")]
    NotPositive {
        /// Which number.
        name: &'static str,
        /// Its value, pixels.
        value: f64,
    },
    /// No lens has this number at this size.
    #[error(
        "intrinsic `{name}` of `{value}` pixels does not fit a picture `{side}` pixels long\nhint: intrinsics are \
         pixels, not millimetres, at the size that they were calibrated at (`fx,fy,cx,cy@WxH`)"
    )]
    OutOfRange {
        /// Which number.
        name: &'static str,
        /// Its value, pixels.
        value: f64,
        /// The picture's side along it, pixels.
        side: u32,
    },
    /// A lens with another count of coefficients than its model has.
    #[error(
        "lens model `{model}` has {} coefficients, not `{got}`\nhint: give all of them, those that are not used as 0",
        alternatives(expected)
    )]
    CoefficientCount {
        /// The lens model.
        model: &'static str,
        /// How many there are.
        got: usize,
        /// The counts that the model takes.
        expected: &'static [usize],
    },
    /// No lens has this coefficient.
    #[error(
        "lens coefficient `{name}` is `{value}`; it must be a number between -{limit} and {limit}\nhint: calibrate \
         again: it did not converge"
    )]
    Coefficient {
        /// Which coefficient.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The largest that is taken, of either sign.
        limit: f64,
    },
    /// A calibration for pictures of another shape.
    #[error(
        "a calibration for pictures of `{calibrated_width}x{calibrated_height}` does not fit pictures of \
         `{width}x{height}`: the sides' ratio differs\nhint: pictures may be resized, not cropped or stretched; \
         calibrate at `{width}x{height}`"
    )]
    Aspect {
        /// The calibration's pixels from left to right.
        calibrated_width: u32,
        /// The calibration's pixels from top to bottom.
        calibrated_height: u32,
        /// The picture's pixels from left to right.
        width: u32,
        /// The picture's pixels from top to bottom.
        height: u32,
    },
    /// A side of 0 pixels.
    #[error("a camera with a picture of `{width}x{height}` pixels")]
    Size {
        /// Pixels from left to right.
        width: u32,
        /// Pixels from top to bottom.
        height: u32,
    },
}

/// `4, 5 or 8`.
fn alternatives(counts: &[usize]) -> String {
    let words: Vec<String> = counts.iter().map(|count| format!("`{count}`")).collect();
    match words.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
        _ => words.concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn kinect() -> Intrinsics {
        Intrinsics::new(518.858, 519.470, 325.582, 253.736, 640, 480).unwrap()
    }

    fn message(text: &str) -> String {
        text.parse::<IntrinsicsSpec>().unwrap_err().to_string()
    }

    #[test]
    fn half_the_size_moves_the_principal_point_by_the_half_pixel_rule() {
        let half = kinect().scaled_to(320, 240).unwrap();
        assert_eq!((half.fx_px, half.fy_px), (259.429, 259.735));
        assert!((half.cx_px - 162.541).abs() < 1e-9 && (half.cy_px - 126.618).abs() < 1e-9, "{half:?}");
    }

    #[test]
    fn each_axis_is_stretched_by_itself() {
        let wide = kinect().scaled_to(1280, 480).unwrap();
        assert_eq!((wide.fx_px, wide.fy_px, wide.cy_px), (1037.716, 519.470, 253.736));
    }

    #[test]
    fn decimation_keeps_the_pixels_where_they_are() {
        let third = kinect().decimated(NonZeroU32::new(3).unwrap());
        assert_eq!((third.width, third.height), (214, 160));
        assert_eq!((third.cx_px, third.fx_px), (325.582 / 3.0, 518.858 / 3.0));
    }

    #[test]
    fn the_middle_of_a_block_becomes_the_middle_of_a_pixel() {
        let third = kinect().binned(NonZeroU32::new(3).unwrap());
        assert_eq!((third.width, third.height), (213, 160));
        assert_eq!(third.fx_px, 518.858 / 3.0);
        // Columns 300, 301 and 302 are block 100; a ray through the middle of 301 goes through the middle of it.
        let ray = (301.0 - 325.582) / 518.858;
        assert!((ray * third.fx_px + third.cx_px - 100.0).abs() < 1e-9, "{third:?}");
        let half = kinect().binned(NonZeroU32::new(2).unwrap());
        assert_eq!(Ok(half), kinect().scaled_to(320, 240));
    }

    #[test]
    fn bad_numbers_are_refused_by_name() {
        assert_eq!(message("nan,500,320,240"), "intrinsic `fx` is `NaN`, not a finite number");
        assert_eq!(message("500,-500,320,240"), "focal length `fy` is `-500`; it must be greater than 0");
        assert_eq!(message("500,500,inf,240"), "intrinsic `cx` is `inf`, not a finite number");
        assert!(message("500,500,,240").starts_with("intrinsic `cx` is ``, not a number\nhint: "));
        assert!(
            message("500,500,320").starts_with("intrinsics `500,500,320` hold `3` numbers, not 4\nhint: ")
        );
        assert!(message("500,500,320,240,0").contains("hold `5` numbers"));
        assert!(message("").contains("hold `1` numbers"));
        assert!(message("500,500,320,240@640").starts_with("`640` is no picture size\nhint: "));
        assert!(message("500,500,320,240@0x480").contains("`0x480` pixels"));
    }

    #[test]
    fn millimetres_in_place_of_pixels_are_refused() {
        let error = message("0.004,0.004,320,240@640x480");
        assert!(error.starts_with(
            "intrinsic `fx` of `0.004` pixels does not fit a picture `640` pixels long\nhint: "
        ));
    }

    #[test]
    fn a_principal_point_far_outside_the_picture_is_refused() {
        let error = Intrinsics::new(500.0, 500.0, 320.0, 2000.0, 640, 480).unwrap_err();
        assert_eq!(error, CameraError::OutOfRange { name: "cy", value: 2000.0, side: 480 });
    }

    #[test]
    fn numbers_without_a_size_are_taken_as_meant_for_the_picture() {
        let spec: IntrinsicsSpec = "500, 501, 320, 240".parse().unwrap();
        assert_eq!(spec.at_size(640, 480), Intrinsics::new(500.0, 501.0, 320.0, 240.0, 640, 480));
    }

    #[test]
    fn numbers_for_pictures_of_another_shape_are_refused_with_both_named() {
        let spec: IntrinsicsSpec = "1037,1038,651,507@1280x960".parse().unwrap();
        assert_eq!(spec.at_size(640, 480).unwrap().fx_px, 518.5);
        assert!(spec.at_size(213, 160).is_ok(), "rounded to whole pixels");
        let error = spec.at_size(640, 360).unwrap_err().to_string();
        assert!(
            error.starts_with("a calibration for pictures of `1280x960` does not fit pictures of `640x360`"),
            "{error}"
        );
    }

    proptest! {
        #[test]
        fn scaling_there_and_back_changes_nothing(width in 1u32..5000, height in 1u32..5000) {
            let back = kinect().scaled_to(width, height).unwrap().scaled_to(640, 480).unwrap();
            prop_assert!((back.fx_px - kinect().fx_px).abs() < 1e-9);
            prop_assert!((back.cy_px - kinect().cy_px).abs() < 1e-9);
        }

        #[test]
        fn no_text_panics(text in "[-0-9.,@xnaife ]{0,40}") {
            if let Ok(spec) = text.parse::<IntrinsicsSpec>() {
                let _ = spec.at_size(640, 480);
            }
        }
    }
}
