//! Depth of the ROS package `compressed_depth_image_transport`, and depth in plain PNG files.
//!
//! A message is a header of twelve bytes (format, then two quantization parameters as `f32`) and a PNG file
//! of 16 bits or RVL data. Depth in meters is stored as its inverse: `depth = a / (value - b)`, 0 = none.
//! Source: `compressed_depth_image_transport/src/codec.cpp` and `rvl_codec.cpp`; RVL is A. D. Wilson, *Fast
//! lossless depth image compression*, 2017.

use std::io::Cursor;

use image::{DynamicImage, ImageFormat, ImageReader, Limits};
use nunet_types::ImageSize;

use crate::encoding::ImageEncoding;

const HEADER_BYTES: usize = 12;
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
const MAX_PIXELS: u64 = 64 << 20;
const MAX_SIDE_PX: u32 = 32_768;

/// A decoded depth image; rows have no padding.
#[derive(Debug)]
pub(crate) struct Decoded {
    pub(crate) size: ImageSize,
    pub(crate) encoding: ImageEncoding,
    pub(crate) data: Vec<u8>,
}

/// Whether a `CompressedImage`'s format names this transport.
pub(crate) fn is_named(format: &str) -> bool {
    format.to_ascii_lowercase().contains("compresseddepth")
}

/// Decodes a message of the transport.
pub(crate) fn decode(data: &[u8], format: &str) -> Result<Decoded, String> {
    let (header, body) = data.split_at_checked(HEADER_BYTES).ok_or_else(|| {
        format!("compressedDepth has {} bytes, expected a header of {HEADER_BYTES}", data.len())
    })?;
    let parameter = |place: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| header[place + byte]));
    let (size, values) = if body.starts_with(PNG) { png(body)? } else { rvl(body)? };
    if !format.trim_start().to_ascii_uppercase().starts_with("32FC1") {
        return Ok(millimeters(size, &values));
    }
    let (a, b) = (parameter(4), parameter(8));
    let meters = |&value: &u16| if value == 0 { f32::NAN } else { a / (f32::from(value) - b) };
    let data = values.iter().map(meters).flat_map(f32::to_le_bytes).collect();
    Ok(Decoded { size, encoding: ImageEncoding::DepthMeters, data })
}

/// Decodes a PNG file of one channel with 16 bits: millimeters.
pub(crate) fn decode_png(data: &[u8]) -> Result<Decoded, String> {
    png(data).map(|(size, values)| millimeters(size, &values))
}

fn millimeters(size: ImageSize, values: &[u16]) -> Decoded {
    let data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    Decoded { size, encoding: ImageEncoding::DepthMillimeters, data }
}

type Values = (ImageSize, Vec<u16>);

fn png(file: &[u8]) -> Result<Values, String> {
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE_PX), Some(MAX_SIDE_PX));
    let mut reader = ImageReader::with_format(Cursor::new(file), ImageFormat::Png);
    reader.limits(limits);
    match reader.decode().map_err(|error| format!("its PNG cannot be decoded: {error:.200}"))? {
        DynamicImage::ImageLuma16(image) => Ok((image.dimensions().into(), image.into_raw())),
        other => Err(format!("its PNG is {:?}, expected one channel of 16 bits", other.color())),
    }
}

fn rvl(body: &[u8]) -> Result<Values, String> {
    let word = |place: usize| Some(u32::from_le_bytes(body.get(place..place + 4)?.try_into().ok()?));
    let (Some(width), Some(height)) = (word(0), word(4)) else {
        return Err("its data are neither PNG nor RVL".to_owned());
    };
    let pixels = u64::from(width) * u64::from(height);
    // A run of zeros can have any length, so the number of bytes does not limit the size; the sides do.
    if pixels == 0 || pixels > MAX_PIXELS || width > MAX_SIDE_PX || height > MAX_SIDE_PX {
        return Err(format!("its data are neither PNG nor RVL of a possible size ({width}x{height})"));
    }
    let mut nibbles = Nibbles { bytes: body.get(8..).unwrap_or_default(), word: 0, left: 0 };
    let values = nibbles.image(pixels as usize).ok_or("its RVL data end early or hold too many pixels")?;
    Ok((ImageSize { width, height }, values))
}

