//! A recorded image, independent of the type of its message.

use nunet_types::{ImageSize, MAX_FRAME_ID, MAX_SIDE_PX};

use crate::compressed_depth;
use crate::encoding::ImageEncoding;
use crate::image_error::ImageError;
use crate::messages::{RosCompressedImage, RosImage};

const JPEG: [u8; 3] = [0xff, 0xd8, 0xff];
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// How the images of a topic are interpreted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Color or gray images.
    Color,
    /// Infrared images, in which `16UC1` is brightness.
    Infrared,
    /// Depth.
    Depth,
}

/// A recorded image. Its memory is reused for the next one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RecordedImage {
    /// The file, or rows from the top.
    pub data: Vec<u8>,
    /// How the bytes are laid out; `None` before the first image.
    pub encoding: Option<ImageEncoding>,
    /// Pixels; 0 for files, which state it themselves.
    pub width: u32,
    /// Pixels; 0 for files.
    pub height: u32,
    /// Bytes from row to row; 0 for files.
    pub row_stride: u32,
    /// Time of capture as the message states it, nanoseconds since 1970; 0 if it states none.
    pub stamp_nanos: i64,
    /// Time of recording, nanoseconds of the recording's clock.
    pub log_nanos: u64,
    /// The coordinate frame of the camera, at most [`MAX_FRAME_ID`] bytes.
    pub frame_id: String,
    /// Whether `frame_id` is not the name in the message, which is longer or not UTF-8.
    pub is_frame_id_changed: bool,
    /// Roll and pitch of the robot's base that were used for the image when it was recorded, radians; `None`
    /// if the recording has none.
    pub roll_pitch_rad: Option<[f32; 2]>,
}

/// A raw image of a message.
pub(crate) struct Raw<'a> {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) step: u32,
    pub(crate) encoding: &'a str,
    pub(crate) data: &'a [u8],
    pub(crate) big_endian: bool,
}

impl RecordedImage {
    /// Time of capture, nanoseconds since 1970, 0 or more: as the message states it, else the time of
    /// recording. A time before 1970, which ROS can state, counts as none.
    #[must_use]
    pub fn unix_nanos(&self) -> i64 {
        if self.stamp_nanos <= 0 {
            i64::try_from(self.log_nanos).unwrap_or(i64::MAX)
        } else {
            self.stamp_nanos
        }
    }

    /// Meters of a depth image, rows without padding, NaN = none; empty for any other image.
    #[must_use]
    pub fn depth_m(&self) -> Vec<f32> {
        let rows = self.data.chunks_exact(self.row_stride.max(1) as usize);
        let width = self.width as usize;
        // Infinity is none, too: in ROS it means too far to be measured.
        let known = |meters: f32| if meters > 0.0 && meters.is_finite() { meters } else { f32::NAN };
        match self.encoding {
            Some(ImageEncoding::DepthMeters) => rows
                .flat_map(|row| {
                    row.as_chunks().0.iter().take(width).map(|&bytes| known(f32::from_le_bytes(bytes)))
                })
                .collect(),
            Some(ImageEncoding::DepthMillimeters) => rows
                .flat_map(|row| {
                    let values = row.as_chunks().0.iter().take(width);
                    values.map(|&bytes| known(f32::from(u16::from_le_bytes(bytes)) / 1000.0))
                })
                .collect(),
            _ => Vec::new(),
        }
    }

    pub(crate) fn set_ros_image(&mut self, image: &RosImage<'_>, purpose: Purpose) -> Result<(), ImageError> {
        self.set_header(image.header.stamp.unix_nanos(), &image.header.frame_id);
        let RosImage { width, height, step, .. } = *image;
        let big_endian = image.is_bigendian != 0;
        self.set_raw(
            &Raw { width, height, step, encoding: &image.encoding, data: image.data, big_endian },
            purpose,
        )
    }

    pub(crate) fn set_ros_compressed(
        &mut self,
        image: &RosCompressedImage<'_>,
        purpose: Purpose,
    ) -> Result<(), ImageError> {
        self.set_header(image.header.stamp.unix_nanos(), &image.header.frame_id);
        self.set_file(image.data, &image.format, purpose)
    }

    pub(crate) fn set_header(&mut self, stamp_nanos: i64, frame_id: &str) {
        self.stamp_nanos = stamp_nanos;
        // Cut here, because every output copies it with every frame.
        let kept = &frame_id[..frame_id.floor_char_boundary(MAX_FRAME_ID)];
        self.is_frame_id_changed = kept != frame_id || kept.contains(char::REPLACEMENT_CHARACTER);
        kept.clone_into(&mut self.frame_id);
    }

