//! The errors of intrinsics and lens coefficients.

use std::borrow::Cow;
use std::ops::RangeInclusive;

use nunet_types::Hint;

use super::Distortion;
use super::accepted_range::accepted_range;
use crate::error_kind::ErrorKind;

/// Why intrinsics or lens coefficients are invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// Not four numbers.
    #[error("expected 4 intrinsics, got {got}: `{text}`")]
    Count {
        /// How many there are.
        got: usize,
        /// The text.
        text: String,
    },
    /// Text that is not a number.
    #[error("intrinsic `{name}` is `{text}`, expected a number")]
    NotANumber {
        /// `fx`, `fy`, `cx` or `cy`.
        name: &'static str,
        /// The text.
        text: String,
    },
    /// Text that is not a size.
    #[error("`{text}` is not an image size")]
    NotASize {
        /// The text.
        text: String,
    },
    /// NaN or infinite.
    #[error("intrinsic `{name}` is `{value}`, expected a finite number")]
    NotFinite {
        /// `fx`, `fy`, `cx` or `cy`.
        name: &'static str,
        /// The value.
        value: f64,
    },
    /// A focal length of zero or less.
    #[error("focal length `{name}` is `{value}`, expected a number greater than 0")]
    NotPositive {
        /// `fx` or `fy`.
        name: &'static str,
        /// The value, pixels.
        value: f64,
    },
    /// A factor of depth out of range.
    #[error("the scale factor is {}, expected {min} to {max}", shown(*factor, *min..=*max))]
    ScaleFactor {
        /// The factor.
        factor: f64,
        /// The smallest one.
        min: f32,
        /// The largest one.
        max: f32,
    },
    /// An intrinsic out of range for this image size.
    #[error(
        "intrinsic `{name}` is {value} px, expected {} to {} for an image side of {side} px",
        accepted_range(name, *side).0,
        accepted_range(name, *side).1
    )]
    OutOfRange {
        /// `fx`, `fy`, `cx` or `cy`.
        name: &'static str,
        /// The value, pixels.
        value: f64,
        /// The image side along it, pixels.
        side: u32,
    },
    /// Coefficients of a tilted sensor in a camera that is to be rotated.
    #[error("its image is rotated, and a lens with a tilted sensor cannot be rotated")]
    TiltedSensor,
    /// Focal lengths that differ too much.
    #[error("focal lengths `fx` = {fx_px} and `fy` = {fy_px} px differ by more than a factor of {max}")]
    FocalRatio {
        /// Pixels.
        fx_px: f64,
        /// Pixels.
        fy_px: f64,
        /// The largest accepted factor.
        max: f64,
    },
    /// A count of coefficients that the lens model does not have.
    #[error("lens model `{model}` has {} coefficients, got {got}", alternatives(expected))]
    CoefficientCount {
        /// The lens model.
        model: &'static str,
        /// How many there are.
        got: usize,
        /// The counts that the model has.
        expected: &'static [usize],
    },
    /// A nonzero coefficient beyond the last one of the lens model.
    #[error("lens model `{model}` has at most {most} coefficients, but number {place} ({name}) is `{value}`")]
    ExtraCoefficient {
        /// The lens model.
        model: &'static str,
        /// How many coefficients the model has at most.
        most: usize,
        /// The coefficient's place, counted from 1.
        place: usize,
        /// Its usual name.
        name: String,
        /// Its value.
        value: f64,
    },
    /// A coefficient out of range.
    #[error("lens coefficient `{name}` is `{value}`, expected a number between -{limit} and {limit}")]
    Coefficient {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The largest accepted absolute value.
        limit: f64,
    },
    /// An image of another aspect ratio than the calibration's.
    #[error(
        "a calibration for images of {calibrated_width}x{calibrated_height} does not fit images of {width}x{height}: \
         the aspect ratios differ"
    )]
    Aspect {
        /// The calibration's width, pixels.
        calibrated_width: u32,
        /// The calibration's height, pixels.
        calibrated_height: u32,
        /// The image's width, pixels.
        width: u32,
        /// The image's height, pixels.
        height: u32,
    },
    /// A side of 0 pixels.
    #[error("a camera image of {width}x{height} pixels")]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
}

impl CameraError {
    /// [`ErrorKind::Camera`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Camera
    }
}

impl Hint for CameraError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::Count { .. } | Self::NotANumber { .. } => "write `fx,fy,cx,cy` or `fx,fy,cx,cy@WxH`".into(),
            Self::NotASize { .. } => "write width and height in pixels, as in `640x480`".into(),
            Self::OutOfRange { .. } => {
                "write intrinsics in pixels, not in millimeters or shares of the image, with the size they were calibrated \
                 at: `fx,fy,cx,cy@WxH`"
                    .into()
            }
            Self::ScaleFactor { .. } => {
                "pass the factor by which the network's meters are multiplied, such as 0.83".into()
            }
            Self::FocalRatio { .. } => "check both; most cameras have square pixels, so fx and fy are almost equal".into(),
            Self::CoefficientCount { .. } => "write all coefficients of the model, unused ones as 0".into(),
            Self::ExtraCoefficient { model, .. } => match Distortion::longer_ros_name(model) {
                Some(longer) => format!("use `{longer}`, the model that has this coefficient").into(),
                None => "calibrate with a supported lens model".into(),
            },
            Self::Coefficient { .. } => "calibrate again; this calibration did not converge".into(),
            Self::Aspect { width, height, .. } => {
                format!("calibrate at {width}x{height}; images may be resized, but not cropped or stretched")
                    .into()
            }
            Self::TiltedSensor => "calibrate with the images as they are after the rotation".into(),
            Self::NotFinite { .. } | Self::NotPositive { .. } | Self::Size { .. } => return None,
        })
    }
}

/// A factor out of range with four digits, or with all if four would be in range.
fn shown(factor: f64, range: RangeInclusive<f32>) -> f64 {
    let rounded = format!("{factor:.3e}").parse().unwrap_or(factor);
    if range.contains(&(rounded as f32)) { factor } else { rounded }
}

/// `4`, `4 or 5`, `4, 5 or 8`.
fn alternatives(counts: &[usize]) -> String {
    listed(&counts.iter().map(ToString::to_string).collect::<Vec<_>>(), "or")
}

/// `4`, `4 or 5`, `4, 5 or 8`: the words, with `conjunction` before the last one.
pub(super) fn listed(words: &[String], conjunction: &str) -> String {
    match words.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} {conjunction} {last}", rest.join(", ")),
        _ => words.concat(),
    }
}
