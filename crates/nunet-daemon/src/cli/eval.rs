//! The arguments of `nunetd eval`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use nunet_eval::{BaselineChoice, DepthUnits, EvalOptions, ObstacleEval, Protocol, Window};

use super::text::value;
use super::{DEFAULT_MODEL, EngineArgs, FilterArgs, ImageObstacleArgs, LensArgs};
use crate::config::{MountOption, ProcessingConfig};
use crate::exit::BadArguments;
use crate::source::CameraGeometry;
use crate::subcommands::eval;

/// `nunetd eval`
#[derive(Debug, Args, Clone)]
pub struct EvalArgs {
    /// A recording (FILE.mcap or the folder of a bag) with images and depth, or a folder with `rgb/ID.jpg` or
    /// `.png`, `depth/ID.png` or `.npy` and, for labels, `labels/ID.png` or `label40/ID.png`. If names differ
    /// and are time stamps, as in TUM's sequences, images and depth within 20 ms are joined
    pub dataset: PathBuf,
    /// The image topic, if the recording has several
    #[arg(long, value_name = "TOPIC", help_heading = "Dataset")]
    pub topic: Option<String>,
    /// The topic with true depth, if the recording has several
    #[arg(long, value_name = "TOPIC", help_heading = "Dataset")]
    pub depth_topic: Option<String>,
    /// The images to measure: a file with one id per line [default: all]
    #[arg(long, value_name = "FILE", help_heading = "Dataset")]
    pub ids: Option<PathBuf>,
    #[command(flatten, next_help_heading = "Dataset")]
    pub units: DepthUnitArgs,
    /// The part of the images that has true depth, pixels, for data with a border around each image; BOTTOM
    /// and RIGHT are the first ones outside
    #[arg(long, value_name = "TOP,LEFT,BOTTOM,RIGHT", help_heading = "Dataset")]
    pub window: Option<Window>,
    /// Treat the images as consecutive frames of one video: recurrent models and the temporal filter keep
    /// their state
    #[arg(long, help_heading = "Dataset")]
    pub clip: bool,
    /// The pixels to compare: whole images, or the crop of Eigen et al. for NYU Depth V2
    #[arg(long, value_enum, default_value_t = ProtocolArg::Full, help_heading = "Comparison")]
    pub protocol: ProtocolArg,
    /// Ignore true depth of this value or more, meters, and limit predictions to it: 10 for NYU Depth V2, 80
    /// for KITTI
    #[arg(long, value_name = "METERS", default_value = "10", value_parser = parse_meters)]
    #[arg(help_heading = "Comparison")]
    pub depth_cap: f64,
    /// The images whose mean depth is the baseline: a file with one id per line [default: those of the other
    /// scenes if the ids name scenes, otherwise the measured images]
    #[arg(long, value_name = "FILE", help_heading = "Comparison")]
    pub baseline_ids: Option<PathBuf>,
    /// The mean image to use as the baseline: the `mean_image.npy` that another `eval --out` wrote
    #[arg(long, value_name = "FILE.npy", conflicts_with = "baseline_ids", help_heading = "Comparison")]
    pub baseline: Option<PathBuf>,
    /// An .onnx file, a staged graph (.toml), or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL, help_heading = "Model")]
    pub model: PathBuf,
    #[command(flatten, next_help_heading = "Model")]
    pub engine: EngineArgs,
    #[command(flatten)]
    pub lens: LensArgs,
    #[command(flatten, next_help_heading = "Depth")]
    pub filters: FilterArgs,
    #[command(flatten)]
    pub obstacles: ImageObstacleArgs,
    /// Write `eval.json`, `images.csv`, `contact_sheet.png` and `mean_image.npy` into this folder
    #[arg(long, value_name = "DIR", help_heading = "Results")]
    pub out: Option<PathBuf>,
    /// Print JSON
    #[arg(long, help_heading = "Results")]
    pub json: bool,
}

/// What the integers of a depth image mean: meters = (value + offset) * scale.
#[derive(Debug, Args, Clone, Copy)]
pub struct DepthUnitArgs {
    /// Meters per unit of the depth images, such as 0.00390625 for KITTI and 0.0002 for TUM. 65535 is no
    /// measurement; 0 is none either unless --depth-offset is given. Depth in floating point (32FC1, `.npy`)
    /// is in meters and has no other unit [default: 0.001, for 16-bit images]
    #[arg(long, value_name = "METERS", value_parser = parse_scale)]
    pub depth_scale: Option<f64>,
    /// Added to each value before scaling; if it is not 0, the value 0 is a measurement
    #[arg(long, value_name = "UNITS", default_value = "0", allow_hyphen_values = true)]
    #[arg(value_parser = nunet_eval::parse_units)]
    pub depth_offset: f64,
}

/// Protocols of evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProtocolArg {
    /// Every pixel that has truth.
    Full,
    /// Rows 45 to 471 and columns 41 to 601 of 640x480 images.
    Eigen,
}

impl EvalArgs {
    /// As checked values.
    pub(crate) fn options(&self) -> Result<eval::EvalCommandOptions, BadArguments> {
        let ProcessingConfig { geometry, pipeline } =
            self.lens.config(&self.filters, value(&self.obstacles.mount))?;
        self.obstacles.check_used(&pipeline)?;
        let obstacles = self.obstacle_eval(pipeline.max_range_m)?;
        Ok(eval::EvalCommandOptions {
            evaluation: EvalOptions { obstacles, ..self.evaluation(geometry) },
            model: self.model.clone(),
            pipeline,
            engine: self.engine.options(),
            out: self.out.clone(),
            json: self.json,
        })
    }

    /// How obstacles are found; `None` if they are not compared.
    fn obstacle_eval(&self, max_range_m: Option<f32>) -> Result<Option<ObstacleEval>, BadArguments> {
        if !self.obstacles.are_wanted() {
            return Ok(None);
        }
        let options = self.obstacles.options.options(max_range_m);
        let mount = value(&self.obstacles.mount).map(MountOption::pose).transpose();
        let mount = mount.map_err(|error| BadArguments::of(&error))?;
        options.check().map_err(|error| BadArguments::of(&error))?;
        Ok(Some(ObstacleEval { mount, options }))
    }

    fn evaluation(&self, camera: CameraGeometry) -> EvalOptions {
        let baseline = match (&self.baseline, &self.baseline_ids) {
            (Some(file), _) => BaselineChoice::File(file.clone()),
            (None, Some(list)) => BaselineChoice::Ids(list.clone()),
            (None, None) => BaselineChoice::Automatic,
        };
        EvalOptions {
            dataset: self.dataset.clone(),
            topic: self.topic.clone(),
            depth_topic: self.depth_topic.clone(),
            ids: self.ids.clone(),
            baseline,
            protocol: if self.protocol == ProtocolArg::Eigen { Protocol::Eigen } else { Protocol::Full },
            depth_cap_m: self.depth_cap as f32,
            units: DepthUnits { scale: self.units.depth_scale, offset: self.units.depth_offset },
            window: self.window,
            clip: self.clip,
            obstacles: None,
            camera,
        }
    }
}

/// Parses a limit of depth.
pub(super) fn parse_meters(text: &str) -> Result<f64, String> {
    nunet_eval::parse_meters(text, 10.0)
}

fn parse_scale(text: &str) -> Result<f64, String> {
    nunet_eval::parse_meters(text, 0.001)
}
