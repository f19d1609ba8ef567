//! Depth as 16-bit PNG.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use nunet_files::millimeters;

use crate::frame::ViewFrame;

/// The depth map in millimeters, 0 = no measurement, at its full size; empty if there is none.
pub(crate) fn depth_png(frame: &ViewFrame) -> Vec<u8> {
    let Some((info, depth)) = frame.depth() else { return Vec::new() };
    let bytes: Vec<u8> = depth.iter().flat_map(|&depth_m| millimeters(depth_m).to_ne_bytes()).collect();
    let mut png = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Up);
    let (width, height) = (info.size.width, info.size.height);
    // The buffer has the size of the image, and writing to a vector cannot fail.
    match encoder.write_image(&bytes, width, height, ExtendedColorType::L16) {
        Ok(()) => png,
        Err(_) => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::{ImageSize, ScaleSource, Units};

    use super::*;
    use crate::frame::DepthInfo;

    #[test]
    fn the_png_holds_millimeters_and_zero_where_there_is_no_measurement() {
        let mut frame = ViewFrame::default();
        let size = ImageSize::new(2, 2);
        let info = DepthInfo {
            size,
            units: Units::Metre,
            scale_source: ScaleSource::Metric,
            view: [0.0, 0.0, 1.0, 1.0],
        };
        frame.set_depth(&[1.0, 2.5004, f32::NAN, 70.0], info);
        let image = image::load_from_memory(&depth_png(&frame)).unwrap();
        assert_eq!(image.as_luma16().unwrap().as_raw(), &[1000, 2500, 0, 0]);
    }
}
