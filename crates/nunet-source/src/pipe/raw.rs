//! Raw images without a header.

use std::io::{ErrorKind, Read};

use nunet_types::ImageSize;

use super::{ImageReader, PipeImage, RawFormat, read_growing, too_large};
use crate::error::{SourceError, SourceErrorKind};

/// Images of one size and format, one after the other.
pub(super) struct RawReader<R> {
    input: R,
    layout: RawFormat,
}

impl<R: Read + Send> RawReader<R> {
    pub(super) fn new(input: R, layout: RawFormat) -> Self {
        Self { input, layout }
    }
}

impl<R: Read + Send> ImageReader for RawReader<R> {
    fn next(&mut self, image: &mut PipeImage) -> Result<bool, SourceError> {
        let RawFormat { size: ImageSize { width, height }, format } = self.layout;
        image.size = self.layout.size;
        image.format = Some(format);
        image.row_stride = format.min_stride(width);
        let expected = format.byte_len(width, height, image.row_stride);
        let cut_off = |message: String| SourceError::new(SourceErrorKind::CutOff, message);
        let read = read_growing(&mut self.input, &mut image.bytes, expected).map_err(|error| match error
            .kind()
        {
            ErrorKind::OutOfMemory => too_large(image.size),
            _ => cut_off("standard input cannot be read".to_owned()).with_cause(error),
        })?;
        match read {
            0 => Ok(false),
            read if read < expected => {
                Err(cut_off(format!("standard input ended after {read} of an image's {expected} bytes")))
            }
            _ => Ok(true),
        }
    }
}