/// Numbers of variable length in nibbles: three bits each; the fourth bit is set if more nibbles follow.
/// Words of 32 bits are little-endian, their nibbles from the highest to the lowest.
struct Nibbles<'a> {
    bytes: &'a [u8],
    word: u32,
    left: u32,
}

impl Nibbles<'_> {
    fn number(&mut self) -> Option<u32> {
        let (mut value, mut shift) = (0, 0);
        loop {
            if self.left == 0 {
                let (word, rest) = self.bytes.split_at_checked(4)?;
                (self.word, self.bytes, self.left) = (u32::from_le_bytes(word.try_into().ok()?), rest, 8);
            }
            let nibble = self.word >> 28;
            self.word <<= 4;
            self.left -= 1;
            value |= (nibble & 7).checked_shl(shift)?;
            if nibble & 8 == 0 {
                return Some(value);
            }
            shift += 3;
        }
    }

    /// Alternating runs of zeros and of differences to the previous pixel.
    fn image(&mut self, pixels: usize) -> Option<Vec<u16>> {
        let (mut values, mut before) = (Vec::new(), 0_i32);
        while values.len() < pixels {
            let zeros = self.number()? as usize;
            let filled = values.len().checked_add(zeros).filter(|&filled| filled <= pixels)?;
            values.resize(filled, 0);
            let others = self.number()? as usize;
            if others > pixels - values.len() || (zeros == 0 && others == 0) {
                return None;
            }
            for _ in 0..others {
                let zigzag = self.number()?;
                before = before.wrapping_add((zigzag >> 1) as i32 ^ -((zigzag & 1) as i32));
                values.push(before as u16);
            }
        }
        Some(values)
    }
}

#[cfg(test)]
mod tests {
    use image::{ImageBuffer, Luma};

    use super::*;

    fn png_of(values: &[u16]) -> Vec<u8> {
        let image: ImageBuffer<Luma<u16>, _> =
            ImageBuffer::from_raw(values.len() as u32, 1, values.to_vec()).unwrap();
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, ImageFormat::Png).unwrap();
        file.into_inner()
    }

    fn message(a: f32, b: f32, body: &[u8]) -> Vec<u8> {
        [&[0; 4][..], &a.to_le_bytes(), &b.to_le_bytes(), body].concat()
    }

    #[test]
    fn millimeters_are_in_the_png_as_they_are() {
        let decoded = decode(&message(0.0, 0.0, &png_of(&[0, 1500])), "16UC1; compressedDepth png").unwrap();
        assert_eq!((decoded.size, decoded.encoding), ((2, 1).into(), ImageEncoding::DepthMillimeters));
        assert_eq!(decoded.data, [0, 0, 0xdc, 5]);
    }

    #[test]
    fn meters_are_quantized_inverse_depth() {
        let decoded = decode(&message(100.0, -50.0, &png_of(&[0, 150])), "32FC1; compressedDepth").unwrap();
        let meters: Vec<f32> =
            decoded.data.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
        assert!(meters[0].is_nan() && meters[1] == 0.5, "{meters:?}");
    }

    /// By hand: two zeros, three others (+1000, -1, 0), one zero, none other.
    #[test]
    fn rvl_is_runs_of_zeros_and_of_differences() {
        let mut nibbles = Vec::new();
        for number in [2_u32, 3, 2000, 1, 0, 1, 0] {
            let mut rest = number;
            loop {
                nibbles.push((rest & 7) | if rest > 7 { 8 } else { 0 });
                rest >>= 3;
                if rest == 0 {
                    break;
                }
            }
        }
        nibbles.resize(nibbles.len().next_multiple_of(8), 0);
        let words = nibbles.chunks(8).map(|word| word.iter().fold(0_u32, |word, nibble| word << 4 | nibble));
        let stream: Vec<u8> = words.flat_map(u32::to_le_bytes).collect();
        let body = [&6_u32.to_le_bytes()[..], &1_u32.to_le_bytes(), &stream].concat();
        let decoded = decode(&message(0.0, 0.0, &body), "16UC1; compressedDepth rvl").unwrap();
        let values: Vec<u16> =
            decoded.data.as_chunks().0.iter().map(|&bytes| u16::from_le_bytes(bytes)).collect();
        assert_eq!(values, [0, 0, 1000, 999, 999, 0]);
        for cut in 0..body.len() {
            assert!(decode(&message(0.0, 0.0, &body[..cut]), "16UC1; compressedDepth rvl").is_err(), "{cut}");
        }
    }
}
