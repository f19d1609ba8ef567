//! Images one after the other in a stream of bytes: Y4M, JPEG after JPEG, or raw ones.

use std::io::Read;

use nunet_types::{ImageSize, PixelFormat};

use crate::error::{SourceError, SourceErrorKind};
use crate::{Frame, Pixels, decode_file};

/// The format of raw images, which have no header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RawFormat {
    pub(super) size: ImageSize,
    /// How pixels are laid out; rows follow each other without padding.
    pub(super) format: PixelFormat,
}

/// An image from a stream, in memory that is returned and reused.
#[derive(Debug)]
pub(super) struct PipeImage {
    pub(super) bytes: Vec<u8>,
    pub(super) size: ImageSize,
    pub(super) row_stride: u32,
    /// `None` for a JPEG, whose size is not known yet.
    pub(super) format: Option<PixelFormat>,
    /// Nanoseconds of the stream's own clock, if it has one.
    pub(super) media_nanos: Option<i64>,
}

impl Default for PipeImage {
    fn default() -> Self {
        let size = ImageSize { width: 0, height: 0 };
        Self { bytes: Vec::new(), size, row_stride: 0, format: None, media_nanos: None }
    }
}

impl PipeImage {
    /// Puts the image into `frame`, and takes the memory of the image that was there before.
    ///
    /// # Errors
    /// A JPEG that cannot be decoded.
    pub(super) fn swap_into(&mut self, frame: &mut Frame) -> Result<(), SourceError> {
        frame.camera = None;
        frame.file.clear();
        if self.format.is_none() {
            std::mem::swap(&mut frame.file, &mut self.bytes);
            return decode_file(frame).map(drop);
        }
        frame.is_turned = false;
        (frame.size, frame.row_stride, frame.format) = (self.size, self.row_stride, self.format);
        let bytes = std::mem::take(&mut self.bytes);
        if let Pixels::Owned(before) = std::mem::replace(&mut frame.pixels, Pixels::Owned(bytes)) {
            self.bytes = before;
        }
        Ok(())
    }
}

/// Reads images one after the other.
pub(super) trait ImageReader: Send {
    /// Reads the next image into `image`; false at the end.
    fn next(&mut self, image: &mut PipeImage) -> Result<bool, SourceError>;
}

/// The system refuses to read the stream.
pub(super) fn unreadable(name: &str, error: std::io::Error) -> SourceError {
    SourceError::new(SourceErrorKind::Unavailable, format!("{name} cannot be read")).with_cause(error)
}

/// An image that does not fit into memory.
pub(super) fn too_large(size: ImageSize, name: &str) -> SourceError {
    let message = format!("there is not enough memory for an image of {size} from {name}");
    SourceError::new(SourceErrorKind::Unavailable, message)
        .with_hint("make it smaller: networks use some hundred pixels a side")
}

/// Memory for an image is allocated in steps of this size, as its bytes arrive: a large stated size alone
/// allocates nothing.
pub(super) const GROWTH_BYTES: usize = 16 << 20;

/// Reads up to `length` bytes into `bytes`, which grows as they arrive. Returns the number of bytes before
/// the end.
pub(super) fn read_growing(
    input: &mut impl Read,
    bytes: &mut Vec<u8>,
    length: usize,
) -> std::io::Result<usize> {
    bytes.truncate(length);
    let mut filled = 0;
    while filled < length {
        let end = bytes.len().max(length.min(filled + GROWTH_BYTES));
        let more = end - bytes.len();
        bytes.try_reserve(more).map_err(|_| std::io::Error::from(std::io::ErrorKind::OutOfMemory))?;
        bytes.resize(end, 0);
        let read = read_up_to(input, &mut bytes[filled..end])?;
        filled += read;
        if filled < end {
            break;
        }
    }
    Ok(filled)
}

/// Fills `bytes` from `input`. Returns the number of bytes before its end.
pub(super) fn read_up_to(input: &mut impl Read, bytes: &mut [u8]) -> std::io::Result<usize> {
    let mut filled = 0;
    while let Some(rest) = bytes.get_mut(filled..).filter(|rest| !rest.is_empty()) {
        match input.read(rest) {
            Ok(0) => break,
            Ok(count) => filled += count,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}
