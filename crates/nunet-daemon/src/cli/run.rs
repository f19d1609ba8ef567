//! The arguments of `nunetd run`: those of a camera, of which there may be several, and those of all.

use std::net::SocketAddr;
use std::num::{NonZeroU32, NonZeroU64};
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use nunet_core::frame::PixelFormat;

use super::{CameraArgs, DEFAULT_MODEL, EngineArgs, RecordArgs, count};
use crate::source::{Opening, PictureSize};

/// `nunetd run`
#[derive(Debug, Args, Clone)]
pub struct RunArgs {
    /// A file that says what flags say, each by its long name; flags win
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// An .onnx file, a staged graph's .toml, or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL)]
    pub model: PathBuf,
    #[command(flatten)]
    pub stream: StreamArgs,
    /// The cameras of a file's `[[camera]]` sections but the first, which is `stream`.
    #[arg(skip)]
    pub others: Vec<StreamArgs>,
    /// Run a stage on each N-th frame and reuse its result in between
    #[arg(long, value_name = "STAGE=N", value_parser = parse_every)]
    pub every: Vec<(String, NonZeroU32)>,
    #[command(flatten)]
    pub engine: EngineArgs,
    #[command(flatten)]
    pub access: AccessArgs,
    /// Serve the frame ledger and the latencies to Prometheus, at http://ADDRESS:PORT/metrics
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = parse_address)]
    pub metrics: Option<SocketAddr>,
    /// Write the frame ledger and the latencies into this file at the end
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
    /// Let this group read, by name or number [default: only the own user]
    #[arg(long, value_name = "GROUP")]
    pub access_group: Option<String>,
    /// Mode of the payload in shared memory, octal: 0640, or 0660 for a group that writes as well [default: 0640]
    #[arg(long, value_name = "MODE", requires = "access_group", value_parser = parse_mode)]
    pub access_mode: Option<u32>,
}

/// What belongs to one camera: a key of a `[[camera]]` section each, in which `--camera` is `name`.
#[derive(Debug, Args, Clone)]
pub struct StreamArgs {
    /// demo, a folder, a glob of pictures, a recording FILE.mcap, a camera /dev/videoN, shm:CAMERA, or - for stdin
    /// [default: demo; with --config it must be said]
    #[arg(long, value_name = "SOURCE")]
    pub source: Option<String>,
    /// Name of the camera in shared memory [default: demo for the demo scene, else camera]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    #[command(flatten)]
    pub pace: SourceArgs,
    #[command(flatten)]
    pub optics: CameraArgs,
    /// Coordinate frame of depth and cloud [default: the camera's name and `_optical_frame`]
    #[arg(long, value_name = "NAME", value_parser = parse_frame_id)]
    pub frame_id: Option<String>,
    /// What may be read; labels and cloud cost nothing while nobody reads them
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Publish::Depth, Publish::Labels, Publish::Cloud])]
    pub publish: Vec<Publish>,
    /// Processes that may read at the same time; half as many the cloud [default: 4]. Memory is reserved for all
    #[arg(long, value_name = "N", value_parser = parse_readers)]
    pub readers: Option<NonZeroU32>,
    #[command(flatten)]
    pub recording: RecordArgs,
    /// Write the last frame's depth, labels and cloud into this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Where frames come from.
#[derive(Debug, Args, Clone)]
pub struct SourceArgs {
    /// `max` (every frame, as fast as it goes) or frames a second (latest wins) [default: max]; of a camera, the rate
    /// wished [default: 30]
    #[arg(long, value_name = "max|HZ")]
    pub rate: Option<crate::source::Rate>,
    /// Begin again at the end
    #[arg(long = "loop")]
    pub repeat: bool,
    /// The recording's topic with pictures, where it has several
    #[arg(long, value_name = "TOPIC")]
    pub topic: Option<String>,
    /// Size of raw pictures on stdin; of a camera, the size wished [default: 640x480]
    #[arg(long, value_name = "WxH")]
    pub size: Option<PictureSize>,
    /// Format of raw pictures on stdin: rgb8, bgr8, mono8, yuyv or nv12
    #[arg(long, value_name = "FORMAT", requires = "size")]
    pub format: Option<PixelFormat>,
    /// Stop after N frames
    #[arg(long, value_name = "N", value_parser = count::<NonZeroU64>)]
    pub frames: Option<NonZeroU64>,
}

impl SourceArgs {
    /// What the source's opening depends on.
    #[must_use]
    pub fn opening(&self) -> Opening<'_> {
        Opening {
            repeat: self.repeat,
            topic: self.topic.as_deref(),
            size: self.size.map(|PictureSize(width, height)| (width, height)),
            format: self.format,
            rate: self.rate,
            stopped: None,
        }
    }
}

/// A published topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Publish {
    /// The depth map; always published.
    Depth,
    /// Class indices.
    Labels,
    /// The organised point cloud.
    Cloud,
}

/// The bytes of a coordinate frame's name that fit into a message's header.
pub(crate) const MAX_FRAME_ID: usize = 64;

/// The most readers that fit into a camera's shared memory beside nunetd's own two (`--record`, `--out`).
const MAX_READERS: u32 = 62;

fn parse_readers(text: &str) -> Result<NonZeroU32, String> {
    let readers = text.parse().ok().filter(|readers: &NonZeroU32| readers.get() <= MAX_READERS);
    readers.ok_or_else(|| format!("expected 1 to {MAX_READERS}, got `{text}`"))
}

/// A name that is cut would be another coordinate frame.
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
