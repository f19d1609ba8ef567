//! The flags of `nunetd run`: those of a camera, of which there may be several, and those for all cameras.

use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::path::PathBuf;

use clap::Args;
use nunet_core::frame::PixelFormat;
use nunet_ipc::Limits;
use nunet_mavlink::MavlinkAddress;
use nunet_ros2::options::Available;
use nunet_ros2::{DepthFormat, LinkName, Ros2Options, Topics};
use nunet_types::ImageSize;
use nunet_view::{Token, UncheckedToken, ViewConfig};
use serde::Deserialize;

use super::lens::mount_for;
use super::text::{FileMode, FrameId, Readers, StageEvery, Text, value};
use super::{CameraArgs, DEFAULT_MODEL, EngineArgs, FoxgloveArgs, ObstacleArgs, RecordArgs};
use crate::config::{
    AccessConfig, AttitudeConfig, AttitudeSource, CameraConfig, Config, ModelConfig, MountOption,
    OutputConfig, Publish, SourceConfig, StabilityLimit, frame_id,
};
use crate::exit::{BadArguments, WithHint, camera_name, in_camera};
use crate::source::{CameraSetting, CameraSettings, Rate, SourceName};

/// `nunetd run`
#[derive(Debug, Args, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct RunArgs {
    /// A configuration file whose keys are the long names of flags; flags take precedence
    #[arg(long, value_name = "FILE.toml", help_heading = "Configuration")]
    #[serde(skip)]
    pub config: Option<PathBuf>,
    /// An .onnx file, a staged graph (.toml), or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL, help_heading = "Model")]
    pub model: PathBuf,
    /// Run a stage only on every N-th frame and reuse its result in between; repeat for several stages
    #[arg(long, value_name = "STAGE=N", help_heading = "Model")]
    #[serde(default)]
    pub every: Vec<Text<StageEvery>>,
    #[command(flatten, next_help_heading = "Model")]
    #[serde(flatten)]
    pub engine: EngineArgs,
    #[command(flatten)]
    #[serde(flatten)]
    pub stream: StreamArgs,
    #[command(flatten, next_help_heading = "Results")]
    #[serde(flatten)]
    pub access: AccessArgs,
    #[command(flatten, next_help_heading = "ROS 2 and live view")]
    #[serde(flatten)]
    pub ros2: Ros2Args,
    #[command(flatten, next_help_heading = "ROS 2 and live view")]
    #[serde(flatten)]
    pub view: ViewArgs,
    #[command(flatten, next_help_heading = "ROS 2 and live view")]
    #[serde(flatten)]
    pub foxglove: FoxgloveArgs,
    /// Serve Prometheus metrics at http://ADDRESS:PORT/metrics
    #[arg(long, value_name = "ADDRESS:PORT", help_heading = "Statistics")]
    pub metrics: Option<Text<SocketAddr>>,
    /// Write frame counts and latencies into this file at the end
    #[arg(long, value_name = "FILE", help_heading = "Statistics")]
    pub stats_json: Option<PathBuf>,
}

impl RunArgs {
    /// The settings for all cameras, and the cameras of `arguments`, at least one.
    pub(crate) fn config(&self, cameras: &[StreamArgs]) -> anyhow::Result<Config> {
        let (several, ros2) = (cameras.len() > 1, self.ros2.options()?);
        let every = self.every.iter().map(|Text(StageEvery(stage, count))| (stage.clone(), *count));
        let cameras = cameras.iter().map(|camera| camera.config(several)).collect::<Result<Vec<_>, _>>()?;
        let names = cameras.iter().map(|camera| camera.name.as_str());
        ros2.check(names).map_err(|error| BadArguments::of(&error))?;
        for camera in &cameras {
            let obstacles = camera.obstacles.is_some();
            // What the model has is known later.
            let topics = ros2.topics.of_camera(Available { labels: true, confidence: true, obstacles });
            topics.map_err(|error| {
                let error = BadArguments::of(&error).with_hint("pass --mount x,y,z,roll,pitch,yaw");
                in_camera(error.into(), camera.name.as_str(), several)
            })?;
        }
        let outputs = OutputConfig {
            access: self.access.config(),
            metrics: value(&self.metrics),
            view: self.view.config()?,
            ros2,
            foxglove: self.foxglove.config()?,
            stats_json: self.stats_json.clone(),
        };
        outputs.check()?;
        Ok(Config {
            file: None,
            model: ModelConfig { path: self.model.clone(), every: every.collect() },
            engine: self.engine.options(),
            cameras,
            outputs,
        })
    }
}

