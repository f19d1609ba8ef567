//! From a camera's picture to the network's: as it lies where it fits, else in one pass into a buffer of our own.

mod tensor;

pub use tensor::{ChannelOrder, TensorFormat, TensorLayout};

use crate::frame::ImageView;

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
    rgb: Vec<u8>,
}

impl Preprocessor {
    /// For a network that takes pictures of `width` x `height` pixels.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            rgb: vec![0; 3 * width as usize * height as usize],
        }
    }

    /// The network's picture of `frame`.
    ///
    /// A packed RGB frame of the network's size is handed back as it lies. Another shape is stretched: the whole
    /// field of view is kept, each axis scaled by itself. The first frame of a size or format allocates, later ones
    /// do not.
    pub fn prepare<'a>(&'a mut self, frame: &ImageView<'a>) -> Prepared<'a> {
        todo!("{frame:?} {} {}", self.width, self.height)
    }
}
