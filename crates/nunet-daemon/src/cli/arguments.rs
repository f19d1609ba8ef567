//! The arguments of the smaller subcommands.

use std::num::{NonZeroU32, NonZeroU64};
use std::path::PathBuf;

use clap::Args;

use super::text::{Hash, Text, value};
use super::{CameraArgs, DEFAULT_MODEL, EngineArgs, GeometryArgs, ImageObstacleArgs, SourceArgs};
use crate::exit::camera_name;
use crate::source::SourceName;
use crate::subcommands::{bench, feed, infer, tune};

/// `nunetd infer`
#[derive(Debug, Args, Clone)]
pub struct InferArgs {
    /// JPEG or PNG images, folders with images, or globs
    #[arg(required = true, value_name = "IMAGE|DIR|GLOB")]
    pub images: Vec<PathBuf>,
    /// The folder for the results; several images get a folder each below it
    #[arg(long, value_name = "DIR", help_heading = "Results")]
    pub out: PathBuf,
    /// An .onnx file, a staged graph (.toml), or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL, help_heading = "Model")]
    pub model: PathBuf,
    #[command(flatten, next_help_heading = "Model")]
    pub engine: EngineArgs,
    #[command(flatten)]
    pub processing: CameraArgs,
    #[command(flatten)]
    pub obstacles: ImageObstacleArgs,
}

impl InferArgs {
    pub(super) fn options(self) -> anyhow::Result<infer::InferOptions> {
        let (mount, engine) = (value(&self.obstacles.mount), self.engine.options());
        let processing = self.processing.config(mount)?;
        let max_range_m = processing.pipeline.max_range_m;
        self.obstacles.check_used(&processing.pipeline)?;
        let obstacles = self.obstacles.options.config(mount, max_range_m, self.obstacles.obstacles)?;
        let obstacles = obstacles.filter(|obstacles| obstacles.is_required);
        let Self { images, out, model, .. } = self;
        Ok(infer::InferOptions { images, out, model, processing, obstacles, engine })
    }
}

/// `nunetd feed`
#[derive(Debug, Args, Clone)]
pub struct FeedArgs {
    /// demo, a folder, a glob of images, a recording FILE.mcap, a camera /dev/videoN, a ROS 2 topic
    /// ros2:TOPIC, exec:COMMAND, rtsp://..., or - for stdin
    pub source: String,
    #[command(flatten, next_help_heading = "Source")]
    pub pace: SourceArgs,
    /// The name of the camera in shared memory
    #[arg(long, value_name = "NAME", help_heading = "Camera")]
    pub camera: String,
    #[command(flatten, next_help_heading = "Camera")]
    pub geometry: GeometryArgs,
}

impl FeedArgs {
    pub(super) fn options(&self) -> anyhow::Result<feed::FeedOptions> {
        let source = self.pace.config(SourceName::parse(&self.source));
        let (camera, geometry) = (camera_name(&self.camera)?, self.geometry.options());
        Ok(feed::FeedOptions { source, camera, geometry })
    }
}

/// `nunetd watch`
#[derive(Debug, Args, Clone)]
pub struct WatchArgs {
    /// The name of the camera in shared memory
    pub camera: String,
    /// Print one JSON object per frame
    #[arg(long)]
    pub json: bool,
    /// Stop after N frames
    #[arg(long, value_name = "N")]
    pub frames: Option<Text<NonZeroU64>>,
    /// Seconds to wait for the camera and for each of its frames
    #[arg(long, value_name = "SECONDS", default_value = "10")]
    pub timeout: f64,
}

/// `nunetd inspect`
#[derive(Debug, Args, Clone)]
pub struct InspectArgs {
    /// An .onnx file, a staged graph (.toml), or the name of a bundled model
    pub model: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// `nunetd doctor`
#[derive(Debug, Args, Clone)]
pub struct DoctorArgs {
    /// The model to check with
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL)]
    pub model: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// `nunetd contract`
#[derive(Debug, Args, Clone)]
pub struct ContractArgs {
    /// Print JSON (the only format)
    #[arg(long)]
    pub json: bool,
}

/// `nunetd bench`
#[derive(Debug, Args, Clone)]
pub struct BenchArgs {
    /// A model to measure; repeat for several, which are measured interleaved
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL)]
    pub model: Vec<PathBuf>,
    /// The image to predict from [default: the first of the demo scene]
    #[arg(long, value_name = "IMAGE")]
    pub image: Option<PathBuf>,
    /// The number of predictions
    #[arg(long, value_name = "N", default_value = "100")]
    pub runs: Text<NonZeroU32>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub engine: EngineArgs,
}

impl BenchArgs {
    pub(super) fn options(self) -> bench::BenchOptions {
        let (runs, engine) = (self.runs.0, self.engine.options());
        bench::BenchOptions { models: self.model, image: self.image, runs, engine, json: self.json }
    }
}

/// `nunetd tune`
#[derive(Debug, Args, Clone)]
pub struct TuneArgs {
    /// An .onnx file, a staged graph (.toml), or the name of a bundled model
    #[arg(value_name = "NAME|PATH")]
    pub model: PathBuf,
    /// The image to predict from [default: the first of the demo scene]
    #[arg(long, value_name = "IMAGE")]
    pub image: Option<PathBuf>,
    /// The number of predictions per combination
    #[arg(long, value_name = "N", default_value = "50")]
    pub runs: Text<NonZeroU32>,
    /// Write the fastest combination as a file for `--config`
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub engine: EngineArgs,
}

impl TuneArgs {
    pub(super) fn options(self) -> tune::TuneOptions {
        let (runs, engine) = (self.runs.0, self.engine.options());
        let Self { model, image, out, json, .. } = self;
        tune::TuneOptions { model, image, runs, engine, out, json }
    }
}

/// `nunetd check-model`
#[derive(Debug, Args, Clone)]
pub struct CheckModelArgs {
    /// The model file
    pub model: PathBuf,
    /// SHA-256 of a file that may be loaded, hexadecimal; any file where none is given
    #[arg(long, value_name = "SHA256")]
    pub hash: Vec<Text<Hash>>,
    #[command(flatten)]
    pub engine: EngineArgs,
}
