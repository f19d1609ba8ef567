//! From a camera's picture to the network's: as it lies where it fits, else in one pass into a buffer of our own.

mod convert;
mod resize;
mod tensor;

pub use tensor::{ChannelOrder, TensorFormat, TensorLayout};

use crate::frame::{ImageView, PixelFormat};
use resize::Resizer;

/// The network's picture.
#[derive(Debug, Clone, Copy)]
pub struct Prepared<'a> {
    /// `[height][width][3]`, `u8`, RGB, rows top to bottom, at the network's size.
    pub rgb: &'a [u8],
    /// Bytes written to get there; 0 where `rgb` is the camera's picture as it lies.
    pub bytes_copied: u64,
}

/// Makes pictures of one size out of pictures of any.
///
/// The picture that it makes lies at one address for its whole life, so that a binding to it can be kept.
#[derive(Debug)]
pub struct Preprocessor {
    width: u32,
    height: u32,
    /// What is handed out: RGB at the network's size.
    rgb: Vec<u8>,
    /// What lies between two steps: the camera's picture as RGB, or a grey one at the network's size.
    between: Vec<u8>,
    resize_rgb: Resizer<3>,
    resize_grey: Resizer<1>,
}

impl Preprocessor {
    /// For a network that takes pictures of `width` x `height` pixels, at least one of them.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            rgb: vec![0; 3 * width as usize * height as usize],
            between: Vec::new(),
            resize_rgb: Resizer::to_size(width, height),
            resize_grey: Resizer::to_size(width, height),
        }
    }

    /// The network's picture of `frame`.
    ///
    /// A packed RGB frame of the network's size is handed back as it lies. Another shape is stretched: the whole
    /// field of view is kept, each axis scaled by itself. The first frame of a size or format allocates, later ones
    /// do not.
    pub fn prepare<'a>(&'a mut self, frame: &ImageView<'a>) -> Prepared<'a> {
        if self.takes_as_it_lies(frame) {
            return Prepared { rgb: frame.bytes(), bytes_copied: 0 };
        }
        let bytes_between = if frame.size() == (self.width, self.height) {
            convert::to_rgb(frame, &mut self.rgb);
            0
        } else {
            self.resize(frame)
        };
        Prepared { rgb: &self.rgb, bytes_copied: (bytes_between + self.rgb.len()) as u64 }
    }

    /// What [`Preprocessor::prepare`] handed out for `frame`, when it was the last one.
    #[must_use]
    pub fn last<'a>(&'a self, frame: &ImageView<'a>) -> &'a [u8] {
        if self.takes_as_it_lies(frame) { frame.bytes() } else { &self.rgb }
    }

    fn takes_as_it_lies(&self, frame: &ImageView<'_>) -> bool {
        let fits = frame.size() == (self.width, self.height);
        fits && frame.format() == PixelFormat::Rgb8 && frame.is_packed()
    }

    /// Fills `rgb` from a frame of another size; returns the bytes written on the way.
    ///
    /// Channels that do not mix are resized first: reordering or spreading the smaller picture is less work.
    fn resize(&mut self, frame: &ImageView<'_>) -> usize {
        let network_pixels = self.width as usize * self.height as usize;
        match frame.format() {
            PixelFormat::Rgb8 => {
                self.resize_rgb.resize(frame, &mut self.rgb);
                0
            }
            PixelFormat::Bgr8 => {
                self.resize_rgb.resize(frame, &mut self.rgb);
                convert::swap_red_and_blue(&mut self.rgb);
                self.rgb.len()
            }
            PixelFormat::Mono8 => {
                self.between.resize(network_pixels, 0);
                self.resize_grey.resize(frame, &mut self.between);
                convert::spread_grey(&self.between, &mut self.rgb);
                self.between.len()
            }
            PixelFormat::Yuyv | PixelFormat::Nv12 => {
                let (width, height) = frame.size();
                self.between.resize(3 * width as usize * height as usize, 0);
                convert::to_rgb(frame, &mut self.between);
                let full = ImageView::packed(&self.between, width, height, PixelFormat::Rgb8)
                    .expect("the buffer was sized for a frame that was checked");
                self.resize_rgb.resize(&full, &mut self.rgb);
                self.between.len()
            }
        }
    }
}

#[cfg(test)]
mod tests;
