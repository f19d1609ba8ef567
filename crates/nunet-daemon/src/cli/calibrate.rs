//! The arguments of `nunetd calibrate`.

use std::path::PathBuf;

use clap::{ArgGroup, Args};
use nunet_core::framing::AspectMode;
use nunet_core::pipeline::PipelineOptions;
use nunet_core::scale::ScaleMode;
use nunet_eval::{DepthUnits, EvalOptions, Pixel, Point, Reference, Window};

use super::eval::parse_meters;
use super::text::{Text, value};
use super::{DEFAULT_MODEL, DepthUnitArgs, EngineArgs, GeometryArgs, SourceArgs};
use crate::config::MountOption;
use crate::exit::BadArguments;
use crate::source::SourceName;
use crate::subcommands::calibrate::{CalibrateOptions, Evidence};

/// Flags that have an effect with `--truth` only. `requires` is not enough: clap does not require an argument
/// that conflicts with one that is present.
const TRUTH_FLAGS: [&str; 6] = ["depth_cap", "depth_scale", "depth_offset", "depth_topic", "ids", "window"];
/// Flags that have an effect with `--source` only.
const SOURCE_FLAGS: [&str; 7] = ["rate", "repeat", "size", "format", "exposure", "gain", "frames"];

/// `nunetd calibrate`
#[derive(Debug, Args, Clone)]
#[command(group(ArgGroup::new("evidence").args(["distance", "pairs", "truth", "mount"]).required(true)))]
#[command(next_help_heading = "Reference")]
pub struct CalibrateArgs {
    /// The reference is a distance: from the camera straight to the point of --at, meters
    #[arg(long, value_name = "M", requires = "source", conflicts_with_all = TRUTH_FLAGS)]
    pub distance: Option<f64>,
    /// With --distance, the point in the image: column and row, pixels [default: the center]
    #[arg(long, value_name = "u,v", requires = "distance", allow_hyphen_values = true)]
    #[arg(conflicts_with_all = ["pairs", "truth", "mount"])]
    pub at: Option<Pixel>,
    /// The reference is a range sensor: a CSV table with the columns `image` (a file, relative to the table),
    /// `u`, `v` (pixels) and `distance` (meters, straight to the point)
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = TRUTH_FLAGS, conflicts_with_all = SOURCE_FLAGS)]
    #[arg(conflicts_with = "topic")]
    pub pairs: Option<PathBuf>,
    /// The reference is the floor: the pose of the camera in the base frame of the robot, meters and radians;
    /// z is the height above the floor
    #[arg(long, value_name = "x,y,z,roll,pitch,yaw", allow_hyphen_values = true, requires = "source")]
    #[arg(conflicts_with_all = TRUTH_FLAGS)]
    pub mount: Option<Text<MountOption>>,
    /// The reference is images with true depth: a folder or a recording, as for `nunetd eval`
    #[arg(long, value_name = "DATASET", conflicts_with_all = SOURCE_FLAGS)]
    pub truth: Option<PathBuf>,
    /// With --truth, the topic with true depth, if the recording has several
    #[arg(long, value_name = "TOPIC", requires = "truth")]
    pub depth_topic: Option<String>,
    /// With --truth, the images to use: a file with one id per line [default: all]
    #[arg(long, value_name = "FILE", requires = "truth")]
    pub ids: Option<PathBuf>,
    /// With --truth, ignore true depth of this value or more, meters [default: 10]
    #[arg(long, value_name = "METERS", value_parser = parse_meters)]
    pub depth_cap: Option<f64>,
    #[command(flatten)]
    pub units: DepthUnitArgs,
    /// With --truth, the part of the images that has true depth, pixels; BOTTOM and RIGHT are the first ones
    /// outside
    #[arg(long, value_name = "TOP,LEFT,BOTTOM,RIGHT", requires = "truth")]
    pub window: Option<Window>,
    /// With --distance or --mount, the camera: a folder, a glob of images, a recording FILE.mcap, a camera
    /// /dev/videoN, shm:CAMERA, ros2:TOPIC, exec:COMMAND, rtsp://..., or - for stdin
    #[arg(long, value_name = "SOURCE", conflicts_with_all = ["pairs", "truth"], help_heading = "Source")]
    pub source: Option<String>,
    #[command(flatten, next_help_heading = "Source")]
    pub pace: SourceArgs,
    #[command(flatten, next_help_heading = "Camera")]
    pub geometry: GeometryArgs,
    /// As for `nunetd run`: `crop`, `stretch` or `letterbox`; the factor holds for this choice
    #[arg(long, value_name = "crop|stretch|letterbox", default_value = "crop", help_heading = "Camera")]
    pub aspect: Text<AspectMode>,
    /// An .onnx file, a staged graph (.toml), or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL, help_heading = "Model")]
    pub model: PathBuf,
    #[command(flatten, next_help_heading = "Model")]
    pub engine: EngineArgs,
    /// Write intrinsics and factor into this calibration file [default: the file of --calibration, in place]
    #[arg(long, value_name = "FILE.yaml", help_heading = "Results")]
    pub out: Option<PathBuf>,
    /// Overwrite an existing file of --out
    #[arg(long, requires = "out", help_heading = "Results")]
    pub force: bool,
    /// Print JSON
    #[arg(long, help_heading = "Results")]
    pub json: bool,
}

impl CalibrateArgs {
    /// As checked values. Opens nothing.
    pub(crate) fn options(&self) -> anyhow::Result<CalibrateOptions> {
        let source = || -> anyhow::Result<_> {
            let source = self.pace.config(SourceName::parse(self.source.as_deref().unwrap_or("demo")));
            source.check()?;
            Ok(source)
        };
        let evidence = match (self.distance, &self.pairs, &self.truth, value(&self.mount)) {
            (Some(distance_m), ..) => {
                let point = Point { at: self.at.map(|Pixel(at)| at), distance_m };
                point.check().map_err(|error| BadArguments::of(&error))?;
                Evidence::Frames(source()?, Reference::Point(point))
            }
            (_, Some(pairs), ..) => Evidence::Readings(pairs.clone()),
            (.., Some(truth), _) => Evidence::Truth(self.truth(truth)),
            (.., mount) => {
                let mount =
                    mount.ok_or_else(|| BadArguments::new("pass --distance, --pairs, --truth or --mount"))?;
                mount.warn_of_mistakes();
                let mount = mount.pose().map_err(|error| BadArguments::of(&error))?;
                Evidence::Frames(source()?, Reference::Floor(mount))
            }
        };
        Ok(CalibrateOptions {
            evidence,
            geometry: self.geometry.options(),
            model: self.model.clone(),
            // The network's own meters are compared.
            pipeline: PipelineOptions {
                aspect: self.aspect.0,
                scale: ScaleMode::Off,
                ..PipelineOptions::default()
            },
            engine: self.engine.options(),
            out: self.out.clone().or_else(|| self.geometry.calibration.clone()),
            force: self.force,
            json: self.json,
        })
    }

    fn truth(&self, dataset: &std::path::Path) -> EvalOptions {
        let usual = EvalOptions::new(dataset);
        EvalOptions {
            depth_cap_m: self.depth_cap.map_or(usual.depth_cap_m, |cap| cap as f32),
            topic: self.pace.topic.clone(),
            depth_topic: self.depth_topic.clone(),
            ids: self.ids.clone(),
            units: DepthUnits { scale: self.units.depth_scale, offset: self.units.depth_offset },
            window: self.window,
            camera: self.geometry.options(),
            ..usual
        }
    }
}
