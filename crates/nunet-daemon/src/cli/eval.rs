//! The arguments of `nunetd eval`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};

use super::{DEFAULT_MODEL, EngineArgs, FilterArgs, LensArgs};

/// `nunetd eval`
#[derive(Debug, Args, Clone)]
pub struct EvalArgs {
    /// A recording FILE.mcap with pictures and depth, or a folder with `rgb/ID.jpg` or `.png`, `depth/ID.png` and, for labels,
    /// `labels/ID.png` or `label40/ID.png`
    pub dataset: PathBuf,
    /// The recording's topic with pictures, where it has several
    #[arg(long, value_name = "TOPIC")]
    pub topic: Option<String>,
    /// The recording's topic with true depth, where it has several
    #[arg(long, value_name = "TOPIC")]
    pub depth_topic: Option<String>,
    /// An .onnx file, a staged graph's .toml, or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL)]
    pub model: PathBuf,
    /// Pictures to measure, a file with one id a line [default: all]
    #[arg(long, value_name = "FILE")]
    pub ids: Option<PathBuf>,
    /// Pictures of the dataset whose mean image is the baseline [default: those that are measured]
    #[arg(long, value_name = "FILE")]
    pub baseline_ids: Option<PathBuf>,
    /// The mean image of other pictures as the baseline: the `mean_image.npy` that another `eval --out` has written
    #[arg(long, value_name = "FILE.npy", conflicts_with = "baseline_ids")]
    pub baseline: Option<PathBuf>,
    /// What is compared: whole pictures, or the crop of Eigen et al. for NYU Depth V2. Truth from 10 m on
    /// counts as none, and predictions end at 10 m
    #[arg(long, value_enum, default_value_t = ProtocolArg::Full)]
    pub protocol: ProtocolArg,
    #[command(flatten)]
    pub units: DepthUnitArgs,
    /// Pixels outside of it have no truth, for data with a frame around each picture
    #[arg(long, value_name = "TOP,LEFT,BOTTOM,RIGHT")]
    pub window: Option<Window>,
    /// The pictures are one video, in their order: what a network or a filter remembers is carried from each to the next,
    /// as it is in a recording
    #[arg(long)]
    pub clip: bool,
    #[command(flatten)]
    pub lens: LensArgs,
    #[command(flatten)]
    pub filters: FilterArgs,
    /// Write `eval.json`, `pictures.csv`, `contact_sheet.png` and `mean_image.npy` into this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// The figures as JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// What the numbers of a depth picture mean: metres = (value + offset) * scale.
#[derive(Debug, Args, Clone, Copy)]
pub struct DepthUnitArgs {
    /// Metres a unit of the depth pictures [default: 0.001, for 16-bit pictures]. There 65535 is no measurement, and so is 0
    /// without an offset
    #[arg(long, value_name = "METRES", value_parser = parse_scale)]
    pub depth_scale: Option<f64>,
    /// Added to each value before scaling; other than 0 it says that the value 0 is a measurement
    #[arg(long, value_name = "UNITS", default_value = "0", allow_hyphen_values = true)]
    pub depth_offset: f64,
}

/// Protocols of evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProtocolArg {
    /// Every pixel that has truth.
    Full,
    /// Rows 45 to 471 and columns 41 to 601 of 640x480 pictures.
    Eigen,
}

/// A part of a picture, pixels; `bottom` and `right` are the first that are outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    pub top: u32,
    pub left: u32,
    pub bottom: u32,
    pub right: u32,
}

impl Window {
    /// Whether a pixel lies inside.
    #[must_use]
    pub fn contains(&self, column: u32, row: u32) -> bool {
        (self.top..self.bottom).contains(&row) && (self.left..self.right).contains(&column)
    }
}

impl FromStr for Window {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Result<Vec<u32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
        match parts.as_deref() {
            Ok(&[top, left, bottom, right]) if top < bottom && left < right => {
                Ok(Self { top, left, bottom, right })
            }
            _ => {
                Err("expected four whole numbers `top,left,bottom,right`, the first two the smaller"
                    .to_owned())
            }
        }
    }
}

fn parse_scale(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(scale) if scale > 0.0 && f64::is_finite(scale) => Ok(scale),
        _ => Err(format!("expected metres above 0, such as 0.001, got `{text}`")),
    }
}
