//! The flags that describe the camera.

use std::num::NonZeroU32;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use nunet_core::camera::{IntrinsicsSpec, Mount, check_scale_factor};
use nunet_core::framing::AspectMode;
use nunet_core::pipeline::PipelineOptions;
use nunet_core::scale::ScaleMode;
use serde::Deserialize;

use super::FilterArgs;
use super::text::{Distance, FromText, Text, value};
use crate::config::{MountOption, ProcessingConfig};
use crate::exit::BadArguments;
use crate::source::{CameraGeometry, Rotation};

/// The intrinsics or calibration, if known.
#[derive(Debug, Args, Clone, Deserialize)]
pub struct GeometryArgs {
    /// Focal lengths and principal point in pixels, for a camera without distortion; `@WxH` is the size they
    /// are valid for, by default that of the images
    #[arg(long, value_name = "fx,fy,cx,cy[@WxH]", allow_hyphen_values = true)]
    pub intrinsics: Option<Text<IntrinsicsSpec>>,
    /// A calibration with distortion: a ROS `camera_info` file, a Kalibr camchain, or YAML of OpenCV
    #[arg(long, value_name = "FILE.yaml", conflicts_with = "intrinsics")]
    pub calibration: Option<PathBuf>,
    /// Rotate the images clockwise before everything else, for a camera that is mounted rotated. Intrinsics
    /// and calibration describe the images before the rotation; all results and --mount are those of the
    /// rotated images
    #[arg(long, value_name = "90|180|270")]
    pub rotate: Option<Text<Rotation>>,
}

impl GeometryArgs {
    /// As checked values.
    #[must_use]
    pub fn options(&self) -> CameraGeometry {
        CameraGeometry {
            intrinsics: value(&self.intrinsics),
            calibration: self.calibration.clone(),
            rotation: value(&self.rotate),
            factor: None,
        }
    }
}

/// How the camera affects depth.
#[derive(Debug, Args, Clone, Deserialize)]
pub struct LensArgs {
    #[command(flatten, next_help_heading = "Camera")]
    #[serde(flatten)]
    pub geometry: GeometryArgs,
    /// The factor by which the network's meters are multiplied: `auto` (that of the calibration file,
    /// otherwise the ratio of the focal lengths of this camera and the training camera, if known), `off` (1),
    /// a number from 0.05 to 20, or `floor` (measured on the floor; needs --mount)
    #[arg(long, value_name = "auto|off|NUMBER|floor", default_value = "auto", help_heading = "Depth")]
    pub scale: Text<ScaleArg>,
    /// Images whose aspect ratio differs from the network's by more than 5 %: use the largest centered part
    /// of its aspect ratio (`crop`), stretch them (`stretch`), or pad them (`letterbox`)
    #[arg(long, value_name = "crop|stretch|letterbox", default_value = "crop", help_heading = "Depth")]
    pub aspect: Text<AspectMode>,
    /// The same as --scale auto or --scale off
    #[arg(long, value_enum, conflicts_with = "scale", help_heading = "Depth")]
    pub focal: Option<FocalArg>,
}

impl LensArgs {
    /// As checked values, with the filters of the depth map.
    pub(crate) fn config(
        &self,
        filters: &FilterArgs,
        mount: Option<MountOption>,
    ) -> Result<ProcessingConfig, BadArguments> {
        mount.iter().for_each(MountOption::warn_of_mistakes);
        let asked = match self.focal {
            Some(FocalArg::Auto) => ScaleArg::Auto,
            Some(FocalArg::Off) => ScaleArg::Off,
            None => self.scale.0,
        };
        let (scale, factor) = match asked {
            ScaleArg::Auto => (ScaleMode::Auto, None),
            ScaleArg::Off => (ScaleMode::Off, None),
            ScaleArg::Factor(factor) => (ScaleMode::Auto, Some(factor)),
            ScaleArg::Floor => (ScaleMode::Floor(mount_for("--scale floor", mount)?), None),
        };
        let pipeline = PipelineOptions {
            aspect: self.aspect.0,
            scale,
            calibrated_factor: factor,
            filters: filters.options()?,
            ..PipelineOptions::default()
        };
        let geometry = CameraGeometry { factor, ..self.geometry.options() };
        Ok(ProcessingConfig { geometry, pipeline })
    }
}

impl FromText for AspectMode {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        let modes = [Self::Crop, Self::Stretch, Self::Letterbox];
        modes.into_iter().find(|mode| mode.name() == text).ok_or_else(|| {
            BadArguments::new(format!("expected `crop`, `stretch` or `letterbox`, got `{text}`"))
        })
    }
}