    /// A compressed image: JPEG and PNG are recognized by their first bytes, since formats are written in
    /// many ways ("rgb8; jpeg compressed bgr8"). The encoding before the semicolon is that of the image
    /// before compression.
    pub(crate) fn set_file(&mut self, data: &[u8], format: &str, purpose: Purpose) -> Result<(), ImageError> {
        let original = format.split_once(';').and_then(|(name, _)| ImageEncoding::named(name.trim()));
        let is_transport = compressed_depth::is_named(format);
        // `16UC1` is brightness then, as in raw images.
        let is_brightness = original == Some(ImageEncoding::DepthMillimeters) && purpose == Purpose::Infrared;
        let is_depth = is_transport || (original.is_some_and(ImageEncoding::is_depth) && !is_brightness);
        if is_depth && purpose != Purpose::Depth {
            return Err(ImageError::Depth { format: format.to_owned() });
        }
        if is_transport {
            return self.set_depth(compressed_depth::decode(data, format)?);
        }
        if !data.starts_with(&JPEG) && !data.starts_with(PNG) {
            return Err(
                format!("its {} bytes, as `{format:.60}`, are neither JPEG nor PNG", data.len()).into()
            );
        }
        if purpose == Purpose::Depth {
            if original == Some(ImageEncoding::DepthMeters) {
                return Err(
                    format!("`{format:.60}` has no unit: JPEG and PNG have whole numbers only").into()
                );
            }
            return self.set_depth(compressed_depth::decode_png(data)?);
        }
        self.encoding = Some(match original {
            Some(ImageEncoding::Bayer8(pattern) | ImageEncoding::Bayer16(pattern)) => {
                ImageEncoding::BayerFile(pattern)
            }
            _ => ImageEncoding::File,
        });
        (self.width, self.height, self.row_stride) = (0, 0, 0);
        data.clone_into(&mut self.data);
        Ok(())
    }

    fn set_depth(&mut self, depth: compressed_depth::Decoded) -> Result<(), ImageError> {
        let ImageSize { width, height } = depth.size;
        self.encoding = Some(depth.encoding);
        let row = depth.encoding.row_bytes(width);
        (self.width, self.height) = (width, height);
        self.row_stride =
            u32::try_from(row).map_err(|_| format!("{width}x{height} is no size of a depth image"))?;
        self.data = depth.data;
        Ok(())
    }

