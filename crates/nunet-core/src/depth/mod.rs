//! From a network's numbers to depth: decoding, the range of what counts as a measurement, and the scale.

mod decode;
mod scale;

pub use decode::{DepthError, DepthRange, Encoding};
pub use nunet_types::{ScaleSource, Units};
pub use scale::Scale;
