//! The configuration of nunetd as checked values. The command line ([`cli`](crate::cli)) makes them from
//! flags and a file; the other modules use these types and know neither clap nor TOML.

mod values;

use std::net::SocketAddr;
use std::num::{NonZeroU32, NonZeroU64};
use std::path::PathBuf;

use nunet_core::frame::PixelFormat;
use nunet_core::pipeline::PipelineOptions;
use nunet_engine::EngineOptions;
use nunet_foxglove::FoxgloveConfig;
use nunet_ipc::{CameraName, Limits};
use nunet_mavlink::MavlinkAddress;
use nunet_ros2::Ros2Options;
use nunet_source::{CameraGeometry, CameraSettings, OpenOptions, Rate, SourceName};
use nunet_types::ImageSize;
use nunet_view::{ViewConfig, overlapping_addresses};

pub use nunet_sink::attitude::{AttitudeConfig, AttitudeSource};
pub use nunet_sink::mount_option::MountOption;
pub use nunet_sink::obstacles::ObstacleConfig;
pub use nunet_sink::stability::StabilityLimit;
pub use nunet_types::{MAX_FRAME_ID, default_frame_id};
pub use values::{LogOptions, Publish};

use crate::exit::BadArguments;

/// The configuration of `nunetd run`.
#[derive(Debug, Clone)]
pub struct Config {
    /// The file that it comes from, if there is one.
    pub file: Option<PathBuf>,
    /// The network.
    pub model: ModelConfig,
    /// The inference engine.
    pub engine: EngineOptions,
    /// The cameras; at least one.
    pub cameras: Vec<CameraConfig>,
    /// The outputs for all cameras together.
    pub outputs: OutputConfig,
}

/// The network of a run.
#[derive(Debug, Clone)]
pub struct ModelConfig {
    /// A file, or the name of a bundled model.
    pub path: PathBuf,
    /// Stages that run only on every n-th frame.
    pub every: Vec<(String, NonZeroU32)>,
}

/// One camera and the processing of its frames.
#[derive(Debug, Clone)]
pub struct CameraConfig {
    /// The name in shared memory.
    pub name: CameraName,
    /// Where its frames come from.
    pub source: SourceConfig,
    /// Its lens, and the processing of its depth.
    pub processing: ProcessingConfig,
    /// The coordinate frame of depth and cloud, unless the source states another; at most [`MAX_FRAME_ID`]
    /// bytes.
    pub frame_id: String,
    /// Whether it replaces that of the source: the user chose it, or the images are rotated.
    pub is_frame_id_chosen: bool,
    /// Its pose on the robot.
    pub mount: Option<MountOption>,
    /// The settings of obstacles; `None` without a mount.
    pub obstacles: Option<ObstacleConfig>,
    /// Where the attitude of the robot comes from, if it pitches or rolls.
    pub attitude: Option<AttitudeConfig>,
    /// The drift or flicker of depth above which a warning is logged.
    pub stability_limit: StabilityLimit,
    /// The autopilot that obstacles are sent to.
    pub mavlink: Option<MavlinkAddress>,
    /// The topics that can be read.
    pub publish: Vec<Publish>,
    /// The number of processes that can read at a time.
    pub readers: usize,
    /// What is recorded.
    pub record: Option<RecordConfig>,
    /// The folder for the files of the last frame.
    pub out: Option<PathBuf>,
}

impl CameraConfig {
    /// How its source is opened.
    #[must_use]
    pub fn open_options(&self) -> OpenOptions<'_> {
        OpenOptions {
            rotation: self.processing.geometry.rotation,
            has_frame_id: self.is_frame_id_chosen,
            ..self.source.open_options()
        }
    }

    /// The limits of its shared memory. Clouds are by far the largest messages: half as many processes can
    /// read them.
    #[must_use]
    pub fn limits(&self) -> Limits {
        let max_cloud_readers = self.readers.div_ceil(2);
        Limits { max_readers: self.readers, max_cloud_readers, ..Limits::default() }
    }
}

