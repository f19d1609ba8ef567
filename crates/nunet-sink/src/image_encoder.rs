//! Images as files. Files are kept unchanged, and raw images become JPEG or PNG. Images that were rotated
//! by EXIF become PNG: readers would not rotate the original, and a second JPEG compression would lose
//! detail.

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use nunet_core::preprocess::Preprocessor;
use nunet_mcap::EncodedImage;
use nunet_source::Frame;
use nunet_types::ImageSize;
use tracing::info;

/// The quality for raw images. Artifacts of lower qualities are visible; at this one, a file has a tenth of
/// the raw size.
const JPEG_QUALITY: u8 = 92;

/// Encodes images.
#[derive(Default)]
pub struct ImageEncoder {
    /// Raw images become PNG instead of JPEG.
    lossless: bool,
    to_rgb: Option<(ImageSize, Preprocessor)>,
    encoded: Vec<u8>,
    has_noted_jpeg: bool,
}

impl ImageEncoder {
    /// For recordings; raw images become PNG if `lossless` is set.
    #[must_use]
    pub fn new(lossless: bool) -> Self {
        Self { lossless, ..Self::default() }
    }

    /// For images that are sent and not replayed: JPEG is not mentioned in the log.
    #[must_use]
    pub fn for_live_topics() -> Self {
        Self { has_noted_jpeg: true, ..Self::default() }
    }

    /// The image of `frame` as a file.
    ///
    /// # Errors
    /// The image is shorter than its size needs, or cannot be encoded.
    pub fn encoded<'a>(&'a mut self, frame: &'a Frame) -> anyhow::Result<EncodedImage<'a>> {
        if !frame.file.is_empty() {
            let format = if frame.file.starts_with(&[0xff, 0xd8]) { "jpeg" } else { "png" };
            return Ok(EncodedImage { format, data: &frame.file });
        }
        let lossless = self.lossless || frame.is_turned;
        if !lossless && !std::mem::replace(&mut self.has_noted_jpeg, true) {
            info!(
                "raw images are recorded as JPEG (quality {JPEG_QUALITY}): a replay uses slightly different images; \
                 lossless recordings use PNG"
            );
        }
        let ImageSize { width, height } = frame.size;
        let (size, to_rgb) =
            self.to_rgb.get_or_insert_with(|| (frame.size, Preprocessor::new(width, height)));
        if *size != frame.size {
            (*size, *to_rgb) = (frame.size, Preprocessor::new(width, height));
        }
        let rgb = to_rgb.prepare(&frame.view()?).rgb;
        self.encoded.clear();
        if lossless {
            let encoder =
                PngEncoder::new_with_quality(&mut self.encoded, CompressionType::Fast, FilterType::Adaptive);
            encoder.write_image(rgb, width, height, ExtendedColorType::Rgb8)?;
            return Ok(EncodedImage { format: "png", data: &self.encoded });
        }
        let mut encoder = JpegEncoder::new_with_quality(&mut self.encoded, JPEG_QUALITY);
        encoder.encode(rgb, width, height, ExtendedColorType::Rgb8)?;
        Ok(EncodedImage { format: "jpeg", data: &self.encoded })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn raw_images_are_jpeg_by_default_and_exact_as_png() {
        let mut frame = Frame::default();
        let pixels: Vec<u8> = (0..12).map(|value| value * 20).collect();
        frame.rgb_buffer((2, 2).into()).copy_from_slice(&pixels);
        for (lossless, expected) in [(false, "jpeg"), (true, "png")] {
            let mut encoder = ImageEncoder::new(lossless);
            let encoded = encoder.encoded(&frame).unwrap();
            assert_eq!(encoded.format, expected);
            let decoded = image::load_from_memory(encoded.data).unwrap().into_rgb8().into_raw();
            assert_eq!(decoded == pixels, lossless, "{expected}");
        }
        frame.is_turned = true;
        let mut encoder = ImageEncoder::new(false);
        let turned = encoder.encoded(&frame).unwrap();
        assert_eq!(image::load_from_memory(turned.data).unwrap().into_rgb8().into_raw(), pixels);
        frame.file = vec![0xff, 0xd8];
        let encoder = &mut ImageEncoder::new(true);
        assert_eq!(encoder.encoded(&frame).unwrap().data, [0xff, 0xd8], "files stay as they came");
    }
}
