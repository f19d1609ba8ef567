//! JPEG and PNG files as frames.
//!
//! Images of all sources are rotated upright by their EXIF orientation. The camera that a source states
//! describes the stored image and is rotated with it (`orientation.rs`). The camera that the user states
//! describes the upright image, before the rotation that the user asks for (`rotation.rs`).

use std::borrow::Cow;
use std::io::{Cursor, Read as _};
use std::path::Path;

use image::error::LimitErrorKind;
use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};
use nunet_core::frame::MAX_SIDE_PX;
use nunet_core::plain_file;
use nunet_types::{ImageSize, counted};

use crate::convert::{self, Bayer, RawImageView, RawLayout};
use crate::error::{SourceError, SourceErrorKind};
use crate::{Frame, Rotation, jpeg};

/// Extensions of image files; cameras write them in capitals too.
pub const IMAGE_EXTENSIONS: [&str; 3] = ["jpg", "jpeg", "png"];
/// The largest image file, bytes.
const MAX_FILE_BYTES: u64 = 256 << 20;
/// The most memory that decoding one image may take, bytes: a 16-bit RGBA image of 48 megapixels and its RGB.
const MAX_DECODE_BYTES: u64 = 512 * 1024 * 1024;
/// The hint for images beyond the limits.
const SMALLER: &str = "make it smaller: networks use some hundred pixels a side";
/// The number of bytes that identify a file's format.
const MAGIC_BYTES: u64 = 32;

type Result<T> = std::result::Result<T, SourceError>;

/// What a file had that is not in the frame.
#[derive(Debug, Clone, Copy)]
pub struct DecodedFile {
    /// How the image was rotated.
    pub orientation: Orientation,
    /// The largest 16-bit value, without alpha; `None` for images of 8 bits.
    pub maximum_16_bit: Option<u16>,
}

/// Decodes one JPEG or PNG as RGB, rotated upright, into the frame's own memory; the file is kept in the
/// frame.
///
/// # Errors
/// No such file, neither JPEG nor PNG, damaged, incomplete, or larger than the limits.
pub fn decode(path: &Path, frame: &mut Frame) -> Result<DecodedFile> {
    let mut file = std::mem::take(&mut frame.file);
    file.clear();
    read(path, &mut file)?;
    frame.file = file;
    decode_file(frame)
}

/// Decodes the file in the frame.
///
/// # Errors
/// As [`decode`].
pub fn decode_file(frame: &mut Frame) -> Result<DecodedFile> {
    decode_file_or_mosaic(frame, None)
}

/// Decodes the file in the frame. One of a single channel is a mosaic with this pattern, and is not kept:
/// programs that read it would show it in gray.
///
/// # Errors
/// As [`decode`].
#[cfg(feature = "mcap")]
pub(crate) fn decode_mosaic(frame: &mut Frame, pattern: Bayer) -> Result<DecodedFile> {
    decode_file_or_mosaic(frame, Some(pattern))
}

fn decode_file_or_mosaic(frame: &mut Frame, mosaic: Option<Bayer>) -> Result<DecodedFile> {
    let mut file = std::mem::take(&mut frame.file);
    if let Some(complete) = jpeg::with_tables(&file) {
        file = complete;
    }
    let decoded = decode_bytes(&mut file, frame, mosaic);
    frame.file = file;
    // The rotated image differs from its file, which readers do not rotate.
    if !matches!(decoded, Ok(DecodedFile { orientation: Orientation::NoTransforms, .. })) {
        frame.file.clear();
        frame.is_turned = decoded.is_ok();
    }
    decoded
}

/// Decodes `file`, cuts off what follows the image in it, and adds a missing end-of-image marker.
fn decode_bytes(file: &mut Vec<u8>, frame: &mut Frame, mosaic: Option<Bayer>) -> Result<DecodedFile> {
    if format_of(file)? == ImageFormat::Jpeg {
        let end = jpeg::check(file).map_err(|error| {
            SourceError::bad_frame(error.to_string()).with_hint("copy or record it again")
        })?;
        file.truncate(end);
        if !file.ends_with(&jpeg::END) {
            file.extend(jpeg::END);
        }
    }
    let mut decoder = decoder_of(file)?;
    let orientation = decoder.orientation().map_err(undecodable)?;
    let size = ImageSize::from(decoder.dimensions());
    let as_it_is = decoder.color_type() == ColorType::Rgb8 && orientation == Orientation::NoTransforms;
    check_memory(&decoder, as_it_is)?;
    if as_it_is {
        decoder.read_image(frame.rgb_buffer(size)).map_err(undecodable)?;
        return Ok(DecodedFile { orientation, maximum_16_bit: None });
    }
    let mut image = DynamicImage::from_decoder(decoder).map_err(undecodable)?;
    let maximum_16_bit = maximum_16_bit(&image);
    if mosaic.is_some_and(|pattern| demosaic(&image, pattern, frame)) {
        file.clear();
        // Its camera describes it as it is stored.
        return Ok(DecodedFile { orientation: Orientation::NoTransforms, maximum_16_bit });
    }
    image.apply_orientation(orientation);
    let image = image.into_rgb8();
    frame.rgb_buffer(image.dimensions().into()).copy_from_slice(&image);
    Ok(DecodedFile { orientation, maximum_16_bit })
}