/// The variable with the secret of the view.
pub(super) const TOKEN_VARIABLE: &str = "NUNET_VIEW_TOKEN";

/// The live view in the browser.
#[derive(Debug, Args, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct ViewArgs {
    /// Show images and results live in the browser at http://ADDRESS:PORT/, and serve the metrics there too
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub view: Option<Text<SocketAddr>>,
    /// The secret that viewers must present; required if other machines can reach the address of --view. The
    /// environment variable `NUNET_VIEW_TOKEN` keeps it out of the list of processes
    #[arg(long, value_name = "TOKEN")]
    pub view_token: Option<UncheckedToken>,
}

impl ViewArgs {
    fn config(&self) -> anyhow::Result<Option<ViewConfig>> {
        let Some(Text(address)) = self.view else {
            if self.view_token.is_some() {
                let error = BadArguments::new("--view-token is given without --view");
                return Err(error.with_hint("pass --view ADDRESS:PORT too").into());
            }
            return Ok(None);
        };
        let token = self.token()?;
        nunet_view::check_address(address, token.is_some()).map_err(|error| {
            WithHint::usage(error.to_string(), "pass --view-token TOKEN, or --view 127.0.0.1:PORT")
        })?;
        Ok(Some(ViewConfig { address, token }))
    }

    /// The secret of the flag, otherwise that of the variable, unless it is empty. clap does not read the
    /// variable: it would check it without --view too, and `nunetd config` would print it.
    fn token(&self) -> Result<Option<Token>, BadArguments> {
        let (origin, token) = match &self.view_token {
            // Not checked by clap and serde, because their errors would contain the secret.
            Some(token) => ("--view-token", token.check().map(Some)),
            None => (TOKEN_VARIABLE, Token::of_variable(TOKEN_VARIABLE)),
        };
        token.map_err(|error| BadArguments::of(&error).map_message(|message| format!("{origin}: {message}")))
    }
}

/// The results as topics of ROS 2.
#[derive(Debug, Args, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Ros2Args {
    /// Publish ROS 2 topics below /CAMERA/: `dds`, or `dds:DOMAIN` for another domain than that of the
    /// environment; `zenoh` as `rmw_zenoh` does, or `zenoh:ENDPOINT` for another router, such as
    /// `zenoh:tcp/192.168.1.5:7447`. May be given more than once. Nothing is encoded without subscribers
    #[arg(long, value_name = "dds[:DOMAIN]|zenoh[:ENDPOINT]")]
    #[serde(default)]
    pub ros2: Vec<Text<LinkName>>,
    /// `default`, `all`, or a list of names below /CAMERA/, such as `scan,depth/points` [default: obstacles,
    /// and depth at half size]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    #[serde(default)]
    pub ros2_topics: Vec<String>,
    /// 32FC1: meters, NaN = none; 16UC1: millimeters, 0 = none [default: 32FC1]
    #[arg(long, value_name = "32FC1|16UC1")]
    pub ros2_depth: Option<Text<DepthFormat>>,
}

impl Ros2Args {
    fn options(&self) -> Result<Ros2Options, BadArguments> {
        let names = &self.ros2_topics;
        let topics = if names.is_empty() { Ok(Topics::default()) } else { names.join(",").parse() };
        let topics = topics.map_err(|error| BadArguments::of(&error))?;
        let links = self.ros2.iter().map(|Text(link)| link.clone()).collect();
        Ok(Ros2Options { links, topics, depth: value(&self.ros2_depth).unwrap_or_default() })
    }
}

