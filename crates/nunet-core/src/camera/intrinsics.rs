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
        Ok(Self {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            width,
            height,
        })
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
}

fn check_focal(name: &'static str, value: f64, side: u32) -> Result<(), CameraError> {
    let sides = value / f64::from(side);
    if !value.is_finite() {
        Err(CameraError::NotFinite { name, value })
    } else if value <= 0.0 {
        Err(CameraError::NotPositive { name, value })
    } else if !(1.0 / MAX_FOCAL_PER_SIDE..=MAX_FOCAL_PER_SIDE).contains(&sides) {
        Err(CameraError::OutOfRange { name, value, side })
    } else {
        Ok(())
    }
}

fn check_centre(name: &'static str, value: f64, side: u32) -> Result<(), CameraError> {
    let sides = (value + 0.5) / f64::from(side);
    if !value.is_finite() {
        Err(CameraError::NotFinite { name, value })
    } else if !(-MAX_CENTRE_OUTSIDE..=1.0 + MAX_CENTRE_OUTSIDE).contains(&sides) {
        Err(CameraError::OutOfRange { name, value, side })
    } else {
        Ok(())
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
    /// As [`Intrinsics::new`].
    pub fn at_size(&self, width: u32, height: u32) -> Result<Intrinsics, CameraError> {
        let [fx_px, fy_px, cx_px, cy_px] = self.numbers;
        let (own_width, own_height) = self.size.unwrap_or((width, height));
        Intrinsics::new(fx_px, fy_px, cx_px, cy_px, own_width, own_height)?.scaled_to(width, height)
    }
}

impl FromStr for IntrinsicsSpec {
    type Err = CameraError;

    fn from_str(text: &str) -> Result<Self, CameraError> {
        todo!("{text}")
    }
}

/// What is wrong with a camera's numbers.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
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
         pixels, not millimetres; say the size they were calibrated at with `fx,fy,cx,cy@WxH`"
    )]
    OutOfRange {
        /// Which number.
        name: &'static str,
        /// Its value, pixels.
        value: f64,
        /// The picture's side along it, pixels.
        side: u32,
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
