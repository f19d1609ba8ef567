//! The pipeline's words as the contract's, and what is written in one way everywhere.

use nunet_core::camera::{BrownConrady, Camera, CameraError, Distortion, Intrinsics, KannalaBrandt};
use nunet_core::depth;
use nunet_core::frame::PixelFormat;
use nunet_core::graph;
use nunet_ipc::{DistortionModel, Encoding, FrameHeader, Quality, ScaleSource, Units};

/// The coordinate frame of a camera whose user names none.
pub(crate) fn default_frame_id(camera: &str) -> String {
    format!("{camera}_optical_frame")
}

/// A hash as people and files write it.
pub(crate) fn hexadecimal(hash: &[u8]) -> String {
    hash.iter().map(|byte| format!("{byte:02x}")).collect()
}

pub(crate) fn units(units: depth::Units) -> Units {
    match units {
        depth::Units::None => Units::None,
        depth::Units::Metre => Units::Metre,
        depth::Units::Relative => Units::Relative,
    }
}

pub(crate) fn scale_source(source: depth::ScaleSource) -> ScaleSource {
    match source {
        depth::ScaleSource::Metric => ScaleSource::Metric,
        depth::ScaleSource::FocalScaled => ScaleSource::FocalScaled,
        depth::ScaleSource::AssumedCamera => ScaleSource::AssumedCamera,
        depth::ScaleSource::Relative => ScaleSource::Relative,
    }
}

pub(crate) fn quality(quality: graph::Quality) -> Quality {
    match quality {
        graph::Quality::Full => Quality::Full,
        graph::Quality::ReusedLabels => Quality::ReusedLabels,
        graph::Quality::Fallback => Quality::Fallback,
    }
}

pub(crate) fn encoding(format: PixelFormat) -> Encoding {
    match format {
        PixelFormat::Rgb8 => Encoding::Rgb8,
        PixelFormat::Bgr8 => Encoding::Bgr8,
        PixelFormat::Mono8 => Encoding::Mono8,
        PixelFormat::Yuyv => Encoding::Yuyv,
        PixelFormat::Nv12 => Encoding::Nv12,
    }
}

/// `None` for what is no picture.
pub(crate) fn pixel_format(encoding: Encoding) -> Option<PixelFormat> {
    PixelFormat::ALL.into_iter().find(|&format| self::encoding(format) == encoding)
}

/// Bytes of one cell of a result; 0 for what has no cells.
pub(crate) fn bytes_per_cell(encoding: Encoding) -> u32 {
    match encoding {
        Encoding::DepthF32 => 4,
        Encoding::LabelsU8 => 1,
        Encoding::Points => 16,
        _ => 0,
    }
}

/// The camera of a message, at the message's size.
pub(crate) fn set_camera(header: &mut FrameHeader, camera: &Camera) {
    let Intrinsics { fx_px, fy_px, cx_px, cy_px, .. } = camera.intrinsics;
    (header.fx, header.fy, header.cx, header.cy) = (fx_px, fy_px, cx_px, cy_px);
    header.distortion = camera.distortion.coefficients();
    header.set_distortion_model(match camera.distortion {
        Distortion::None => DistortionModel::None,
        Distortion::BrownConrady(_) => DistortionModel::BrownConrady,
        Distortion::KannalaBrandt(_) => DistortionModel::KannalaBrandt,
    });
}

/// The camera that a message tells of; `None` where its sender does not know it.
///
/// # Errors
/// Numbers that no camera has, a lens model without a meaning, coefficients beyond those of the model.
pub(crate) fn camera(header: &FrameHeader) -> anyhow::Result<Option<Camera>> {
    if !header.has_intrinsics() {
        return Ok(None);
    }
    let FrameHeader { fx, fy, cx, cy, width, height, .. } = *header;
    let intrinsics = Intrinsics::new(fx, fy, cx, cy, width, height)?;
    Ok(Some(Camera { intrinsics, distortion: distortion(header.distortion_model()?, &header.distortion)? }))
}

