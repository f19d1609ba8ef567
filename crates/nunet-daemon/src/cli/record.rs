//! The flags of recordings.

use std::path::PathBuf;

use clap::Args;
use serde::Deserialize;

use super::text::{FrameId, Text, value};
use super::{CameraArgs, DEFAULT_MODEL, EngineArgs};
use crate::config::{MountOption, Publish, RecordConfig};
use crate::exit::{BadArguments, camera_name};
use crate::subcommands::replay;

/// The recording of a stream.
#[derive(Debug, Args, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct RecordArgs {
    /// Record images and results as ROS 2 messages into this file, or into a new file in this folder
    #[arg(long, value_name = "FILE.mcap|DIR")]
    pub record: Option<PathBuf>,
    /// Overwrite an existing recording
    #[arg(long)]
    pub force: bool,
    /// Record raw images as PNG instead of JPEG; JPEG and PNG files are always recorded as they are, or as
    /// PNG if --rotate or their EXIF data rotates them
    #[arg(long)]
    pub record_lossless: bool,
    #[command(flatten, next_help_heading = "Camera")]
    #[serde(flatten)]
    pub mount: MountArgs,
}

impl RecordArgs {
    /// As checked values; `None` if nothing is recorded.
    pub(crate) fn config(&self) -> Option<RecordConfig> {
        let Self { record, force, record_lossless: lossless, mount: _ } = self.clone();
        record.map(|path| RecordConfig { path, force, lossless })
    }
}

/// The pose of the camera on the robot.
#[derive(Debug, Args, Clone, Deserialize)]
pub struct MountArgs {
    /// The pose of the camera in `base_link` (x forward, y left, z up), meters and radians; recorded in
    /// `/tf_static`. Obstacles and --scale floor need it: z is the height above the floor then
    #[arg(long, value_name = "x,y,z,roll,pitch,yaw", allow_hyphen_values = true)]
    pub mount: Option<Text<MountOption>>,
}

/// `nunetd replay`
#[derive(Debug, Args, Clone)]
pub struct ReplayArgs {
    /// The recording to read
    #[arg(value_name = "IN.mcap")]
    pub input: PathBuf,
    /// The recording to write
    #[arg(value_name = "OUT.mcap")]
    pub output: PathBuf,
    /// An .onnx file, a staged graph (.toml), or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL, help_heading = "Model")]
    pub model: PathBuf,
    #[command(flatten, next_help_heading = "Model")]
    pub engine: EngineArgs,
    /// The image topic, if there are several
    #[arg(long, value_name = "TOPIC", help_heading = "Source")]
    pub topic: Option<String>,
    #[command(flatten)]
    pub processing: CameraArgs,
    #[command(flatten, next_help_heading = "Camera")]
    pub mount: MountArgs,
    /// The first part of the names of the new topics
    #[arg(long, value_name = "NAME", default_value = "camera", help_heading = "Results")]
    pub camera: String,
    /// The coordinate frame of depth and cloud [default: that of the images]
    #[arg(long, value_name = "NAME", help_heading = "Results")]
    pub frame_id: Option<Text<FrameId>>,
    /// The results to record, separated by commas; `replay` finds no obstacles
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = Publish::DEFAULT)]
    #[arg(help_heading = "Results")]
    pub publish: Vec<Publish>,
    /// Overwrite an existing recording
    #[arg(long, help_heading = "Results")]
    pub force: bool,
    /// Print JSON
    #[arg(long, help_heading = "Results")]
    pub json: bool,
}

impl ReplayArgs {
    /// As checked values.
    pub(crate) fn options(self) -> anyhow::Result<replay::ReplayOptions> {
        // They would be missing in the recording without a warning.
        if self.publish.contains(&Publish::Obstacles) {
            let hint = "pass --source IN.mcap --record OUT.mcap and --mount to `nunetd run` instead";
            return Err(BadArguments::new("`replay` finds no obstacles").with_hint(hint).into());
        }
        Ok(replay::ReplayOptions {
            camera: camera_name(&self.camera)?,
            frame_id: value(&self.frame_id).map(|FrameId(name)| name),
            mount: value(&self.mount.mount),
            processing: self.processing.config(value(&self.mount.mount))?,
            engine: self.engine.options(),
            input: self.input,
            output: self.output,
            model: self.model,
            topic: self.topic,
            publish: self.publish,
            force: self.force,
            json: self.json,
        })
    }
}
