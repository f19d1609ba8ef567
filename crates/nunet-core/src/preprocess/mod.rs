//! Makes the network's image from a camera's image. An image that fits is used in place. Others are converted
//! and resized into an own buffer.

mod convert;
mod resize;
mod tensor;

pub use tensor::{ChannelOrder, TensorFormat, TensorLayout};

use nunet_types::{ImageSize, PixelRect};

use crate::frame::{ImageView, PixelFormat};
use resize::Resizer;

/// The network's image.
#[derive(Debug, Clone, Copy)]
pub struct Prepared<'a> {
    /// `[height][width][3]`, `u8`, RGB, rows top to bottom, at the network's size.
    pub rgb: &'a [u8],
    /// Bytes written for it; 0 if `rgb` is the camera's image itself.
    pub bytes_copied: u64,
}

/// Converts images of any size and format to RGB images of one size.
///
/// The address of its own image never changes, so that a binding to it can be kept.
#[derive(Debug)]
pub struct Preprocessor {
    width: u32,
    height: u32,
    /// The part of the camera's image that is taken; `None` for all of it.
    view: Option<PixelRect>,
    /// The result: RGB at the network's size.
    rgb: Vec<u8>,
    /// The intermediate image: the camera's image as RGB, or a gray one at the network's size.
    between: Vec<u8>,
    resize_rgb: Resizer<3>,
    resize_gray: Resizer<1>,
}

impl Preprocessor {
    /// For a network that takes images of `width` x `height` pixels, neither of them 0.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            view: None,
            rgb: vec![0; 3 * width as usize * height as usize],
            between: Vec::new(),
            resize_rgb: Resizer::to_size(width, height),
            resize_gray: Resizer::to_size(width, height),
        }
    }

    /// Takes only this part of the images from now on; `None` for all of them.
    pub fn set_view(&mut self, view: Option<PixelRect>) {
        self.view = view;
    }

    /// The network's image of `frame`.
    ///
    /// A packed RGB frame of the network's size is returned unchanged. Another aspect ratio is stretched:
    /// each axis is scaled by its own factor. Only the first frame of a size or format allocates.
    ///
    /// # Panics
    /// If the view is not within the frame.
    pub fn prepare<'a>(&'a mut self, frame: &ImageView<'a>) -> Prepared<'a> {
        if self.is_network_format(frame) {
            return Prepared { rgb: frame.bytes(), bytes_copied: 0 };
        }
        let bytes_between = match self.view {
            None => self.fill(frame),
            Some(view) => self.fill_from_part(frame, view),
        };
        Prepared { rgb: &self.rgb, bytes_copied: (bytes_between + self.rgb.len()) as u64 }
    }

    /// What [`Preprocessor::prepare`] returned for `frame`, if that was the last one.
    #[must_use]
    pub fn last<'a>(&'a self, frame: &ImageView<'a>) -> &'a [u8] {
        if self.is_network_format(frame) { frame.bytes() } else { &self.rgb }
    }

    fn is_network_format(&self, frame: &ImageView<'_>) -> bool {
        let fits = frame.size() == ImageSize::new(self.width, self.height);
        fits && self.view.is_none() && frame.format() == PixelFormat::Rgb8 && frame.is_packed()
    }

    /// As [`Self::fill`], from a part of the frame. The whole frame is converted first if pixels share color,
    /// because the part may begin at any pixel.
    fn fill_from_part(&mut self, frame: &ImageView<'_>, view: PixelRect) -> usize {
        const WITHIN: &str = "the view was chosen for this size";
        if !matches!(frame.format(), PixelFormat::Yuyv | PixelFormat::Nv12) {
            return self.fill(&frame.part(view).expect(WITHIN));
        }
        let ImageSize { width, height } = frame.size();
        let mut full = std::mem::take(&mut self.between);
        full.resize(3 * width as usize * height as usize, 0);
        convert::to_rgb(frame, &mut full);
        let rgb = ImageView::packed(&full, width, height, PixelFormat::Rgb8)
            .expect("the buffer was sized for a frame that was checked");
        self.fill(&rgb.part(view).expect(WITHIN)); // from RGB: needs no `between`
        let bytes = full.len();
        self.between = full;
        bytes
    }

    /// Fills `rgb`; returns the bytes written on the way.
    fn fill(&mut self, frame: &ImageView<'_>) -> usize {
        if frame.size() != ImageSize::new(self.width, self.height) {
            return self.resize(frame);
        }
        convert::to_rgb(frame, &mut self.rgb);
        0
    }

    /// Fills `rgb` from a frame of another size; returns the bytes written on the way.
    ///
    /// Formats with independent channels are resized first, because converting the smaller image is less
    /// work.
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
                self.resize_gray.resize(frame, &mut self.between);
                convert::spread_gray(&self.between, &mut self.rgb);
                self.between.len()
            }
            PixelFormat::Yuyv | PixelFormat::Nv12 => {
                let ImageSize { width, height } = frame.size();
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
