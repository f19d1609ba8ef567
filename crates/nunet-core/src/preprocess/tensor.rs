//! Converts RGB bytes to normalized `f32`, the input of foreign networks.

/// The order of a tensor's dimensions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TensorLayout {
    /// `[1, 3, H, W]`
    Nchw,
    /// `[1, H, W, 3]`
    Nhwc,
}

impl TensorLayout {
    /// The name in a sidecar and in `inspect --json`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Nchw => "nchw",
            Self::Nhwc => "nhwc",
        }
    }
}

/// The order of a tensor's channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ChannelOrder {
    /// Red first.
    Rgb,
    /// Blue first.
    Bgr,
}

/// The format of a foreign network's image: `(byte * scale - mean) / std` for each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TensorFormat {
    /// The order of the dimensions.
    pub layout: TensorLayout,
    /// The order of the channels.
    pub channels: ChannelOrder,
    /// Multiplies the byte, 1/255 for 0 to 1.
    pub scale: f32,
    /// Subtracted from each channel, in the order of `channels`.
    pub mean: [f32; 3],
    /// Divides each channel, in the order of `channels`.
    pub std: [f32; 3],
}

impl TensorFormat {
    /// Writes `rgb` (`[H][W][3]`, RGB) into `out`, of as many elements, in this format.
    ///
    /// # Panics
    /// If the two differ in length, or are not whole pixels: both are sized when the graph is loaded.
    pub fn fill(&self, rgb: &[u8], out: &mut [f32]) {
        assert_eq!(rgb.len(), out.len(), "the tensor has the image's size");
        let (pixels, rest) = rgb.as_chunks();
        assert!(rest.is_empty(), "an image is a whole number of pixels");
        match self.layout {
            TensorLayout::Nchw => self.fill_planes(pixels, out),
            TensorLayout::Nhwc => self.fill_pixels(pixels, out),
        }
    }

    /// The RGB color that becomes 0 in every channel, or the nearest: the mean of training, if the format
    /// subtracts it.
    #[must_use]
    pub fn mean_color(&self) -> [u8; 3] {
        let [first, second, third] = self.mean.map(|mean| (mean / self.scale).round() as u8); // saturates
        match self.channels {
            ChannelOrder::Rgb => [first, second, third],
            ChannelOrder::Bgr => [third, second, first],
        }
    }

    fn fill_planes(&self, pixels: &[[u8; 3]], out: &mut [f32]) {
        let planes = out.chunks_exact_mut(pixels.len().max(1));
        for ((plane, source), (gain, offset)) in planes.zip(self.source_channels()).zip(self.lines()) {
            for (value, pixel) in plane.iter_mut().zip(pixels) {
                *value = f32::from(pixel[source]) * gain + offset;
            }
        }
    }

    fn fill_pixels(&self, pixels: &[[u8; 3]], out: &mut [f32]) {
        let [first, second, third] = self.source_channels();
        let [a, b, c] = self.lines();
        for (values, pixel) in out.as_chunks_mut().0.iter_mut().zip(pixels) {
            *values = [
                f32::from(pixel[first]) * a.0 + a.1,
                f32::from(pixel[second]) * b.0 + b.1,
                f32::from(pixel[third]) * c.0 + c.1,
            ];
        }
    }

    /// For each channel of the tensor, which of red, green, blue it is.
    fn source_channels(&self) -> [usize; 3] {
        match self.channels {
            ChannelOrder::Rgb => [0, 1, 2],
            ChannelOrder::Bgr => [2, 1, 0],
        }
    }

    /// `(byte * scale - mean) / std` of each channel as gain and offset.
    fn lines(&self) -> [(f32, f32); 3] {
        [0, 1, 2].map(|channel| (self.scale / self.std[channel], -self.mean[channel] / self.std[channel]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(layout: TensorLayout, channels: ChannelOrder, rgb: &[u8]) -> Vec<f32> {
        let format =
            TensorFormat { layout, channels, scale: 0.5, mean: [1.0, 2.0, 3.0], std: [1.0, 2.0, 4.0] };
        let mut out = vec![f32::NAN; rgb.len()];
        format.fill(rgb, &mut out);
        out
    }

    #[test]
    fn planes_hold_hand_computed_values() {
        let rgb = [2, 4, 6, 20, 40, 60];
        assert_eq!(filled(TensorLayout::Nchw, ChannelOrder::Rgb, &rgb), [0.0, 9.0, 0.0, 9.0, 0.0, 6.75]);
        assert_eq!(filled(TensorLayout::Nchw, ChannelOrder::Bgr, &rgb), [2.0, 29.0, 0.0, 9.0, -0.5, 1.75]);
    }

    #[test]
    fn pixels_hold_hand_computed_values() {
        let rgb = [2, 4, 6, 20, 40, 60];
        assert_eq!(filled(TensorLayout::Nhwc, ChannelOrder::Rgb, &rgb), [0.0, 0.0, 0.0, 9.0, 9.0, 6.75]);
        assert_eq!(filled(TensorLayout::Nhwc, ChannelOrder::Bgr, &rgb), [2.0, 0.0, -0.5, 29.0, 9.0, 1.75]);
    }

    #[test]
    fn the_mean_color_is_in_the_order_of_the_image() {
        let imagenet = |channels, mean| TensorFormat {
            layout: TensorLayout::Nchw,
            channels,
            scale: 1.0 / 255.0,
            mean,
            std: [0.2; 3],
        };
        assert_eq!(imagenet(ChannelOrder::Rgb, [0.485, 0.456, 0.406]).mean_color(), [124, 116, 104]);
        assert_eq!(imagenet(ChannelOrder::Bgr, [0.406, 0.456, 0.485]).mean_color(), [124, 116, 104]);
        assert_eq!(imagenet(ChannelOrder::Rgb, [-1.0, 0.0, 2.0]).mean_color(), [0, 0, 255]);
    }

    #[test]
    fn every_byte_is_normalized_as_the_formula_says() {
        let format = TensorFormat {
            layout: TensorLayout::Nhwc,
            channels: ChannelOrder::Rgb,
            scale: 1.0 / 255.0,
            mean: [0.485, 0.456, 0.406],
            std: [0.229, 0.224, 0.225],
        };
        let rgb: Vec<u8> = (0..=255).flat_map(|byte| [byte; 3]).collect();
        let mut out = vec![0.0; rgb.len()];
        format.fill(&rgb, &mut out);
        for (i, value) in out.iter().enumerate() {
            let expected =
                (f64::from(rgb[i]) / 255.0 - f64::from(format.mean[i % 3])) / f64::from(format.std[i % 3]);
            assert!((f64::from(*value) - expected).abs() < 1e-6, "{i}: {value} {expected}");
        }
    }
}
