//! The command line as clap sees it. Checked values are made from it in the verbs.
#![expect(missing_docs, reason = "a doc comment on a flattened group would become its help text")]

use std::ffi::OsString;
use std::num::{NonZeroU32, NonZeroU64, NonZeroUsize};
use std::path::PathBuf;

use clap::builder::{OsStringValueParser, TypedValueParser as _};
use clap::{Args, CommandFactory as _, FromArgMatches as _, Parser, Subcommand, ValueEnum};
use nunet_core::frame::PixelFormat;
use nunet_core::graph::Provider;

use crate::source::{Opening, PictureSize};

mod config;
mod eval;
mod filter;
mod lens;
mod record;

pub use config::ConfigArgs;
pub use eval::{DepthUnitArgs, EvalArgs, ProtocolArg, Window};
pub use filter::FilterArgs;
pub use lens::{CameraArgs, FocalArg, GeometryArgs, LensArgs};
pub use record::{MountArg, RecordArgs, ReplayArgs};

/// The model that runs when none is named.
pub const DEFAULT_MODEL: &str = "wnet_c.onnx";

/// One camera becomes a depth sensor.
///
/// Without a command, `nunetd` means `nunetd run`: see `nunetd run --help`.
#[derive(Debug, Parser)]
#[command(name = "nunetd", version, subcommand_required = true)]
pub struct Cli {
    #[command(flatten)]
    pub logging: LogArgs,
    #[command(subcommand)]
    pub verb: Verb,
}

impl Cli {
    /// Parses a command line, the program's name first.
    ///
    /// # Errors
    /// What clap has to say: a mistake, or the help that was asked for.
    pub fn parse_line(arguments: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        let mut arguments: Vec<_> = arguments.into_iter().collect();
        if let Some(place) = place_of_default_verb(&arguments) {
            refuse_unknown_verb(arguments.get(place))?;
            arguments.insert(place, "run".into());
        }
        let mut command = Self::command();
        let arguments = config::expand(command.clone(), arguments)?;
        let matches = command.try_get_matches_from_mut(arguments)?;
        let mut cli = Self::from_arg_matches(&matches).map_err(|error| error.format(&mut command))?;
        if let (Verb::Config(config), Some((verb, given))) = (&mut cli.verb, matches.subcommand()) {
            config.effective =
                command.find_subcommand(verb).map(|verb| config::effective(verb, given)).unwrap_or_default();
        }
        Ok(cli)
    }
}

/// `run` takes flags only, so a bare word in its place is a verb that does not exist.
fn refuse_unknown_verb(argument: Option<&OsString>) -> Result<(), clap::Error> {
    match argument.map(|word| word.to_string_lossy()) {
        Some(word) if !word.starts_with('-') => {
            let mut command = Cli::command();
            let verbs: Vec<_> = command.get_subcommands().filter(|verb| !verb.is_hide_set()).collect();
            let names: Vec<_> = verbs.iter().map(|verb| verb.get_name().to_owned()).collect();
            let message = format!("`{word}` is no command of nunetd\nhint: one of {}", names.join(", "));
            Err(command.error(clap::error::ErrorKind::InvalidSubcommand, message))
        }
        _ => Ok(()),
    }
}

/// Where `run` is to be put in; `None` where a verb, help or the version is asked for.
///
/// clap's own way (flattening the default verb's arguments into the program's) would refuse `nunetd -q infer ...`.
fn place_of_default_verb(arguments: &[OsString]) -> Option<usize> {
    let mut place = 1;
    while let Some(argument) = arguments.get(place).and_then(|argument| argument.to_str()) {
        let letters = argument.strip_prefix('-').filter(|letters| !letters.is_empty());
        match argument {
            "--log-format" => place += 2,
            "--verbose" | "--quiet" => place += 1,
            _ if argument.starts_with("--log-format=") => place += 1,
            _ if letters.is_some_and(|letters| letters.chars().all(|letter| "vq".contains(letter))) => {
                place += 1;
            }
            "help" | "-h" | "--help" | "-V" | "--version" => return None,
            _ if Cli::command().find_subcommand(argument).is_some() => return None,
            _ => break,
        }
    }
    Some(place.min(arguments.len()))
}

