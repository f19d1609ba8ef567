//! Raw images without a header.

use std::io::{ErrorKind, Read};

use nunet_types::ImageSize;

use super::image_reader::{ImageReader, PipeImage, RawFormat, read_growing, too_large, unreadable};
use crate::error::{SourceError, SourceErrorKind};

/// Images of one size and format, one after the other.
pub(super) struct RawReader<R> {
    input: R,
    layout: RawFormat,
    name: &'static str,
}

impl<R: Read + Send> RawReader<R> {
    pub(super) fn new(input: R, layout: RawFormat, name: &'static str) -> Self {
        Self { input, layout, name }
    }
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
