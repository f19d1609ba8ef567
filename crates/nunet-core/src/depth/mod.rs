//! Decodes network outputs to depth: encodings, the valid range, and the scale.

mod border;
mod decode;
mod error;
mod scale;

pub use border::BorderFill;
pub use decode::{DepthEncoding, DepthRange, OutputScale};
pub use error::DepthError;
pub use nunet_types::{ScaleSource, Units};
pub use scale::Scale;