/// Fills the frame from a mosaic. Returns false if the image has several channels: it had its colors when it
/// was compressed.
fn demosaic(image: &DynamicImage, pattern: Bayer, frame: &mut Frame) -> bool {
    let (bytes, values): (usize, Cow<'_, [u8]>) = match image {
        DynamicImage::ImageLuma8(image) => (1, image.as_raw().into()),
        DynamicImage::ImageLuma16(image) => (2, image.iter().flat_map(|value| value.to_le_bytes()).collect()),
        _ => return false,
    };
    let size = ImageSize::new(image.width(), image.height());
    let layout = RawLayout::Mosaic { pattern, bytes };
    let row_stride = layout.min_stride(size.width);
    convert::fill(frame, RawImageView { layout, size, row_stride, bytes: &values })
}

fn maximum_16_bit(image: &DynamicImage) -> Option<u16> {
    match image {
        DynamicImage::ImageLuma16(image) => image.iter().copied().max(),
        DynamicImage::ImageLumaA16(image) => image.pixels().map(|pixel| pixel.0[0]).max(),
        DynamicImage::ImageRgb16(image) => image.iter().copied().max(),
        DynamicImage::ImageRgba16(image) => {
            image.pixels().flat_map(|pixel| [0, 1, 2].map(|at| pixel.0[at])).max()
        }
        _ => None,
    }
}

fn undecodable(error: ImageError) -> SourceError {
    SourceError::bad_frame(format!("the image cannot be decoded: {error}"))
}

/// The values of an image of one channel, unscaled: true depth, or labels.
#[derive(Debug)]
pub struct SingleChannelImage {
    /// Width and height, pixels.
    pub size: ImageSize,
    /// Rows from the top.
    pub values: Vec<u16>,
    /// 8 or 16 bits a number in the file.
    pub bits: u8,
}

impl SingleChannelImage {
    /// The same image, rotated.
    #[must_use]
    pub fn rotated(self, rotation: Rotation) -> Self {
        let values = rotation.values(self.size, &self.values);
        Self { size: rotation.size(self.size), values, bits: self.bits }
    }
}

/// Decodes a PNG of one channel.
///
/// # Errors
/// As [`decode`], and an image of several channels.
pub fn decode_numbers(path: &Path) -> Result<SingleChannelImage> {
    let mut file = Vec::new();
    read(path, &mut file)?;
    let decoder = decoder_of(&file)?;
    check_memory(&decoder, false)?;
    let size = ImageSize::from(decoder.dimensions());
    match DynamicImage::from_decoder(decoder).map_err(undecodable)? {
        DynamicImage::ImageLuma8(image) => Ok(SingleChannelImage {
            size,
            values: image.iter().map(|&value| value.into()).collect(),
            bits: 8,
        }),
        DynamicImage::ImageLuma16(image) => {
            Ok(SingleChannelImage { size, values: image.into_raw(), bits: 16 })
        }
        other => {
            let channels = other.color().channel_count();
            Err(SourceError::bad_frame(format!("the image has {channels} channels, expected one")))
        }
    }
}

fn read(path: &Path, bytes: &mut Vec<u8>) -> Result<()> {
    let failed = |error: std::io::Error| SourceError::bad_frame("it cannot be read").with_cause(error);
    let Some(mut file) = plain_file::open(path, MAX_FILE_BYTES + 1).map_err(failed)? else {
        return Err(SourceError::bad_frame("it is not a regular file").with_hint("save the image as a file"));
    };
    file.read_to_end(bytes).map_err(failed)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        let message = format!("the file is larger than {} MB", MAX_FILE_BYTES >> 20);
        return Err(SourceError::bad_frame(message).with_hint(SMALLER));
    }
    Ok(())
}

