//! Raw images without a header.

use std::io::{ErrorKind, Read};

use nunet_types::ImageSize;

use super::{RawFormat, Shot, Shots, read_growing, too_large};
use crate::error::{SourceError, SourceErrorKind};

/// Images of one size and format, one after the other.
pub(super) struct RawShots<R> {
    input: R,
    layout: RawFormat,
}

impl<R: Read + Send> RawShots<R> {
    pub(super) fn new(input: R, layout: RawFormat) -> Self {
        Self { input, layout }
    }
}

impl<R: Read + Send> Shots for RawShots<R> {
    fn next(&mut self, shot: &mut Shot) -> Result<bool, SourceError> {
        let RawFormat { size: ImageSize { width, height }, format } = self.layout;
        shot.size = self.layout.size;
        shot.format = Some(format);
        shot.row_stride = format.min_stride(width);
        let expected = format.byte_len(width, height, shot.row_stride);
        let cut_off = |message: String| SourceError::new(SourceErrorKind::CutOff, message);
        let read =
            read_growing(&mut self.input, &mut shot.bytes, expected).map_err(|error| match error.kind() {
                ErrorKind::OutOfMemory => too_large(shot.size),
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
