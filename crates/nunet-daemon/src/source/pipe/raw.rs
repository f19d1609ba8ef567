//! Raw pictures without a header.

use std::io::Read;

use anyhow::bail;

use super::{RawLayout, Shot, Shots, read_up_to};

/// Pictures of one size and format, one behind the other.
pub(super) struct RawShots<R> {
    input: R,
    layout: RawLayout,
}

impl<R: Read + Send> RawShots<R> {
    pub(super) fn new(input: R, layout: RawLayout) -> Self {
        Self { input, layout }
    }
}

impl<R: Read + Send> Shots for RawShots<R> {
    fn next(&mut self, shot: &mut Shot) -> anyhow::Result<bool> {
        let RawLayout { size: (width, height), format } = self.layout;
        shot.size = self.layout.size;
        shot.format = Some(format);
        shot.row_stride = format.min_stride(width);
        shot.bytes.resize(format.byte_len(width, height, shot.row_stride), 0);
        match read_up_to(&mut self.input, &mut shot.bytes)? {
            0 => Ok(false),
            read if read < shot.bytes.len() => {
                bail!("stdin ended after {read} of a picture's {} bytes", shot.bytes.len())
            }
            _ => Ok(true),
        }
    }
}
