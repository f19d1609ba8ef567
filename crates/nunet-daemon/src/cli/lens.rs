//! The flags that describe the camera.

use std::num::NonZeroU32;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use nunet_core::camera::IntrinsicsSpec;
use nunet_core::pipeline::{Focal, PipelineOptions};
use serde::Deserialize;

use super::FilterArgs;
use super::text::{Distance, Text, value};
use crate::config::ProcessingConfig;
use crate::exit::BadArguments;
use crate::source::CameraGeometry;

/// The intrinsics or calibration, if known.
#[derive(Debug, Args, Clone, Deserialize)]
pub struct GeometryArgs {
    /// Focal lengths and principal point in pixels, for a camera without distortion; `@WxH` is the size they are valid for
    #[arg(long, value_name = "fx,fy,cx,cy[@WxH]", allow_hyphen_values = true)]
    pub intrinsics: Option<Text<IntrinsicsSpec>>,
    /// A calibration with distortion: a ROS `camera_info` file (`plumb_bob`, `rational_polynomial`, `equidistant`)
    #[arg(long, value_name = "FILE.yaml", conflicts_with = "intrinsics")]
    pub calibration: Option<PathBuf>,
}

impl GeometryArgs {
    /// As checked values.
    #[must_use]
    pub fn options(&self) -> CameraGeometry {
        CameraGeometry { intrinsics: value(&self.intrinsics), calibration: self.calibration.clone() }
    }
}

/// How the camera affects depth.
#[derive(Debug, Args, Clone, Deserialize)]
pub struct LensArgs {
    #[command(flatten)]
    #[serde(flatten)]
    pub geometry: GeometryArgs,
    /// Scale metric depth by the ratio of the focal lengths of this camera and the training camera, if known
    #[arg(long, value_enum, default_value_t = FocalArg::Auto)]
    pub focal: FocalArg,
}

impl LensArgs {
    /// As checked values, with the filters of the depth map.
    pub(crate) fn config(&self, filters: &FilterArgs) -> Result<ProcessingConfig, BadArguments> {
        let focal = match self.focal {
            FocalArg::Auto => Focal::Auto,
            FocalArg::Off => Focal::Off,
        };
        let pipeline = PipelineOptions { focal, filters: filters.options()?, ..PipelineOptions::default() };
        Ok(ProcessingConfig { geometry: self.geometry.options(), pipeline })
    }
}

/// The camera, and the processing of its depth.
#[derive(Debug, Args, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct CameraArgs {
    #[command(flatten)]
    #[serde(flatten)]
    pub lens: LensArgs,
    #[command(flatten)]
    #[serde(flatten)]
    pub filters: FilterArgs,
    /// Take every N-th row and column of depth for the cloud
    #[arg(long, value_name = "N", default_value = "1")]
    pub cloud_stride: Text<NonZeroU32>,
    /// Drop cloud points farther than M meters from the camera, and ignore obstacles farther than M meters from the base
    /// [default: the model's maximum depth for the cloud, 5 for obstacles]
    #[arg(long, value_name = "M")]
    pub max_range: Option<Text<Distance>>,
}

impl CameraArgs {
    /// As checked values.
    pub(crate) fn config(&self) -> Result<ProcessingConfig, BadArguments> {
        let ProcessingConfig { geometry, pipeline } = self.lens.config(&self.filters)?;
        let max_range_m = value(&self.max_range).map(|Distance(meters)| meters);
        Ok(ProcessingConfig {
            geometry,
            pipeline: PipelineOptions { cloud_stride: self.cloud_stride.0, max_range_m, ..pipeline },
        })
    }
}

/// Whether depth follows the focal length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FocalArg {
    /// If the intrinsics are known.
    Auto,
    /// Never.
    Off,
}
