//! The network's input tensor.

use nunet_types::ImageSize;

use crate::graph::{GraphInput, SerialGraph};
use crate::preprocess::TensorFormat;

/// The image for the graph: unchanged, or converted to a foreign network's tensor in a separate buffer.
pub(super) enum GraphImage {
    Rgb,
    Float { format: TensorFormat, tensor: Vec<f32> },
}

impl GraphImage {
    pub(super) fn new(graph: &SerialGraph) -> Self {
        let ImageSize { width, height } = graph.size();
        match graph.float_input() {
            None => Self::Rgb,
            Some(&format) => Self::Float { format, tensor: vec![0.0; 3 * width as usize * height as usize] },
        }
    }

    /// The graph's input for an image of its size, and the bytes written for it.
    pub(super) fn fill<'a>(&'a mut self, rgb: &'a [u8]) -> (GraphInput<'a>, u64) {
        match self {
            Self::Rgb => (GraphInput::Rgb(rgb), 0),
            Self::Float { format, tensor } => {
                format.fill(rgb, tensor);
                (GraphInput::Float(tensor), size_of_val(&tensor[..]) as u64)
            }
        }
    }
}
