//! The input of foreign networks: RGB bytes to normalised `f32`.

/// The order of a tensor's dimensions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TensorLayout {
    /// `[1, 3, H, W]`
    Nchw,
    /// `[1, H, W, 3]`
    Nhwc,
}

/// The order of a tensor's channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ChannelOrder {
    /// Red first.
    Rgb,
    /// Blue first.
    Bgr,
}

/// How a foreign network wants its picture: `(byte * scale - mean) / std` for each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TensorFormat {
    /// The order of the dimensions.
    pub layout: TensorLayout,
    /// The order of the channels.
    pub channels: ChannelOrder,
    /// Multiplies the byte, 1/255 for 0 to 1.
    pub scale: f32,
    /// Taken off each channel, in the order of `channels`.
    pub mean: [f32; 3],
    /// Divides each channel, in the order of `channels`.
    pub std: [f32; 3],
}

impl TensorFormat {
    /// Writes `rgb` (`[H][W][3]`, RGB) into `out`, of as many elements, in this format.
    ///
    /// # Panics
    /// If the two differ in length, or hold no whole number of pixels: both are sized when the graph is loaded.
    pub fn fill(&self, rgb: &[u8], out: &mut [f32]) {
        todo!("{rgb:?} {out:?}")
    }
}
