//! Converts a camera to the plain numbers of messages, and back.

use nunet_types::{CameraInfo, DistortionModel, ImageSize};

use super::{Camera, CameraError, Distortion, Intrinsics};

impl From<&Camera> for CameraInfo {
    fn from(camera: &Camera) -> Self {
        let Intrinsics { fx_px, fy_px, cx_px, cy_px, width, height } = camera.intrinsics;
        let distortion_model = camera.distortion.model();
        let (size, distortion) = (ImageSize::new(width, height), camera.distortion.coefficients());
        Self { size, fx_px, fy_px, cx_px, cy_px, distortion_model, distortion }
    }
}

impl TryFrom<&CameraInfo> for Camera {
    type Error = CameraError;

    fn try_from(info: &CameraInfo) -> Result<Self, CameraError> {
        let CameraInfo { size, fx_px, fy_px, cx_px, cy_px, .. } = *info;
        let intrinsics = Intrinsics::new(fx_px, fy_px, cx_px, cy_px, size.width, size.height)?;
        Ok(Self { intrinsics, distortion: distortion(info.distortion_model, &info.distortion)? })
    }
}

/// Coefficients after those of the model must be zero: a sender that writes more means another model.
fn distortion(model: DistortionModel, coefficients: &[f64]) -> Result<Distortion, CameraError> {
    let used = coefficients.iter().rposition(|&coefficient| coefficient != 0.0).map_or(0, |last| last + 1);
    match Distortion::entry(model) {
        Some(lens) => (lens.new)(&coefficients[..used.max(lens.max_count())]),
        None if used > 0 => {
            Err(CameraError::CoefficientCount { model: model.name(), got: used, expected: &[0] })
        }
        None => Ok(Distortion::None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{BrownConrady, KannalaBrandt};

    fn info(distortion: Distortion) -> CameraInfo {
        let intrinsics = Intrinsics::new(500.0, 501.0, 320.0, 240.0, 640, 480).unwrap();
        CameraInfo::from(&Camera { intrinsics, distortion })
    }

    fn brown_conrady() -> Distortion {
        Distortion::BrownConrady(BrownConrady::new(&[-0.3, 0.1, 0.001, -0.002, 0.01]).unwrap())
    }

    fn kannala_brandt() -> Distortion {
        Distortion::KannalaBrandt(KannalaBrandt::new(&[0.01, -0.002, 0.0, 0.0]).unwrap())
    }

    #[test]
    fn a_camera_reads_back_from_its_numbers_for_every_lens_model() {
        for distortion in [Distortion::None, brown_conrady(), kannala_brandt()] {
            let read = Camera::try_from(&info(distortion)).unwrap();
            assert_eq!((read.distortion, read.intrinsics.fy_px), (distortion, 501.0));
        }
        assert_eq!(info(brown_conrady()).distortion[..6], [-0.3, 0.1, 0.001, -0.002, 0.01, 0.0]);
    }

    #[test]
    fn coefficients_that_the_lens_model_does_not_have_are_refused() {
        let refused = |info: CameraInfo| Camera::try_from(&info).unwrap_err();
        let mut long = info(kannala_brandt());
        long.distortion[4] = 0.1;
        assert!(matches!(
            refused(long),
            CameraError::CoefficientCount { model: "kannala_brandt", got: 5, .. }
        ));
        let mut none = info(Distortion::None);
        none.distortion[13] = f64::NAN;
        assert!(matches!(refused(none), CameraError::CoefficientCount { model: "none", got: 14, .. }));
        let mut bad = info(brown_conrady());
        bad.distortion[0] = f64::INFINITY;
        assert!(matches!(refused(bad), CameraError::Coefficient { name: "k1", .. }));
    }
}
