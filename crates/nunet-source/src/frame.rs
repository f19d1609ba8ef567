//! A captured frame on its way from the source to the pipeline.

use nunet_core::camera::Camera;
use nunet_core::frame::{FrameError, ImageView, PixelFormat};
use nunet_ipc::{Clock, FrameHeader};
use nunet_types::ImageSize;

/// When an image was captured.
#[derive(Debug, Clone, Copy)]
pub struct CaptureTime {
    /// Nanoseconds of `clock`.
    pub nanos: i64,
    /// The frame's own clock.
    pub clock: Clock,
    /// Nanoseconds since 1970-01-01 UTC, for ROS messages.
    pub unix_nanos: i64,
}

impl Default for CaptureTime {
    /// An unknown time.
    fn default() -> Self {
        Self { nanos: 0, clock: Clock::Monotonic, unix_nanos: 0 }
    }
}

/// An image's bytes: owned, or in shared memory of another process.
#[derive(Debug)]
pub enum Pixels {
    /// Memory that is reused for every image.
    Owned(Vec<u8>),
    /// A message in shared memory, valid until it is dropped.
    Shared(nunet_ipc::Message),
}

impl Default for Pixels {
    fn default() -> Self {
        Self::Owned(Vec::new())
    }
}

/// A captured frame.
#[derive(Debug, Default)]
pub struct Frame {
    /// The image.
    pub pixels: Pixels,
    /// The JPEG or PNG file that the image came in, for recordings; empty if it came raw.
    pub file: Vec<u8>,
    /// Whether the image came as a file that is not in `file`, because the image was rotated.
    pub is_turned: bool,
    /// Bytes that were copied to rotate the image; 0 if it was not rotated on request.
    pub bytes_copied: u64,
    /// Width and height, pixels.
    pub size: ImageSize,
    /// Bytes from row to row.
    pub row_stride: u32,
    /// How pixels are laid out; `None` in a frame that was never filled.
    pub format: Option<PixelFormat>,
    /// Counts the source's frames from 0, readable or not.
    pub sequence: u64,
    /// Frames since the last one that newer ones replaced before they left the source.
    pub superseded: u64,
    /// Time of capture.
    pub capture: CaptureTime,
    /// When the source delivered it, nanoseconds of `CLOCK_MONOTONIC`.
    pub ready_nanos: u64,
    /// The coordinate frame of the camera; empty if the source does not state it, or the user chose another.
    pub frame_id: String,
    /// The camera that took it, at the image's size, if the source knows it.
    pub camera: Option<Camera>,
    /// Roll and pitch of the robot's base that were used when the frame was recorded, radians; `None` if the
    /// source is not a recording that has them.
    pub roll_pitch_rad: Option<[f32; 2]>,
    /// Counts the stretches of a source that begins again: the first frame of a segment does not follow the
    /// last one of the segment before.
    pub segment: u64,
    /// Whether a gap in capture time is a gap in the scene. False for images from disk that are read as fast
    /// as they are processed: their capture time is when they were read.
    pub in_real_time: bool,
}

impl Frame {
    /// Releases memory of another process; owned memory is kept for the next image.
    pub fn release(&mut self) {
        if let Pixels::Shared(_) = self.pixels {
            self.pixels = Pixels::default();
        }
    }

    /// The image as the pipeline reads it.
    ///
    /// # Errors
    /// The source's size, stride and bytes contradict each other.
    pub fn view(&self) -> Result<ImageView<'_>, FrameError> {
        let ImageSize { width, height } = self.size;
        let format = self.format.unwrap_or(PixelFormat::Rgb8);
        ImageView::new(self.bytes(), width, height, self.row_stride, format)
    }

    /// Sets the sequence number, the capture time, and the coordinate frame if the source states one, in a
    /// header.
    pub fn identify(&self, header: &mut FrameHeader) {
        header.sequence = self.sequence;
        header.capture_nanos = self.capture.nanos;
        header.capture_unix_nanos = self.capture.unix_nanos;
        header.set_capture_clock(self.capture.clock);
        if !self.frame_id.is_empty() {
            header.set_frame_id(&self.frame_id);
        }
    }

    /// The owned buffer, `bytes` long. Its content is unspecified.
    pub fn buffer(&mut self, bytes: usize) -> &mut [u8] {
        let mut buffer = match std::mem::take(&mut self.pixels) {
            Pixels::Owned(buffer) => buffer,
            Pixels::Shared(_) => Vec::new(),
        };
        buffer.resize(bytes, 0);
        self.is_turned = false;
        self.pixels = Pixels::Owned(buffer);
        match &mut self.pixels {
            Pixels::Owned(buffer) => buffer,
            Pixels::Shared(_) => &mut [],
        }
    }

    /// Makes the frame a packed RGB image of `size`, and returns the buffer to fill.
    pub fn rgb_buffer(&mut self, size: ImageSize) -> &mut [u8] {
        let ImageSize { width, height } = size;
        self.size = size;
        self.format = Some(PixelFormat::Rgb8);
        self.row_stride = PixelFormat::Rgb8.min_stride(width);
        self.buffer(PixelFormat::Rgb8.byte_len(width, height, self.row_stride))
    }

    fn bytes(&self) -> &[u8] {
        match &self.pixels {
            Pixels::Owned(buffer) => buffer,
            Pixels::Shared(sample) => sample.bytes(),
        }
    }
}