/// What is behind a model's coefficients must be zeros: whoever writes more means another model.
fn distortion(model: DistortionModel, coefficients: &[f64]) -> Result<Distortion, CameraError> {
    let used = coefficients.iter().rposition(|&coefficient| coefficient != 0.0).map_or(0, |last| last + 1);
    match model {
        DistortionModel::None if used > 0 => Err(CameraError::CoefficientCount {
            model: DistortionModel::None.name(),
            got: used,
            expected: &[0],
        }),
        DistortionModel::None => Ok(Distortion::None),
        DistortionModel::BrownConrady => BrownConrady::new(coefficients).map(Distortion::BrownConrady),
        DistortionModel::KannalaBrandt => {
            KannalaBrandt::new(&coefficients[..used.max(4)]).map(Distortion::KannalaBrandt)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(distortion: Distortion) -> FrameHeader {
        let intrinsics = Intrinsics::new(500.0, 501.0, 320.0, 240.0, 640, 480).unwrap();
        let mut header = FrameHeader { width: 640, height: 480, ..FrameHeader::default() };
        set_camera(&mut header, &Camera { intrinsics, distortion });
        header
    }

    fn brown_conrady() -> Distortion {
        Distortion::BrownConrady(BrownConrady::new(&[-0.3, 0.1, 0.001, -0.002, 0.01]).unwrap())
    }

    fn kannala_brandt() -> Distortion {
        Distortion::KannalaBrandt(KannalaBrandt::new(&[0.01, -0.002, 0.0, 0.0]).unwrap())
    }

    #[test]
    fn a_camera_travels_through_a_header_whatever_its_lens() {
        for distortion in [Distortion::None, brown_conrady(), kannala_brandt()] {
            let read = camera(&header(distortion)).unwrap().unwrap();
            assert_eq!((read.distortion, read.intrinsics.fy_px), (distortion, 501.0));
        }
        assert_eq!(header(brown_conrady()).distortion[..6], [-0.3, 0.1, 0.001, -0.002, 0.01, 0.0]);
        assert_eq!(camera(&FrameHeader::default()).unwrap(), None);
    }

    /// nunet-ipc knows nothing of core, and publishers nothing but nunet-ipc.
    #[test]
    fn publishers_lay_their_pictures_as_the_pipeline_reads_them() {
        assert_eq!(nunet_ipc::MAX_SIDE_PX, nunet_core::frame::MAX_SIDE_PX);
        assert_eq!(PixelFormat::ALL.map(encoding), Encoding::PICTURES);
        for format in PixelFormat::ALL {
            for (width, height) in [(1, 1), (7, 5), (640, 480), (nunet_ipc::MAX_SIDE_PX, 3)] {
                let (row_bytes, rows) = encoding(format).rows_of_picture(width, height).unwrap();
                assert_eq!(row_bytes, format.min_stride(width), "{format} {width}x{height}");
                let bytes = row_bytes as usize * rows as usize;
                assert_eq!(bytes, format.byte_len(width, height, row_bytes), "{format} {width}x{height}");
            }
        }
    }

    #[test]
    fn a_lens_that_means_nothing_is_refused() {
        let message = |header: FrameHeader| camera(&header).unwrap_err().to_string();
        let unknown = FrameHeader { distortion_model: 9, ..header(Distortion::None) };
        assert_eq!(message(unknown), "field `distortion_model` holds `9`, but contract 1 knows only 0 to 2");

        let mut long = header(kannala_brandt());
        long.distortion[4] = 0.1;
        assert!(
            message(long).starts_with("lens model `kannala_brandt` has `4` coefficients, not `5`\nhint: ")
        );
        let mut none = header(Distortion::None);
        none.distortion[13] = f64::NAN;
        assert!(message(none).starts_with("lens model `none` has `0` coefficients, not `14`\nhint: "));
        let mut bad = header(brown_conrady());
        bad.distortion[0] = f64::INFINITY;
        assert!(message(bad).starts_with("lens coefficient `k1` is `inf`; "));
    }
}
