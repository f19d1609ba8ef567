//! Ways in to what reads other people's bytes, for `fuzz/` and the tests that share its functions. No part of the
//! interface: it may change with any release.

use std::io::Cursor;

use nunet_core::camera::Camera;
use nunet_core::frame::PixelFormat;
use nunet_ipc::FrameHeader;

use nunet_types::ImageSize;

use crate::source::{Frame, OpenOptions, Source, camera_in, decode_file, open_pipe};

/// A pipe that holds `input`: Y4M, or raw images of a size and format.
///
/// # Errors
/// No thread can be started.
pub fn pipe(input: Vec<u8>, layout: Option<((u32, u32), PixelFormat)>) -> anyhow::Result<Box<dyn Source>> {
    let (size, format) = layout.unzip();
    let size = size.map(|(width, height)| ImageSize { width, height });
    Ok(open_pipe(Cursor::new(input), OpenOptions { size, format, ..OpenOptions::default() })?)
}

/// Decodes the JPEG or PNG in `frame.file`.
///
/// # Errors
/// It is neither, or damaged, or too large.
pub fn decode(frame: &mut Frame) -> anyhow::Result<()> {
    decode_file(frame)?;
    Ok(())
}

/// The camera that a header describes, if it does.
///
/// # Errors
/// It describes one that cannot be.
pub fn camera(header: &FrameHeader) -> anyhow::Result<Option<Camera>> {
    Ok(camera_in(header)?)
}
