//! The picture's last step before the graph.

use crate::graph::{GraphInput, SerialGraph};
use crate::preprocess::TensorFormat;

/// The picture as the graph wants it: as it is, or as a foreign network's tensor in memory kept for it.
pub(super) enum Input {
    Rgb,
    Float { format: TensorFormat, tensor: Vec<f32> },
}

impl Input {
    pub(super) fn new(graph: &SerialGraph) -> Self {
        let (width, height) = graph.size();
        match graph.float_input() {
            None => Self::Rgb,
            Some(&format) => Self::Float { format, tensor: vec![0.0; 3 * width as usize * height as usize] },
        }
    }

    /// The graph's input for a picture of its size, and the bytes written to make it.
    pub(super) fn of<'a>(&'a mut self, rgb: &'a [u8]) -> (GraphInput<'a>, u64) {
        match self {
            Self::Rgb => (GraphInput::Rgb(rgb), 0),
            Self::Float { format, tensor } => {
                format.fill(rgb, tensor);
                (GraphInput::Float(tensor), size_of_val(&tensor[..]) as u64)
            }
        }
    }
}