/// Where frames come from.
#[derive(Debug, Clone)]
pub struct SourceConfig {
    /// Which source.
    pub name: SourceName,
    /// Frames per second, or every frame.
    pub rate: Option<Rate>,
    /// Restart at the end.
    pub repeat: bool,
    /// The image topic, if a recording has several.
    pub topic: Option<String>,
    /// The size of raw images, or the requested size.
    pub size: Option<ImageSize>,
    /// The format of raw images.
    pub format: Option<PixelFormat>,
    /// Exposure and gain of a camera.
    pub settings: CameraSettings,
    /// Stop after this many frames.
    pub frames: Option<NonZeroU64>,
}

impl SourceConfig {
    /// How the source is opened.
    #[must_use]
    pub fn open_options(&self) -> OpenOptions<'_> {
        OpenOptions {
            repeat: self.repeat,
            topic: self.topic.as_deref(),
            size: self.size,
            format: self.format,
            rate: self.rate,
            camera_settings: self.settings,
            ..OpenOptions::default()
        }
    }

    /// Checks that the kind of source takes these options. Opens nothing.
    pub(crate) fn check(&self) -> anyhow::Result<()> {
        let is_pace_chosen = self.rate.is_some() || self.repeat;
        if let Some(reason) = self.name.properties().own_pace.filter(|_| is_pace_chosen) {
            let message = format!("--rate and --loop are for files: {reason}");
            let hint = "pass them to the publisher of the images, such as `nunetd feed` or `ros2 bag play`";
            anyhow::bail!(BadArguments::new(message).with_hint(hint));
        }
        Ok(self.name.check(&self.open_options())?)
    }
}

/// The lens, and the processing of depth.
#[derive(Debug, Clone, Default)]
pub struct ProcessingConfig {
    /// Intrinsics or calibration, if known.
    pub geometry: CameraGeometry,
    /// Focal correction, filters and cloud.
    pub pipeline: PipelineOptions,
}

/// A recording to write.
#[derive(Debug, Clone)]
pub struct RecordConfig {
    /// A file, or a folder for a new file.
    pub path: PathBuf,
    /// Overwrite an existing file.
    pub force: bool,
    /// Record raw images as PNG.
    pub lossless: bool,
}

/// The outputs for all cameras together.
#[derive(Debug, Clone, Default)]
pub struct OutputConfig {
    /// The group that can read shared memory.
    pub access: Option<AccessConfig>,
    /// The address of the Prometheus endpoint.
    pub metrics: Option<SocketAddr>,
    /// The live view in the browser.
    pub view: Option<ViewConfig>,
    /// Topics of ROS 2.
    pub ros2: Ros2Options,
    /// The server for Foxglove.
    pub foxglove: Option<FoxgloveConfig>,
    /// The file for frame counts and latencies.
    pub stats_json: Option<PathBuf>,
}

impl OutputConfig {
    /// The addresses that servers listen on, each with its flag.
    pub(crate) fn addresses(&self) -> Vec<(&'static str, SocketAddr)> {
        let view = self.view.as_ref().map(|view| ("--view", view.address));
        let metrics = self.metrics.map(|address| ("--metrics", address));
        let foxglove = self.foxglove.map(|foxglove| ("--foxglove", foxglove.address));
        [view, metrics, foxglove].into_iter().flatten().collect()
    }

    /// Refuses two servers at one address.
    pub(crate) fn check(&self) -> Result<(), BadArguments> {
        let Some([one, other]) = overlapping_addresses(&self.addresses()) else { return Ok(()) };
        let error = BadArguments::new(format!("{one} and {other} listen on the same address and port"));
        Err(error.with_hint("choose another port for one of them"))
    }
}

/// The users who may read shared memory, besides this one.
#[derive(Debug, Clone)]
pub struct AccessConfig {
    /// A group, by name or number.
    pub group: String,
    /// The file mode, if it is not the default.
    pub mode: Option<u32>,
}

/// The coordinate frame of depth and cloud: the configured one, or the camera's default.
pub(crate) fn frame_id(camera: &CameraName, named: Option<String>) -> Result<String, BadArguments> {
    let frame_id = named.unwrap_or_else(|| default_frame_id(camera.as_str()));
    if frame_id.len() <= MAX_FRAME_ID {
        return Ok(frame_id);
    }
    let message = format!(
        "the coordinate frame `{frame_id}` of camera `{camera}` is {} bytes long; expected at most {MAX_FRAME_ID}",
        frame_id.len()
    );
    Err(BadArguments::new(message)
        .with_hint("name another by `--frame-id`, or give the camera a shorter name"))
}
