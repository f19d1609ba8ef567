//! The flags that describe the camera.

use std::num::NonZeroU32;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use nunet_core::camera::IntrinsicsSpec;

use super::{FilterArgs, count};
use crate::exit::parsed;
use crate::options::CameraGeometry;

/// The camera, as far as the user knows it.
#[derive(Debug, Args, Clone, Default)]
pub struct GeometryArgs {
    /// Focal lengths and principal point in pixels, for a camera without distortion; `@WxH` is the size they are valid for
    #[arg(long, value_name = "fx,fy,cx,cy[@WxH]", allow_hyphen_values = true, value_parser = parsed::<IntrinsicsSpec>)]
    pub intrinsics: Option<IntrinsicsSpec>,
    /// A calibration with distortion: a ROS `camera_info` file (`plumb_bob`, `rational_polynomial`, `equidistant`)
    #[arg(long, value_name = "FILE.yaml", conflicts_with = "intrinsics")]
    pub calibration: Option<PathBuf>,
}

impl GeometryArgs {
    /// As checked values.
    #[must_use]
    pub fn options(&self) -> CameraGeometry {
        CameraGeometry { intrinsics: self.intrinsics, calibration: self.calibration.clone() }
    }
}

/// How the lens affects depth.
#[derive(Debug, Args, Clone)]
pub struct LensArgs {
    #[command(flatten)]
    pub geometry: GeometryArgs,
    /// Scale metric depth by the ratio of the focal lengths of this camera and the training camera, if known
    #[arg(long, value_enum, default_value_t = FocalArg::Auto)]
    pub focal: FocalArg,
}

impl Default for LensArgs {
    /// An unknown camera.
    fn default() -> Self {
        Self { geometry: GeometryArgs::default(), focal: FocalArg::Auto }
    }
}

/// The camera, and what is made of its depth.
#[derive(Debug, Args, Clone)]
pub struct CameraArgs {
    #[command(flatten)]
    pub lens: LensArgs,
    #[command(flatten)]
    pub filters: FilterArgs,
    /// Take every N-th row and column of depth for the cloud
    #[arg(long, value_name = "N", default_value = "1", value_parser = count::<NonZeroU32>)]
    pub cloud_stride: NonZeroU32,
    /// Drop points farther from the camera than M meters from the cloud [default: the model's maximum depth]
    #[arg(long, value_name = "M", value_parser = range)]
    pub max_range: Option<f32>,
}

/// A distance in meters.
fn range(text: &str) -> Result<f32, String> {
    let range: Option<f32> = text.parse().ok().filter(|range: &f32| range.is_finite() && *range > 0.0);
    range.ok_or_else(|| "expected a number of meters greater than 0".to_owned())
}

impl Default for CameraArgs {
    /// An unknown camera, no filter, and a cloud of every pixel.
    fn default() -> Self {
        Self {
            lens: LensArgs::default(),
            filters: FilterArgs::default(),
            cloud_stride: NonZeroU32::MIN,
            max_range: None,
        }
    }
}

/// Whether depth follows the focal length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FocalArg {
    /// If the intrinsics are known.
    Auto,
    /// Never.
    Off,
}