/// Who may read.
#[derive(Debug, Args, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct AccessArgs {
    /// The group that may read, by name or number [default: only this user]
    #[arg(long, value_name = "GROUP")]
    pub access_group: Option<String>,
    /// The octal file mode of shared memory: 0640, or 0660 if the group writes as well [default: 0640]
    #[arg(long, value_name = "MODE")]
    pub access_mode: Option<Text<FileMode>>,
}

impl AccessArgs {
    fn config(&self) -> Option<AccessConfig> {
        let mode = value(&self.access_mode).map(|FileMode(mode)| mode);
        self.access_group.clone().map(|group| AccessConfig { group, mode })
    }
}

/// The options of one camera: the keys of a `[[camera]]` section, in which `--camera` is `name`.
#[derive(Debug, Args, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct StreamArgs {
    /// demo, a folder, a glob of images, a recording FILE.mcap, a camera /dev/videoN, shm:CAMERA, a ROS 2
    /// topic ros2:TOPIC, exec:COMMAND, rtsp://..., or - for stdin
    /// [default: demo; required with --config]
    #[arg(long, value_name = "SOURCE", help_heading = "Source")]
    pub source: Option<String>,
    #[command(flatten, next_help_heading = "Source")]
    #[serde(flatten)]
    pub pace: SourceArgs,
    /// The name of the camera in shared memory [default: demo for the demo scene, nunet for a ROS 2
    /// topic, otherwise camera]
    #[arg(long, value_name = "NAME", help_heading = "Camera")]
    pub camera: Option<String>,
    /// The coordinate frame of depth and cloud [default: that of the images for a ROS 2 topic, otherwise the
    /// name of the camera + `_optical_frame`]
    #[arg(long, value_name = "NAME", help_heading = "Camera")]
    pub frame_id: Option<Text<FrameId>>,
    #[command(flatten)]
    #[serde(flatten)]
    pub processing: CameraArgs,
    /// Warn if depth drifts or flickers by more than this per frame while the image does not change: percent
    /// up to 100, or `off` [default: 5]
    #[arg(long, value_name = "PERCENT|off", help_heading = "Depth")]
    pub stability_limit: Option<Text<StabilityLimit>>,
    #[command(flatten, next_help_heading = "Obstacles")]
    #[serde(flatten)]
    pub obstacles: ObstacleArgs,
    /// Send obstacles to an autopilot, by MAVLink: udpout:HOST:PORT, tcpout:HOST:PORT or
    /// serial:DEVICE:BAUD; needs --mount
    #[arg(long, value_name = "ADDRESS", help_heading = "Obstacles")]
    pub mavlink: Option<Text<MavlinkAddress>>,
    /// The topics that can be read, separated by commas; all but depth are computed only while something
    /// reads them. With --mount, obstacles can always be read
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = Publish::DEFAULT)]
    #[arg(help_heading = "Results")]
    pub publish: Vec<Publish>,
    /// The number of processes that may read at a time, 1 to 62; half as many may read the cloud. Memory is
    /// reserved for all [default: 4]
    #[arg(long, value_name = "N", help_heading = "Results")]
    pub readers: Option<Text<Readers>>,
    #[command(flatten, next_help_heading = "Results")]
    #[serde(flatten)]
    pub recording: RecordArgs,
    /// Write depth, labels, confidence, cloud and obstacles of the last frame into this folder
    #[arg(long, value_name = "DIR", help_heading = "Results")]
    pub out: Option<PathBuf>,
    /// Roll and pitch of a robot that does not stay level: from the topic `attitude` of the camera in shared
    /// memory (`shm`), or those that a recording was made with (`recording`); needs --mount
    #[arg(long, value_name = "shm|recording", help_heading = "Camera")]
    pub attitude: Option<Text<AttitudeSource>>,
}

impl StreamArgs {
    /// As checked values. Opens nothing.
    fn config(&self, several: bool) -> anyhow::Result<CameraConfig> {
        let source = self.source.as_deref().map_or_else(SourceName::demo, SourceName::parse);
        let name = self.camera.as_deref().unwrap_or(source.properties().camera);
        self.checked(source.clone(), name).map_err(|error| in_camera(error, name, several))
    }