/// Checks the format of a file without decoding it. A file that is not a regular file passes, because reading
/// would empty a pipe.
///
/// # Errors
/// It cannot be read, or is neither JPEG nor PNG.
pub fn glance(path: &Path) -> Result<()> {
    let start = first_bytes(path).map_err(|error| {
        SourceError::new(SourceErrorKind::Unavailable, "it cannot be read").with_cause(error)
    })?;
    start.map_or(Ok(()), |start| format_of(&start).map(drop))
}

/// The first bytes of a file; `None` if it is not a regular file.
pub(crate) fn first_bytes(path: &Path) -> std::io::Result<Option<Vec<u8>>> {
    let Some(mut file) = plain_file::open(path, MAGIC_BYTES)? else { return Ok(None) };
    let mut start = Vec::new();
    file.read_to_end(&mut start)?;
    Ok(Some(start))
}

/// The format of a file, by its first bytes.
fn format_of(file: &[u8]) -> Result<ImageFormat> {
    let (what, hint): (Cow<'_, str>, _) = match image::guess_format(file) {
        Ok(format @ (ImageFormat::Jpeg | ImageFormat::Png)) => return Ok(format),
        Ok(other) => (format!("the image is {other:?}").into(), "save it as one of them"),
        Err(_) if file.is_empty() => ("the file is empty".into(), "copy or record it again"),
        Err(_) if let Some(bytes) = bytes_before_jpeg(file) => {
            (format!("the file has {} before a JPEG", counted(bytes, "byte")).into(), "remove them")
        }
        Err(_) => ("the file is not an image of a known format".into(), "save it as one of them"),
    };
    Err(SourceError::bad_frame(format!("{what}, expected JPEG or PNG")).with_hint(hint))
}

/// How many bytes are before the JPEG that does not begin with the file. Readers such as libjpeg refuse it
/// too.
fn bytes_before_jpeg(file: &[u8]) -> Option<usize> {
    let start = &file[..file.len().min(MAGIC_BYTES as usize)];
    start.windows(jpeg::START.len()).position(|bytes| bytes == jpeg::START).filter(|&bytes| bytes > 0)
}

fn decoder_of(file: &[u8]) -> Result<impl ImageDecoder + '_> {
    let mut reader = ImageReader::with_format(Cursor::new(file), format_of(file)?);
    reader.limits(limits());
    reader.into_decoder().map_err(|error| match error {
        ImageError::Limits(limit) if matches!(limit.kind(), LimitErrorKind::DimensionError) => {
            let size = claimed_size(file).map(|size| format!(" of {size} pixels"));
            let size = size.unwrap_or_default();
            SourceError::bad_frame(format!("an image{size}, expected at most {MAX_SIDE_PX} a side"))
                .with_hint(SMALLER)
        }
        error => undecodable(error),
    })
}

/// The size in the header of an image that the decoder refuses.
fn claimed_size(file: &[u8]) -> Option<ImageSize> {
    let side = |at: usize| Some(u32::from_be_bytes(file.get(at..at + 4)?.try_into().ok()?));
    match format_of(file).ok()? {
        // The first chunk is IHDR, which begins with both (PNG specification, 11.2.2).
        ImageFormat::Png => Some(ImageSize::new(side(16)?, side(20)?)),
        format => {
            let mut reader = ImageReader::with_format(Cursor::new(file), format);
            reader.no_limits();
            reader.into_dimensions().ok().map(ImageSize::from)
        }
    }
}

/// Checks the memory for decoding before it is allocated.
fn check_memory(decoder: &impl ImageDecoder, as_it_is: bool) -> Result<()> {
    let (width, height) = decoder.dimensions();
    let rgb = 3 * u64::from(width) * u64::from(height);
    let needed = if as_it_is { rgb } else { decoder.total_bytes().saturating_add(rgb) };
    if needed <= MAX_DECODE_BYTES {
        return Ok(());
    }
    let message = format!(
        "an image of {width}x{height} takes {} MB to decode, over the limit of {} MB",
        needed >> 20,
        MAX_DECODE_BYTES >> 20
    );
    Err(SourceError::bad_frame(message).with_hint(SMALLER))
}

fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE_PX);
    limits.max_image_height = Some(MAX_SIDE_PX);
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    limits
}

#[cfg(test)]
mod tests;
