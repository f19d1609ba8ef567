//! The pipeline's words as the contract's.

use nunet_core::camera::Intrinsics;
use nunet_core::depth;
use nunet_core::frame::PixelFormat;
use nunet_core::graph;
use nunet_ipc::{Encoding, FrameHeader, Quality, ScaleSource, Units};

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
pub(crate) fn set_intrinsics(header: &mut FrameHeader, camera: Intrinsics) {
    (header.fx, header.fy, header.cx, header.cy) = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px);
}
