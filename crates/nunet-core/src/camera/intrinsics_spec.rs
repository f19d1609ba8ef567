//! Intrinsics as text: `fx,fy,cx,cy[@WxH]`.

use std::str::FromStr;

use nunet_types::ImageSize;

use super::intrinsics::{check_finite, check_positive, check_ratio};
use super::{CameraError, Intrinsics};

/// Intrinsics as a user writes them, `fx,fy,cx,cy` or `fx,fy,cx,cy@WxH`, before the image size is known.
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
    size: Option<ImageSize>,
}

impl IntrinsicsSpec {
    /// The intrinsics for an image of `width` x `height` pixels: scaled from the written size, or taken as
    /// they are if there is none.
    ///
    /// # Errors
    /// As [`Intrinsics::new`]; an image of another aspect ratio than the written size.
    pub fn at_size(&self, width: u32, height: u32) -> Result<Intrinsics, CameraError> {
        let [fx_px, fy_px, cx_px, cy_px] = self.numbers;
        let own = self.size.unwrap_or(ImageSize { width, height });
        Intrinsics::new(fx_px, fy_px, cx_px, cy_px, own.width, own.height)?.fitted_to(width, height)
    }

    /// Checks what does not depend on the image size, so that a bad argument is refused when it is parsed.
    fn check(&self) -> Result<(), CameraError> {
        match self.size {
            Some(ImageSize { width, height }) => self.at_size(width, height).map(|_| ()),
            None => {
                let [fx_px, fy_px, cx_px, cy_px] = self.numbers;
                check_positive("fx", fx_px)?;
                check_positive("fy", fy_px)?;
                check_ratio(fx_px, fy_px)?;
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

fn parse_size(text: &str) -> Result<ImageSize, CameraError> {
    text.split_once('x')
        .and_then(|(width, height)| {
            Some(ImageSize::new(width.trim().parse().ok()?, height.trim().parse().ok()?))
        })
        .ok_or_else(|| CameraError::NotASize { text: text.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn refusal(text: &str) -> CameraError {
        text.parse::<IntrinsicsSpec>().unwrap_err()
    }

    fn count(got: usize, text: &str) -> CameraError {
        CameraError::Count { got, text: text.to_owned() }
    }

    #[test]
    fn bad_numbers_are_refused_by_name() {
        assert!(matches!(refusal("nan,500,320,240"), CameraError::NotFinite { name: "fx", .. }));
        assert_eq!(refusal("500,-500,320,240"), CameraError::NotPositive { name: "fy", value: -500.0 });
        assert!(matches!(refusal("500,500,inf,240"), CameraError::NotFinite { name: "cx", .. }));
        assert_eq!(refusal("500,500,,240"), CameraError::NotANumber { name: "cx", text: String::new() });
        assert_eq!(refusal("500,500,320"), count(3, "500,500,320"));
        assert_eq!(refusal("500,500,320,240,0"), count(5, "500,500,320,240,0"));
        assert_eq!(refusal(""), count(1, ""));
        assert_eq!(refusal("500,500,320,240@640"), CameraError::NotASize { text: "640".to_owned() });
        assert_eq!(refusal("500,500,320,240@0x480"), CameraError::Size { width: 0, height: 480 });
    }

    #[test]
    fn millimeters_and_shares_of_the_image_in_place_of_pixels_are_refused() {
        for (text, value) in [
            ("0.004,0.004,320,240@640x480", 0.004),
            ("3.6,3.6,320,240@640x480", 3.6),
            ("0.81,1.08,0.5,0.5@640x480", 0.81),
        ] {
            let expected = CameraError::OutOfRange { name: "fx", value, side: 640 };
            assert_eq!(refusal(text), expected);
        }
        assert!(matches!(refusal("50,500,32,24"), CameraError::FocalRatio { .. }), "without a size too");
    }

    #[test]
    fn numbers_without_a_size_apply_to_any_image_size() {
        let spec: IntrinsicsSpec = "500, 501, 320, 240".parse().unwrap();
        assert_eq!(spec.at_size(640, 480), Intrinsics::new(500.0, 501.0, 320.0, 240.0, 640, 480));
    }

    #[test]
    fn numbers_for_images_of_another_aspect_ratio_are_refused_with_both_sizes() {
        let spec: IntrinsicsSpec = "1037,1038,651,507@1280x960".parse().unwrap();
        assert_eq!(spec.at_size(640, 480).unwrap().fx_px, 518.5);
        assert!(spec.at_size(213, 160).is_ok(), "rounded to whole pixels");
        let expected =
            CameraError::Aspect { calibrated_width: 1280, calibrated_height: 960, width: 640, height: 360 };
        assert_eq!(spec.at_size(640, 360), Err(expected));
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "[-0-9.,@xnaife ]{0,40}") {
            if let Ok(spec) = text.parse::<IntrinsicsSpec>() {
                let _ = spec.at_size(640, 480);
            }
        }
    }
}