/// What `nunetd` can do.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Turn a source of frames into depth in shared memory (the default)
    Run(Box<RunArgs>),
    /// Depth, labels and cloud of single pictures, as files
    Infer(InferArgs),
    /// Publish a source's frames and its camera in shared memory, as a camera driver would
    Feed(FeedArgs),
    /// Show what a running daemon publishes
    Watch(WatchArgs),
    /// Say what a model file is
    Inspect(InspectArgs),
    /// Check this machine, the library and the model: every problem with its mend
    Doctor(DoctorArgs),
    /// Print the shared-memory contract
    Contract(ContractArgs),
    /// Measure predictions of one picture, as the paper's Table 2 does
    Bench(BenchArgs),
    /// Take a recording through the network into another recording, every frame, the same bytes each time
    Replay(Box<ReplayArgs>),
    /// Measure a model against pictures with true depth
    Eval(Box<EvalArgs>),
    /// Print what `run` would do with these flags and this file, as a file
    Config(Box<ConfigArgs>),
    /// Load a model in this process and test it (what `run` does in a child before it trusts a file)
    #[command(hide = true)]
    Vet(VetArgs),
}

/// How to speak to people.
#[derive(Debug, Args, Clone)]
pub struct LogArgs {
    /// More detail on stderr; twice for a span of every frame
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    pub verbose: u8,
    /// Errors only
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// How log lines look
    #[arg(long, value_enum, default_value_t = LogFormat::Text, global = true)]
    pub log_format: LogFormat,
}

/// How log lines look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// For people.
    Text,
    /// One JSON object a line.
    Json,
}

/// What runs the networks.
#[derive(Debug, Args, Clone)]
pub struct EngineArgs {
    /// What computes: auto, cpu, openvino, cuda or tensorrt
    #[arg(long, default_value_t = Provider::Auto)]
    pub provider: Provider,
    /// Threads of one prediction [default: one a core]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// ONNX Runtime's shared library
    #[arg(long, value_name = "PATH", env = "ORT_DYLIB_PATH", value_parser = OsStringValueParser::new().map(PathBuf::from))]
    pub onnxruntime: Option<PathBuf>,
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
    #[arg(long, value_name = "N")]
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
        }
    }
}

/// `nunetd run`
#[derive(Debug, Args, Clone)]
pub struct RunArgs {
    /// A file that says what flags say, each by its long name; flags win
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// An .onnx file, a staged graph's .toml, or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL)]
    pub model: PathBuf,
    /// demo, a folder, a glob of pictures, a recording FILE.mcap, a camera /dev/videoN, shm:CAMERA, or - for stdin
    /// [default: demo]
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
    #[arg(long, value_name = "N")]
    pub readers: Option<NonZeroU32>,
    /// Run a stage on each N-th frame and reuse its result in between
    #[arg(long, value_name = "STAGE=N", value_parser = parse_every)]
    pub every: Vec<(String, NonZeroU32)>,
    #[command(flatten)]
    pub engine: EngineArgs,
    #[command(flatten)]
    pub recording: RecordArgs,
    /// Write the last frame's depth, labels and cloud into this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Serve the frame ledger and the latencies to Prometheus, at http://ADDRESS:PORT/metrics
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub metrics: Option<std::net::SocketAddr>,
    /// Write the frame ledger and the latencies into this file at the end
    #[arg(long, value_name = "FILE")]
    pub stats_json: Option<PathBuf>,
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

/// `nunetd infer`
#[derive(Debug, Args, Clone)]
pub struct InferArgs {
    /// JPEG or PNG pictures
    #[arg(required = true, value_name = "IMAGE")]
    pub images: Vec<PathBuf>,
    /// Folder for the results (with several pictures: one folder below it for each)
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// An .onnx file, a staged graph's .toml, or the name of a bundled model
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL)]
    pub model: PathBuf,
    #[command(flatten)]
    pub optics: CameraArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// `nunetd feed`
#[derive(Debug, Args, Clone)]
pub struct FeedArgs {
    /// demo, a folder, a glob of pictures, a recording FILE.mcap, a camera /dev/videoN, or - for stdin
    pub source: String,
    /// Name of the camera in shared memory
    #[arg(long, value_name = "NAME")]
    pub camera: String,
    #[command(flatten)]
    pub pace: SourceArgs,
    #[command(flatten)]
    pub geometry: GeometryArgs,
}

