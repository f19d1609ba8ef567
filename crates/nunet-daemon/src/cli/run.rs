//! The flags of `nunetd run`: those of a camera, of which there may be several, and those for all cameras.

use std::net::SocketAddr;
use std::num::{NonZeroU32, NonZeroU64};
use std::path::PathBuf;

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use nunet_core::frame::PixelFormat;

use super::{CameraArgs, DEFAULT_MODEL, EngineArgs, RecordArgs, count};
use crate::options::{MAX_FRAME_ID, Publish};
use nunet_types::ImageSize;

use crate::source::OpenOptions;

/// `nunetd run`
#[derive(Debug, Args, Clone)]
pub struct RunArgs {
    /// A configuration file whose keys are the long names of flags; flags take precedence
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// An .onnx file, a staged graph (.toml), or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL)]
    pub model: PathBuf,
    #[command(flatten)]
    pub stream: StreamArgs,
    /// The cameras of a file's `[[camera]]` sections but the first, which is `stream`.
    #[arg(skip)]
    pub others: Vec<StreamArgs>,
    /// Run a stage only on every N-th frame and reuse its result in between
    #[arg(long, value_name = "STAGE=N", value_parser = parse_every)]
    pub every: Vec<(String, NonZeroU32)>,
    #[command(flatten)]
    pub engine: EngineArgs,
    #[command(flatten)]
    pub access: AccessArgs,
    /// Serve Prometheus metrics at http://ADDRESS:PORT/metrics
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = parse_address)]
    pub metrics: Option<SocketAddr>,
    /// Write frame counts and latencies into this file at the end
    #[arg(long, value_name = "FILE")]
    pub stats_json: Option<PathBuf>,
}

impl RunArgs {
    /// Each camera's, one at least.
    pub fn streams(&self) -> impl Iterator<Item = &StreamArgs> {
        std::iter::once(&self.stream).chain(&self.others)
    }
}

/// Who may read.
#[derive(Debug, Args, Clone, Default)]
pub struct AccessArgs {
    /// The group that may read, by name or number [default: only this user]
    #[arg(long, value_name = "GROUP")]
    pub access_group: Option<String>,
    /// The octal file mode of shared memory: 0640, or 0660 if the group writes as well [default: 0640]
    #[arg(long, value_name = "MODE", requires = "access_group", value_parser = parse_mode)]
    pub access_mode: Option<u32>,
}

/// The options of one camera: the keys of a `[[camera]]` section, in which `--camera` is `name`.
#[derive(Debug, Args, Clone)]
pub struct StreamArgs {
    /// demo, a folder, a glob of images, a recording FILE.mcap, a camera /dev/videoN, shm:CAMERA, or - for stdin
    /// [default: demo; required with --config]
    #[arg(long, value_name = "SOURCE")]
    pub source: Option<String>,
    /// The name of the camera in shared memory [default: demo for the demo scene, otherwise camera]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    #[command(flatten)]
    pub pace: SourceArgs,
    #[command(flatten)]
    pub optics: CameraArgs,
    /// The coordinate frame of depth and cloud [default: the name of the camera + `_optical_frame`]
    #[arg(long, value_name = "NAME", value_parser = parse_frame_id)]
    pub frame_id: Option<String>,
    /// The topics that can be read; labels and cloud are computed only while something reads them
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Publish::Depth, Publish::Labels, Publish::Cloud])]
    pub publish: Vec<Publish>,
    /// The number of processes that may read at a time; half as many may read the cloud. Memory is reserved for all
    /// [default: 4]
    #[arg(long, value_name = "N", value_parser = parse_readers)]
    pub readers: Option<NonZeroU32>,
    #[command(flatten)]
    pub recording: RecordArgs,
    /// Write depth, labels and cloud of the last frame into this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Where frames come from.
#[derive(Debug, Args, Clone)]
pub struct SourceArgs {
    /// `max` processes every frame as fast as possible; a number of frames per second drops old frames like a camera. For a
    /// camera, the requested rate [default: max; 30 for a camera]
    #[arg(long, value_name = "max|HZ")]
    pub rate: Option<crate::source::Rate>,
    /// Restart at the end
    #[arg(long = "loop")]
    pub repeat: bool,
    /// The image topic of the recording, if it has several
    #[arg(long, value_name = "TOPIC")]
    pub topic: Option<String>,
    /// The size of raw images on stdin; for a camera, the requested size [default: 640x480 for a camera]
    #[arg(long, value_name = "WxH")]
    pub size: Option<ImageSize>,
    /// The format of raw images on stdin: rgb8, bgr8, mono8, yuyv or nv12
    #[arg(long, value_name = "FORMAT", requires = "size")]
    pub format: Option<PixelFormat>,
    /// Stop after N frames
    #[arg(long, value_name = "N", value_parser = count::<NonZeroU64>)]
    pub frames: Option<NonZeroU64>,
}

impl SourceArgs {
    /// How the source is opened.
    #[must_use]
    pub fn open_options(&self) -> OpenOptions<'_> {
        OpenOptions {
            repeat: self.repeat,
            topic: self.topic.as_deref(),
            size: self.size,
            format: self.format,
            rate: self.rate,
            ..OpenOptions::default()
        }
    }
}

impl ValueEnum for Publish {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.name()))
    }
}

/// The most readers that fit into the shared memory of a camera.
const MAX_READERS: u32 = 62;

fn parse_readers(text: &str) -> Result<NonZeroU32, String> {
    let readers = text.parse().ok().filter(|readers: &NonZeroU32| readers.get() <= MAX_READERS);
    readers.ok_or_else(|| format!("expected 1 to {MAX_READERS}, got `{text}`"))
}

/// A truncated name would be another coordinate frame.
pub(super) fn parse_frame_id(text: &str) -> Result<String, String> {
    if text.is_empty() || text.len() > MAX_FRAME_ID {
        return Err(format!("expected 1 to {MAX_FRAME_ID} bytes, got {}", text.len()));
    }
    Ok(text.to_owned())
}

fn parse_address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| format!("expected ADDRESS:PORT, such as `127.0.0.1:9477`, got `{text}`"))
}

fn parse_mode(text: &str) -> Result<u32, String> {
    u32::from_str_radix(text, 8)
        .map_err(|_| format!("expected an octal number such as \"0640\", got `{text}`"))
}

fn parse_every(text: &str) -> Result<(String, NonZeroU32), String> {
    let (stage, count) = text.split_once('=').ok_or("expected `STAGE=N`, such as `segmentation=3`")?;
    let count = count.parse().map_err(|_| format!("expected a count of 1 or more, got `{count}`"))?;
    Ok((stage.to_owned(), count))
}
