//! The arguments of recordings.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;

use super::{CameraArgs, DEFAULT_MODEL, EngineArgs, Publish};

/// What is recorded of a running stream.
#[derive(Debug, Args, Clone)]
pub struct RecordArgs {
    /// Record pictures and everything published as ROS 2 messages: into this file, or into a new one in this folder
    #[arg(long, value_name = "FILE.mcap|DIR")]
    pub record: Option<PathBuf>,
    /// Overwrite a recording that is there
    #[arg(long, requires = "record")]
    pub force: bool,
    #[command(flatten)]
    pub mount: MountArgs,
}

/// Where the camera is on the robot.
#[derive(Debug, Args, Clone, Copy)]
pub struct MountArgs {
    /// The camera on the robot, metres and radians in `base_link` (x forward, y left, z up): recorded in `/tf_static`
    #[arg(long, value_name = "x,y,z,roll,pitch,yaw", allow_hyphen_values = true)]
    pub mount: Option<MountArg>,
}

/// `x,y,z,roll,pitch,yaw`
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MountArg {
    /// Metres.
    pub translation_m: [f64; 3],
    /// Radians.
    pub roll_pitch_yaw_rad: [f64; 3],
}

impl FromStr for MountArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
        match numbers.as_deref() {
            Ok(&[x, y, z, roll, pitch, yaw])
                if [x, y, z, roll, pitch, yaw].iter().all(|number| number.is_finite()) =>
            {
                Ok(Self { translation_m: [x, y, z], roll_pitch_yaw_rad: [roll, pitch, yaw] })
            }
            _ => Err("expected six numbers `x,y,z,roll,pitch,yaw`: metres, then radians".to_owned()),
        }
    }
}

/// `nunetd replay`
#[derive(Debug, Args, Clone)]
pub struct ReplayArgs {
    /// The recording with pictures
    #[arg(value_name = "IN.mcap")]
    pub input: PathBuf,
    /// The recording to be made
    #[arg(value_name = "OUT.mcap")]
    pub output: PathBuf,
    /// An .onnx file, a staged graph's .toml, or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL)]
    pub model: PathBuf,
    /// The topic with pictures, where there are several
    #[arg(long, value_name = "TOPIC")]
    pub topic: Option<String>,
    /// First part of the new topics' names
    #[arg(long, value_name = "NAME", default_value = "camera")]
    pub camera: String,
    /// Coordinate frame of depth and cloud [default: the pictures' own]
    #[arg(long, value_name = "NAME", value_parser = super::run::parse_frame_id)]
    pub frame_id: Option<String>,
    #[command(flatten)]
    pub mount: MountArgs,
    /// What is recorded beside the pictures
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Publish::Depth, Publish::Labels, Publish::Cloud])]
    pub publish: Vec<Publish>,
    /// Overwrite a recording that is there
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub optics: CameraArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    /// What was done as JSON
    #[arg(long)]
    pub json: bool,
}