    pub(crate) fn set_raw(&mut self, raw: &Raw<'_>, purpose: Purpose) -> Result<(), ImageError> {
        let (width, height, step) = (raw.width, raw.height, raw.step);
        let sides = 1..=MAX_SIDE_PX;
        // First, because an empty message has no encoding either, which would stand for the whole topic.
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(
                format!("the size is {width}x{height}, expected sides of 1 to {MAX_SIDE_PX} pixels").into()
            );
        }
        let named = ImageEncoding::named(raw.encoding)
            .ok_or_else(|| ImageError::Encoding { encoding: raw.encoding.to_owned() })?;
        let encoding = match (named, purpose) {
            (ImageEncoding::DepthMillimeters, Purpose::Infrared) => ImageEncoding::Mono16,
            (ImageEncoding::Mono16, Purpose::Depth) => ImageEncoding::DepthMillimeters,
            (encoding, _) => encoding,
        };
        let (row, needed) = (encoding.row_bytes(width), encoding.image_bytes(height, step));
        if u64::from(step) < row || (raw.data.len() as u64) < needed {
            return Err(format!(
                "{width}x{height} `{:.60}` with {step} bytes a row needs rows of {row} bytes and {needed} in all, got {}",
                raw.encoding,
                raw.data.len()
            ).into());
        }
        self.encoding = Some(encoding);
        (self.width, self.height, self.row_stride) = (width, height, step);
        self.data.clear();
        self.data.extend_from_slice(raw.data.get(..needed as usize).unwrap_or_default());
        let number = encoding.number_bytes();
        if raw.big_endian && number > 1 {
            // Row by row: with an odd stride, not every row begins at a multiple of a number's bytes.
            for row in self.data.chunks_mut(step as usize) {
                row.chunks_exact_mut(number).for_each(<[u8]>::reverse);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::BayerPattern;

    fn set_as(
        purpose: Purpose,
        encoding: &str,
        size: impl Into<ImageSize>,
        step: u32,
        data: &[u8],
    ) -> Result<RecordedImage, String> {
        let (mut image, size) = (RecordedImage::default(), size.into());
        let raw = Raw { width: size.width, height: size.height, step, encoding, data, big_endian: false };
        image.set_raw(&raw, purpose).map(|()| image).map_err(|error| error.to_string())
    }

    fn set(
        encoding: &str,
        size: impl Into<ImageSize>,
        step: u32,
        data: &[u8],
    ) -> Result<RecordedImage, String> {
        set_as(Purpose::Color, encoding, size, step, data)
    }

    #[test]
    fn depth_of_every_encoding_becomes_meters_and_invalid_depth_nan() {
        let millimeters = set("16UC1", (2, 1), 6, &[0xd0, 0x07, 0, 0, 9, 9]).unwrap().depth_m();
        assert_eq!(millimeters[0], 2.0);
        assert!(millimeters[1].is_nan());
        let bytes: Vec<u8> =
            [1.5_f32, f32::NAN, 0.0, f32::INFINITY].iter().flat_map(|meters| meters.to_le_bytes()).collect();
        let meters = set("32FC1", (4, 1), 16, &bytes).unwrap().depth_m();
        assert!(meters[0] == 1.5 && meters[1..].iter().all(|meters| meters.is_nan()), "{meters:?}");
        assert!(set("mono8", (1, 1), 1, &[1]).unwrap().depth_m().is_empty());
    }

    #[test]
    fn sixteen_bits_are_brightness_or_depth_by_what_the_topic_is_read_as() {
        let encoding = |purpose, name| set_as(purpose, name, (1, 1), 2, &[1, 2]).unwrap().encoding.unwrap();
        assert_eq!(encoding(Purpose::Color, "mono16"), ImageEncoding::Mono16);
        assert_eq!(encoding(Purpose::Infrared, "16UC1"), ImageEncoding::Mono16);
        assert_eq!(encoding(Purpose::Depth, "mono16"), ImageEncoding::DepthMillimeters);
        assert_eq!(encoding(Purpose::Color, "16UC1"), ImageEncoding::DepthMillimeters);
    }

    #[test]
    fn a_size_that_no_image_has_is_refused_whatever_its_bytes() {
        for (size, step) in
            [((0, 0), 0), ((0, 2), 3), ((2, 0), 6), ((40_000, 1), 120_000), ((1, u32::MAX), 3)]
        {
            let error = set("rgb8", size, step, &[0; 120_000]).unwrap_err();
            let (width, height) = size;
            let expected = format!("the size is {width}x{height}, expected sides of 1 to 32768 pixels");
            assert_eq!(error, expected);
        }
    }

    #[test]
    fn big_endian_numbers_are_swapped() {
        let mut image = RecordedImage::default();
        let raw =
            Raw { width: 2, height: 1, step: 4, encoding: "16UC1", data: &[7, 0xd0, 0, 1], big_endian: true };
        image.set_raw(&raw, Purpose::Depth).unwrap();
        assert_eq!(image.depth_m(), [2.0, 0.001]);
        let padded = Raw { width: 1, height: 2, step: 3, data: &[7, 0xd0, 9, 0, 1, 9], ..raw };
        image.set_raw(&padded, Purpose::Depth).unwrap();
        assert_eq!(image.depth_m(), [2.0, 0.001], "rows of an odd number of bytes");
    }

    #[test]
    fn planes_of_color_of_an_odd_height_round_up() {
        let image = set("nv12", (2, 3), 2, &[1, 2, 3, 4, 5, 6, 128, 127, 126, 125, 99]).unwrap();
        assert_eq!(image.data, [1, 2, 3, 4, 5, 6, 128, 127, 126, 125]);
        let error = set("nv12", (2, 3), 2, &[0; 9]).unwrap_err();
        assert_eq!(error, "2x3 `nv12` with 2 bytes a row needs rows of 2 bytes and 10 in all, got 9");
        assert!(set("i420", (2, 3), 2, &[0; 9]).is_err() && set("yv12", (2, 3), 2, &[0; 10]).is_ok());
    }

    #[test]
    fn a_size_that_contradicts_its_data_is_an_error_with_both() {
        let error = set("rgb8", (4, 2), 12, &[0; 23]).unwrap_err();
        assert_eq!(error, "4x2 `rgb8` with 12 bytes a row needs rows of 12 bytes and 24 in all, got 23");
        for (size, step) in [((0, 2), 12), ((5, 2), 12), ((u32::MAX, u32::MAX), u32::MAX)] {
            set("rgb8", size, step, &[0; 24]).unwrap_err();
        }
    }

    #[test]
    fn an_unknown_encoding_is_named_with_those_that_are_read() {
        let error = set("nv24", (2, 2), 2, &[0; 4]).unwrap_err();
        assert_eq!(error, format!("encoding `nv24` cannot be read, expected {}", crate::encoding::READABLE));
    }

    #[test]
    fn a_stamp_before_1970_is_none() {
        let unix_nanos = |stamp_nanos| {
            RecordedImage { stamp_nanos, log_nanos: 7, ..RecordedImage::default() }.unix_nanos()
        };
        assert_eq!([i64::MIN, -1, 0, 1].map(unix_nanos), [7, 7, 7, 1]);
    }

    #[test]
    fn compressed_images_are_recognized_by_their_bytes() {
        let mut image = RecordedImage::default();
        let jpeg = [0xff, 0xd8, 0xff, 0xe0];
        image.set_file(&jpeg, "rgb8; jpeg compressed bgr8", Purpose::Color).unwrap();
        assert_eq!(image.encoding, Some(ImageEncoding::File));
        let error = image.set_file(b"RIFF....WEBP", "webp", Purpose::Color).unwrap_err().to_string();
        assert_eq!(error, "its 12 bytes, as `webp`, are neither JPEG nor PNG");
        assert!(
            image.set_file(b"", "jpeg", Purpose::Color).unwrap_err().to_string().starts_with("its 0 bytes")
        );
        let error =
            image.set_file(&jpeg, "16UC1; compressedDepth png", Purpose::Color).unwrap_err().to_string();
        assert_eq!(error, "`16UC1; compressedDepth png` is depth, not an image");
    }
    #[test]
    fn depth_in_a_png_is_depth_by_the_encoding_before_its_format() {
        let mut png = std::io::Cursor::new(Vec::new());
        let values = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(2, 1, vec![0, 1500]).unwrap();
        values.write_to(&mut png, image::ImageFormat::Png).unwrap();
        let png = png.into_inner();
        let mut image = RecordedImage::default();
        for format in ["16UC1; png compressed ", "32FC1; png compressed ", "32FC1; tiff compressed"] {
            let error = image.set_file(&png, format, Purpose::Color).unwrap_err().to_string();
            assert_eq!(error, format!("`{format}` is depth, not an image"));
        }
        for format in ["16UC1; png compressed ", "mono16; png compressed ", "png"] {
            image.set_file(&png, format, Purpose::Depth).unwrap();
            let depth_m = image.depth_m();
            assert!(depth_m[0].is_nan() && depth_m[1] == 1.5, "{format}: {depth_m:?}");
        }
        // Its inverse depth is that of infinity.
        let message = [&[0; 4][..], &100_f32.to_le_bytes(), &1500_f32.to_le_bytes(), &png].concat();
        image.set_file(&message, "32FC1; compressedDepth png", Purpose::Depth).unwrap();
        assert!(image.depth_m().iter().all(|meters| meters.is_nan()), "{:?}", image.depth_m());
        let error = image.set_file(&png, "32FC1; png compressed ", Purpose::Depth).unwrap_err().to_string();
        assert!(error.contains("has no unit"), "{error}");
        image.set_file(&png, "16UC1; png compressed ", Purpose::Infrared).unwrap();
        assert_eq!(image.encoding, Some(ImageEncoding::File), "it is brightness");
        image.set_file(&png, "mono16; png compressed ", Purpose::Color).unwrap();
        assert_eq!(image.encoding, Some(ImageEncoding::File));
    }

    #[test]
    fn the_pattern_of_a_mosaic_in_a_file_is_before_its_format() {
        let mut image = RecordedImage::default();
        let jpeg = [0xff, 0xd8, 0xff, 0xe0];
        for (format, pattern) in [
            ("bayer_rggb8; png compressed ", BayerPattern::Rggb),
            ("bayer_gbrg16; png compressed bayer_gbrg16", BayerPattern::Gbrg),
            ("bayer_grbg8; jpeg compressed", BayerPattern::Grbg),
        ] {
            image.set_file(&jpeg, format, Purpose::Color).unwrap();
            assert_eq!(image.encoding, Some(ImageEncoding::BayerFile(pattern)), "{format}");
        }
    }
}
