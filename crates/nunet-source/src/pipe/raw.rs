//! Raw images without a header.

use std::io::{Chain, Cursor, ErrorKind, Read};

use nunet_types::ImageSize;

use super::image_reader::{
    ImageReader, PipeImage, RawFormat, read_growing, read_up_to, too_large, unreadable,
};
use super::y4m;
use crate::error::{SourceError, SourceErrorKind};

/// Images of one size and format, one after the other.
pub(super) struct RawReader<R> {
    input: Chain<Cursor<Vec<u8>>, R>,
    layout: RawFormat,
    name: &'static str,
}

impl<R: Read + Send> RawReader<R> {
    /// Looks at the first bytes.
    ///
    /// # Errors
    /// They are those of Y4M, whose header and planes are no pixels of the stated format.
    pub(super) fn open(mut input: R, layout: RawFormat, name: &'static str) -> Result<Self, SourceError> {
        let start = first_bytes(&mut input).map_err(|error| unreadable(name, error))?;
        if start == y4m::MAGIC {
            let message = format!("{name} is Y4M, and no raw images");
            return Err(SourceError::new(SourceErrorKind::Unavailable, message)
                .with_hint("omit size and format: Y4M states both"));
        }
        Ok(Self { input: Cursor::new(start).chain(input), layout, name })
    }
}

/// Reads as long as the bytes are those of Y4M: more would wait for the second one of two small images.
fn first_bytes(input: &mut impl Read) -> std::io::Result<Vec<u8>> {
    let mut start = Vec::new();
    for &expected in y4m::MAGIC {
        let mut byte = [0];
        if read_up_to(input, &mut byte)? == 0 {
            break;
        }
        start.extend(byte);
        if byte != [expected] {
            break;
        }
    }
    Ok(start)
}

impl<R: Read + Send> ImageReader for RawReader<R> {
    fn next(&mut self, image: &mut PipeImage) -> Result<bool, SourceError> {
        let RawFormat { size: ImageSize { width, height }, format } = self.layout;
        image.size = self.layout.size;
        image.format = Some(format);
        image.row_stride = format.min_stride(width);
        let expected = format.byte_len(width, height, image.row_stride);
        let read = read_growing(&mut self.input, &mut image.bytes, expected).map_err(|error| {
            if error.kind() == ErrorKind::OutOfMemory {
                too_large(image.size, self.name)
            } else {
                unreadable(self.name, error)
            }
        })?;
        match read {
            0 => Ok(false),
            read if read < expected => {
                let message = format!("{} ended after {read} of an image's {expected} bytes", self.name);
                Err(SourceError::new(SourceErrorKind::CutOff, message))
            }
            _ => Ok(true),
        }
    }
}
