//! Decodes network outputs to depth: encodings, the valid range, and the scale.

mod border;
mod decode;
mod encoding;
mod error;
mod image;
mod scale;

pub use border::BorderFill;
pub use decode::{DepthRange, OutputScale};
pub use encoding::DepthKind;
pub use error::DepthError;
pub use image::DepthImage;
pub use nunet_types::{ScaleSource, Units};
pub use scale::Scale;

use decode::NetworkOutput;
use encoding::depth_encodings;

// Of each encoding: its name in metadata and sidecars, the kind of the decoded values, and how they are
// decoded. The inner closures are called for each value `v`. The order is that of the documentation.
depth_encodings! {
    /// Meters: z = v.
    Metric = "metric", Metric, |output| output.meters(|v| v);
    /// Inverse meters: z = 1 / v.
    Inverse = "inverse", Metric, |output| output.meters(|v| 1.0 / v);
    /// Logarithm of meters: z = exp(v).
    Log = "log", Metric, |output| output.meters(f32::exp);
    /// Depth without a unit, larger = farther: z = v.
    Relative = "relative", Relative, |output| output.unitless(|v| (v, v.is_finite()));
    /// Inverse depth without a unit, larger = nearer, as `MiDaS` and Depth Anything output it: z = 1 / v.
    RelativeInverse = "relative_inverse", Relative, |output| output.unitless(|v| {
        let z = 1.0 / v;
        (z, z > 0.0 && z.is_finite())
    });
    /// 0 for the nearest point of an image to 1 for the farthest, without a unit. Values outside are clamped.
    MinMax = "minmax", MinMax, |output| output.unitless(|v| (v.clamp(0.0, 1.0), v.is_finite()));
}