/// `nunetd watch`
#[derive(Debug, Args, Clone)]
pub struct WatchArgs {
    /// Name of the camera in shared memory
    pub camera: String,
    /// One JSON object a frame
    #[arg(long)]
    pub json: bool,
    /// Stop after N frames
    #[arg(long, value_name = "N")]
    pub frames: Option<NonZeroU64>,
    /// Seconds to wait for the camera, and for each frame of it
    #[arg(long, value_name = "SECONDS", default_value = "10")]
    pub timeout: f64,
}

/// `nunetd inspect`
#[derive(Debug, Args, Clone)]
pub struct InspectArgs {
    /// An .onnx file, a staged graph's .toml, or the name of a bundled model
    pub model: PathBuf,
    /// The description as JSON
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
    /// The checks as JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// `nunetd contract`
#[derive(Debug, Args, Clone)]
pub struct ContractArgs {
    /// As JSON (the only form there is)
    #[arg(long, required = true)]
    pub json: bool,
}

/// `nunetd bench`
#[derive(Debug, Args, Clone)]
pub struct BenchArgs {
    /// Models to measure, interleaved
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL)]
    pub model: Vec<PathBuf>,
    /// The picture to predict from [default: the demo scene's first]
    #[arg(long, value_name = "IMAGE")]
    pub image: Option<PathBuf>,
    /// Predictions to measure
    #[arg(long, value_name = "N", default_value = "100")]
    pub runs: NonZeroU32,
    /// The result as JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// `nunetd vet`
#[derive(Debug, Args, Clone)]
pub struct VetArgs {
    /// The model file
    pub model: PathBuf,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// The bytes of a coordinate frame's name that fit into a message's header.
const MAX_FRAME_ID: usize = 64;

/// A name that is cut would be another coordinate frame.
fn parse_frame_id(text: &str) -> Result<String, String> {
    if text.is_empty() || text.len() > MAX_FRAME_ID {
        return Err(format!("expected 1 to {MAX_FRAME_ID} bytes, got {}", text.len()));
    }
    Ok(text.to_owned())
}

fn parse_every(text: &str) -> Result<(String, NonZeroU32), String> {
    let (stage, count) = text.split_once('=').ok_or("expected `STAGE=N`, such as `segmentation=3`")?;
    let count = count.parse().map_err(|_| format!("expected a count of 1 or more, got `{count}`"))?;
    Ok((stage.to_owned(), count))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Cli {
        Cli::parse_line(line.split(' ').map(OsString::from)).unwrap()
    }

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn without_a_verb_it_is_run_wherever_the_logging_flags_stand() {
        for line in
            ["nunetd", "nunetd -q", "nunetd --model a.onnx -v", "nunetd -vv --log-format json --model a.onnx"]
        {
            assert!(matches!(parse(line).verb, Verb::Run(_)), "{line}");
        }
    }

    #[test]
    fn logging_flags_may_stand_before_and_behind_a_verb() {
        for line in
            ["nunetd -q inspect m.onnx", "nunetd inspect m.onnx -q", "nunetd --log-format=json -q inspect m"]
        {
            let cli = parse(line);
            assert!(cli.logging.quiet && matches!(cli.verb, Verb::Inspect(_)), "{line}");
        }
    }

    #[test]
    fn a_word_that_is_no_verb_is_answered_with_the_verbs() {
        let error =
            Cli::parse_line(["nunetd", "inferr", "x.jpg"].map(OsString::from)).unwrap_err().to_string();
        assert!(
            error.contains("`inferr` is no command of nunetd\nhint: one of run, infer, feed,"),
            "{error}"
        );
        assert!(!error.contains("vet"), "{error}");
    }

    #[test]
    fn help_and_version_are_those_of_the_program() {
        for line in ["nunetd --help", "nunetd -V", "nunetd help bench"] {
            let error = Cli::parse_line(line.split(' ').map(OsString::from)).unwrap_err();
            assert!(!error.use_stderr(), "{line}");
        }
    }
}