/// The pose of the camera, which a flag needs.
pub(super) fn mount_for(flag: &str, mount: Option<MountOption>) -> Result<Mount, BadArguments> {
    let pose = mount.ok_or_else(|| without_mount(&format!("{flag} needs")))?.pose();
    pose.map_err(|error| BadArguments::of(&error))
}

/// The error without a mount; `needs` says who needs it.
pub(super) fn without_mount(needs: &str) -> BadArguments {
    BadArguments::new(format!("{needs} the pose of the camera on the robot"))
        .with_hint("pass --mount x,y,z,roll,pitch,yaw, meters and radians; z is the height above the floor")
}

/// Where the scale of depth comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ScaleArg {
    /// The calibration, else the focal length.
    Auto,
    /// The network's meters.
    Off,
    /// A known factor.
    Factor(f32),
    /// The floor.
    Floor,
}

impl FromText for ScaleArg {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        match text {
            "auto" => Ok(Self::Auto),
            "off" => Ok(Self::Off),
            "floor" => Ok(Self::Floor),
            number => {
                let unknown = || format!("expected `auto`, `off`, `floor` or a number, got `{number}`");
                let factor = number.parse().map_err(|_| BadArguments::new(unknown()))?;
                check_scale_factor(factor).map(Self::Factor).map_err(|error| BadArguments::of(&error))
            }
        }
    }
}

/// The camera, and the processing of its depth.
#[derive(Debug, Args, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct CameraArgs {
    #[command(flatten)]
    #[serde(flatten)]
    pub lens: LensArgs,
    #[command(flatten, next_help_heading = "Depth")]
    #[serde(flatten)]
    pub filters: FilterArgs,
    /// Take every N-th row and column of depth for the cloud
    #[arg(long, value_name = "N", default_value = "1", help_heading = "Depth")]
    pub cloud_stride: Text<NonZeroU32>,
    /// Drop cloud points farther than M meters from the camera, and ignore obstacles farther than M meters
    /// from the base (for obstacles, 0.5 to 50) [default: the model's maximum depth for the cloud, 5 for
    /// obstacles]
    #[arg(long, value_name = "M", help_heading = "Depth")]
    pub max_range: Option<Text<Distance>>,
}

impl CameraArgs {
    /// As checked values.
    pub(crate) fn config(&self, mount: Option<MountOption>) -> Result<ProcessingConfig, BadArguments> {
        let ProcessingConfig { geometry, pipeline } = self.lens.config(&self.filters, mount)?;
        let max_range_m = value(&self.max_range).map(|Distance(meters)| meters);
        Ok(ProcessingConfig {
            geometry,
            pipeline: PipelineOptions { cloud_stride: self.cloud_stride.0, max_range_m, ..pipeline },
        })
    }
}

/// Two values of --scale by their old name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FocalArg {
    /// If the intrinsics are known.
    Auto,
    /// Never.
    Off,
}

#[cfg(test)]
mod tests {
    use nunet_types::Hint as _;

    use super::*;

    #[test]
    fn a_scale_is_a_word_or_a_plausible_number() {
        let parse = ScaleArg::from_text;
        assert_eq!(parse("auto"), Ok(ScaleArg::Auto));
        assert_eq!(parse("off"), Ok(ScaleArg::Off));
        assert_eq!(parse("floor"), Ok(ScaleArg::Floor));
        assert_eq!(parse("0.83"), Ok(ScaleArg::Factor(0.83)));
        for wrong in ["", "0", "-1", "nan", "inf", "1e9", "focal", "Floor"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_aspect_is_one_of_three_words() {
        for mode in [AspectMode::Crop, AspectMode::Stretch, AspectMode::Letterbox] {
            assert_eq!(AspectMode::from_text(mode.name()), Ok(mode));
        }
        assert!(AspectMode::from_text("Crop").is_err() && AspectMode::from_text("").is_err());
    }

    #[test]
    fn the_floor_needs_a_mount_above_it() {
        let hint = |mount| mount_for("--scale floor", mount).unwrap_err().hint().unwrap_or_default();
        assert!(hint(None).contains("pass --mount"));
        let at = |z: f64| MountOption { translation_m: [0.0, 0.0, z], roll_pitch_yaw_rad: [0.0; 3] };
        assert!(hint(Some(at(-0.1))).contains("above the floor"));
        assert!(mount_for("--scale floor", Some(at(0.3))).is_ok());
    }
}
