//! A factor of depth that was measured with another aspect mode.

use std::borrow::Cow;
use std::fmt;

use nunet_types::{AspectMode, Hint, ImageSize};

use super::Framing;
use crate::camera::CalibratedScale;

/// A factor that was measured with images that were taken in another way than these. The error of depth in a
/// squeezed image is another one than in a cropped one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AspectMismatch {
    factor: f32,
    image: ImageSize,
    measured: AspectMode,
    mode: AspectMode,
}

impl AspectMismatch {
    /// For images that are taken like this with the mode `mode`. `None` if they would be taken alike with the
    /// mode of the measurement, or if that is unknown.
    #[must_use]
    pub(crate) fn of(scale: &CalibratedScale, mode: AspectMode, framing: &Framing) -> Option<Self> {
        let CalibratedScale { factor, aspect, .. } = *scale;
        let measured = aspect.filter(|measured| framing.with_mode(*measured) != *framing)?;
        Some(Self { factor, image: framing.image(), measured, mode })
    }
}

impl fmt::Display for AspectMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { factor, image, measured, mode } = self;
        let (measured, mode) = (measured.name(), mode.name());
        write!(
            f,
            "the calibration's scale factor {factor} was measured with the aspect mode `{measured}`, but images of \
             {image} are taken with `{mode}`: depth may be wrong by a constant factor"
        )
    }
}

impl Hint for AspectMismatch {
    fn hint(&self) -> Option<Cow<'static, str>> {
        let (measured, mode) = (self.measured.name(), self.mode.name());
        Some(format!("calibrate again with `{mode}`, or choose `{measured}`").into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_images_of_another_aspect_ratio_depend_on_the_aspect_mode() {
        for measured in AspectMode::ALL {
            for mode in AspectMode::ALL {
                let mismatch = |image: (u32, u32), aspect| {
                    let framing = Framing::new(mode, image.into(), (640, 480).into());
                    let scale = CalibratedScale { factor: 0.9, model_hash: None, aspect };
                    AspectMismatch::of(&scale, mode, &framing)
                };
                let is_otherwise = mismatch((1280, 720), Some(measured)).is_some();
                assert_eq!(is_otherwise, mode != measured, "{mode:?} {measured:?}");
                assert_eq!(mismatch((1280, 960), Some(measured)), None, "{mode:?} {measured:?}");
                assert_eq!(mismatch((1280, 720), None), None, "of an older version");
            }
        }
    }
}