    fn checked(&self, source: SourceName, name: &str) -> anyhow::Result<CameraConfig> {
        let source = self.pace.config(source);
        source.check()?;
        let name = camera_name(name)?;
        let mount = value(&self.recording.mount.mount);
        if self.attitude == Some(Text(AttitudeSource::Recording)) && !source.name.properties().has_attitude {
            anyhow::bail!(BadArguments::new("--attitude recording needs a recording as the --source"));
        }
        let processing = self.processing.config(mount)?;
        let is_required = self.publish.contains(&Publish::Obstacles) || self.mavlink.is_some();
        let readers = value(&self.readers).map(|Readers(readers)| readers.get() as usize);
        Ok(CameraConfig {
            frame_id: frame_id(&name, value(&self.frame_id).map(|FrameId(name)| name))?,
            // The coordinate frame that a source states is not that of the rotated images.
            is_frame_id_chosen: self.frame_id.is_some() || processing.geometry.rotation.is_some(),
            name,
            source,
            obstacles: self.obstacles.config(mount, processing.pipeline.max_range_m, is_required)?,
            processing,
            mount,
            attitude: self.attitude(mount)?,
            mavlink: value(&self.mavlink),
            stability_limit: value(&self.stability_limit).unwrap_or_default(),
            publish: self.publish.clone(),
            readers: readers.unwrap_or(Limits::DEFAULT.max_readers),
            record: self.recording.config(),
            out: self.out.clone(),
        })
    }

    fn attitude(&self, mount: Option<MountOption>) -> Result<Option<AttitudeConfig>, BadArguments> {
        let config = |source| Ok(AttitudeConfig { source, mount: mount_for("--attitude", mount)? });
        value(&self.attitude).map(config).transpose()
    }
}

/// Where frames come from.
#[derive(Debug, Args, Clone, Deserialize)]
pub struct SourceArgs {
    /// `max` takes every frame as fast as possible; a number of frames per second drops old frames like a
    /// camera. For a V4L2 camera, the requested rate [default: max; 30 for a V4L2 camera]
    #[arg(long, value_name = "max|HZ")]
    pub rate: Option<Text<Rate>>,
    /// Start again at the end of the images, the recording or the demo
    #[arg(long = "loop")]
    #[serde(rename = "loop")]
    pub repeat: bool,
    /// The image topic of the recording, if it has several
    #[arg(long, value_name = "TOPIC")]
    pub topic: Option<String>,
    /// The size of raw images from stdin or exec:COMMAND, pixels; for a V4L2 camera, the requested size
    /// [default: 640x480 for a V4L2 camera]
    #[arg(long, value_name = "WxH")]
    pub size: Option<Text<ImageSize>>,
    /// The format of raw images from stdin or exec:COMMAND: rgb8, bgr8, mono8, yuyv or nv12; needs --size
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<Text<PixelFormat>>,
    /// The exposure time of a V4L2 camera, microseconds, or `auto` [default: as the camera is set]
    #[arg(long, value_name = "auto|MICROSECONDS")]
    pub exposure: Option<Text<CameraSetting>>,
    /// The gain of a V4L2 camera, in the driver's own steps, or `auto` [default: as the camera is set]
    #[arg(long, value_name = "auto|N")]
    pub gain: Option<Text<CameraSetting>>,
    /// Stop after N frames
    #[arg(long, value_name = "N")]
    pub frames: Option<Text<NonZeroU64>>,
}

impl SourceArgs {
    /// As checked values.
    pub(crate) fn config(&self, name: SourceName) -> SourceConfig {
        SourceConfig {
            name,
            rate: value(&self.rate),
            repeat: self.repeat,
            topic: self.topic.clone(),
            size: value(&self.size),
            format: value(&self.format),
            settings: CameraSettings { exposure: value(&self.exposure), gain: value(&self.gain) },
            frames: value(&self.frames),
        }
    }
}
