//! The command line as clap sees it. The subcommands make checked values from it.
#![expect(missing_docs, reason = "a doc comment on a flattened group would become its help text")]

use std::ffi::OsString;
use std::num::{NonZeroU32, NonZeroU64, NonZeroUsize};
use std::path::PathBuf;
use std::str::FromStr;

use clap::builder::{OsStringValueParser, TypedValueParser as _};
use clap::{Args, CommandFactory as _, FromArgMatches as _, Parser, Subcommand, ValueEnum};
use nunet_core::graph::Provider;

use crate::options::LogOptions;

mod config;
mod eval;
mod filter;
mod lens;
mod record;
#[cfg(test)]
mod reference;
mod run;

pub use config::ConfigArgs;
pub use eval::{DepthUnitArgs, EvalArgs, ProtocolArg};
pub use filter::FilterArgs;
pub use lens::{CameraArgs, FocalArg, GeometryArgs, LensArgs};
pub use record::{RecordArgs, ReplayArgs};
pub use run::{AccessArgs, RunArgs, SourceArgs, StreamArgs};

/// The model that runs when none is named.
pub const DEFAULT_MODEL: &str = "wnet_c.onnx";

/// Turns one camera into a depth sensor
///
/// nunetd runs a neural network on the images of a camera and publishes depth maps, labels and point clouds in shared memory.
///
/// Without a subcommand, nunetd runs the subcommand `run`: see `nunetd run --help` for its flags.
#[derive(Debug, Parser)]
#[command(name = "nunetd", version, subcommand_required = true)]
pub struct Cli {
    #[command(flatten)]
    pub logging: LogArgs,
    #[command(subcommand)]
    pub subcommand: SubcommandArgs,
}

impl Cli {
    /// Parses a command line, the program's name first.
    ///
    /// # Errors
    /// What clap has to say: a mistake, or the help that was asked for.
    pub fn parse_line(arguments: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        let mut arguments: Vec<_> = arguments.into_iter().collect();
        if let Some(place) = place_of_default_subcommand(&arguments) {
            refuse_unknown_subcommand(arguments.get(place))?;
            arguments.insert(place, "run".into());
        }
        let mut command = Self::command();
        if arguments.iter().any(|argument| argument == "--version") {
            // clap keeps the text for the life of the process.
            command = command.long_version(&*crate::version::long().leak());
        }
        let lines = config::expand(command.clone(), arguments)?;
        let matches = lines.into_iter().map(|line| command.try_get_matches_from_mut(line));
        let matches = matches.collect::<Result<Vec<_>, _>>()?;
        let parsed = matches.iter().map(Self::from_arg_matches).collect::<Result<Vec<_>, _>>();
        let mut parsed = parsed.map_err(|error| error.format(&mut command))?.into_iter();
        let no_line = || command.clone().error(clap::error::ErrorKind::ValueValidation, "no camera to run");
        let mut cli = parsed.next().ok_or_else(no_line)?;
        if let Some(run) = cli.subcommand.run_mut() {
            run.others =
                parsed.filter_map(|mut other| Some(other.subcommand.run_mut()?.stream.clone())).collect();
        }
        if let SubcommandArgs::Config(config) = &mut cli.subcommand {
            config.effective = config::effective(&command, &matches);
        }
        Ok(cli)
    }
}

/// `run` takes flags only, so a bare word in its place is a subcommand that does not exist.
fn refuse_unknown_subcommand(argument: Option<&OsString>) -> Result<(), clap::Error> {
    match argument.map(|word| word.to_string_lossy()) {
        Some(word) if !word.starts_with('-') => {
            let mut command = Cli::command();
            let subcommands: Vec<_> =
                command.get_subcommands().filter(|subcommand| !subcommand.is_hide_set()).collect();
            let names: Vec<_> =
                subcommands.iter().map(|subcommand| subcommand.get_name().to_owned()).collect();
            let message =
                format!("`{word}` is not a subcommand of nunetd\nhint: one of {}", names.join(", "));
            Err(command.error(clap::error::ErrorKind::InvalidSubcommand, message))
        }
        _ => Ok(()),
    }
}

/// Where `run` is to be put in; `None` if a subcommand, help or the version is given.
///
/// clap's own way (flattening the arguments of the default subcommand into the program's) would refuse `nunetd -q infer ...`.
fn place_of_default_subcommand(arguments: &[OsString]) -> Option<usize> {
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
pub enum SubcommandArgs {
    /// Publish depth of a camera in shared memory (the default)
    Run(Box<RunArgs>),
    /// Write depth, labels and cloud of single images as files
    Infer(InferArgs),
    /// Publish the frames of a source in shared memory, as a camera driver does
    Feed(FeedArgs),
    /// Print what a running nunetd publishes
    Watch(WatchArgs),
    /// Describe a model file
    Inspect(InspectArgs),
    /// Check this machine, ONNX Runtime and the model; print a fix for each problem
    Doctor(DoctorArgs),
    /// Print the shared-memory contract
    Contract(ContractArgs),
    /// Measure the latency of predictions, as in Table 2 of the paper
    Bench(BenchArgs),
    /// Find the fastest provider and number of threads for a model on this machine
    Tune(TuneArgs),
    /// Re-run a recording through the model into another recording, deterministically
    Replay(Box<ReplayArgs>),
    /// Measure the accuracy of a model against images with known depth
    Eval(Box<EvalArgs>),
    /// Check the flags and the configuration file of `run`, and print the resulting configuration
    Config(Box<ConfigArgs>),
    /// Load a model in this process and test it (what `run` does in a child before it trusts a file)
    #[command(hide = true, name = "check-model")]
    Vet(VetArgs),
}

impl SubcommandArgs {
    /// What `run` is to do, for the subcommands that take its arguments.
    fn run_mut(&mut self) -> Option<&mut RunArgs> {
        match self {
            Self::Run(run) => Some(run),
            Self::Config(config) => Some(&mut config.run),
            _ => None,
        }
    }
}

/// How much is logged, and how.
#[derive(Debug, Args, Clone)]
pub struct LogArgs {
    /// Log more to stderr; repeat for a span per frame
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    pub verbose: u8,
    /// Log errors only
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// The format of log lines and fatal errors
    #[arg(long, value_enum, default_value_t = LogFormat::Text, global = true)]
    pub log_format: LogFormat,
}

impl LogArgs {
    /// As checked values.
    #[must_use]
    pub fn options(&self) -> LogOptions {
        LogOptions { verbose: self.verbose, quiet: self.quiet, json: self.log_format == LogFormat::Json }
    }
}

/// Whether a command line asks for `--log-format json`, also if the rest of it is wrong.
pub(crate) fn asks_for_json_log(arguments: &[OsString]) -> bool {
    let follows = |pair: &[OsString]| pair[0] == "--log-format" && pair[1] == "json";
    arguments.iter().any(|argument| argument == "--log-format=json") || arguments.windows(2).any(follows)
}

/// How log lines look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// Lines for people.
    Text,
    /// One JSON object per line.
    Json,
}

/// A count; what the standard library says of a bad one speaks of its types.
fn count<N: FromStr>(text: &str) -> Result<N, String> {
    text.parse().map_err(|_| format!("expected a whole number of 1 or more, got `{text}`"))
}

/// What runs the networks.
#[derive(Debug, Args, Clone)]
pub struct EngineArgs {
    /// The execution provider: auto, cpu, openvino, cuda or tensorrt
    #[arg(long, default_value_t = Provider::Auto, value_parser = crate::exit::parsed::<Provider>)]
    pub provider: Provider,
    /// Threads per prediction, at most four per core [default: one per core]
    #[arg(long, value_name = "N", value_parser = count::<NonZeroUsize>)]
    pub threads: Option<NonZeroUsize>,
    /// The shared library of ONNX Runtime [default: searched]
    #[arg(long, value_name = "PATH", env = "ORT_DYLIB_PATH", value_parser = OsStringValueParser::new().map(PathBuf::from))]
    pub onnxruntime: Option<PathBuf>,
}

/// `nunetd infer`
#[derive(Debug, Args, Clone)]
pub struct InferArgs {
    /// JPEG or PNG images, folders with images, or globs
    #[arg(required = true, value_name = "IMAGE|DIR|GLOB")]
    pub images: Vec<PathBuf>,
    /// The folder for the results; several images get a folder each below it
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// An .onnx file, a staged graph (.toml), or the name of a bundled model
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
    /// demo, a folder, a glob of images, a recording FILE.mcap, a camera /dev/videoN, or - for stdin
    pub source: String,
    /// The name of the camera in shared memory
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
    /// The name of the camera in shared memory
    pub camera: String,
    /// Print one JSON object per frame
    #[arg(long)]
    pub json: bool,
    /// Stop after N frames
    #[arg(long, value_name = "N", value_parser = count::<NonZeroU64>)]
    pub frames: Option<NonZeroU64>,
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
    #[arg(long, required = true)]
    pub json: bool,
}

/// `nunetd bench`
#[derive(Debug, Args, Clone)]
pub struct BenchArgs {
    /// A model to measure; several are measured interleaved
    #[arg(long, value_name = "NAME|PATH", default_value = DEFAULT_MODEL)]
    pub model: Vec<PathBuf>,
    /// The image to predict from [default: the first of the demo scene]
    #[arg(long, value_name = "IMAGE")]
    pub image: Option<PathBuf>,
    /// The number of predictions
    #[arg(long, value_name = "N", default_value = "100", value_parser = count::<NonZeroU32>)]
    pub runs: NonZeroU32,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub engine: EngineArgs,
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
    #[arg(long, value_name = "N", default_value = "50", value_parser = count::<NonZeroU32>)]
    pub runs: NonZeroU32,
    /// Write the fastest combination as a file for `--config`
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// `nunetd check-model`
#[derive(Debug, Args, Clone)]
pub struct VetArgs {
    /// The model file
    pub model: PathBuf,
    /// SHA-256 of a file that may be loaded, hexadecimal; any file where none is given
    #[arg(long, value_name = "SHA256", value_parser = parse_hash)]
    pub hash: Vec<[u8; 32]>,
    #[command(flatten)]
    pub engine: EngineArgs,
}

fn parse_hash(text: &str) -> Result<[u8; 32], String> {
    let digits = |index: usize| text.get(2 * index..2 * index + 2);
    let byte = |index: usize| u8::from_str_radix(digits(index)?, 16).ok();
    let bytes: Option<Vec<u8>> = (0..text.len().div_ceil(2)).map(byte).collect();
    let hash = bytes.and_then(|bytes| bytes.try_into().ok());
    hash.ok_or_else(|| format!("expected 64 hexadecimal digits, got `{text}`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Cli {
        Cli::parse_line(line.split(' ').map(OsString::from)).unwrap()
    }

    #[test]
    fn hashes_are_64_hexadecimal_digits() {
        assert_eq!(parse_hash(&"0f".repeat(32)), Ok([15; 32]));
        for wrong in ["", "0f", &"0".repeat(63), &"0".repeat(66), &"0g".repeat(32), &"ß".repeat(32)] {
            assert!(parse_hash(wrong).unwrap_err().ends_with(&format!("got `{wrong}`")));
        }
    }

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn without_a_subcommand_it_is_run_wherever_the_logging_flags_stand() {
        for line in
            ["nunetd", "nunetd -q", "nunetd --model a.onnx -v", "nunetd -vv --log-format json --model a.onnx"]
        {
            assert!(matches!(parse(line).subcommand, SubcommandArgs::Run(_)), "{line}");
        }
    }

    #[test]
    fn logging_flags_may_stand_before_and_behind_a_subcommand() {
        for line in
            ["nunetd -q inspect m.onnx", "nunetd inspect m.onnx -q", "nunetd --log-format=json -q inspect m"]
        {
            let cli = parse(line);
            assert!(cli.logging.quiet && matches!(cli.subcommand, SubcommandArgs::Inspect(_)), "{line}");
        }
    }

    #[test]
    fn an_unknown_subcommand_is_answered_with_the_known_ones() {
        let error =
            Cli::parse_line(["nunetd", "inferr", "x.jpg"].map(OsString::from)).unwrap_err().to_string();
        assert!(
            error.contains("`inferr` is not a subcommand of nunetd\nhint: one of run, infer, feed,"),
            "{error}"
        );
        assert!(!error.contains("check-model"), "{error}");
    }

    #[test]
    fn numbers_and_addresses_that_are_none_are_told_with_what_is_expected() {
        let count = "expected a whole number of 1 or more, got `0`";
        for (line, part) in [
            ("nunetd --frames 0", count),
            ("nunetd --cloud-stride 0", count),
            ("nunetd --threads 0", count),
            ("nunetd bench --runs 0", count),
            ("nunetd watch front --frames 0", count),
            ("nunetd --readers 0", "expected 1 to 62, got `0`"),
            ("nunetd --metrics 9477", "expected ADDRESS:PORT, such as `127.0.0.1:9477`, got `9477`"),
        ] {
            let error = Cli::parse_line(line.split(' ').map(OsString::from)).unwrap_err();
            assert_eq!(error.exit_code(), 2, "{line}");
            assert!(error.to_string().contains(part), "{error}");
        }
        let address = "nunetd --metrics [::1]:9477".split(' ').map(OsString::from);
        assert!(Cli::parse_line(address).is_ok());
    }

    #[test]
    fn help_and_version_are_those_of_the_program() {
        for line in ["nunetd --help", "nunetd -V", "nunetd help bench"] {
            let error = Cli::parse_line(line.split(' ').map(OsString::from)).unwrap_err();
            assert!(!error.use_stderr(), "{line}");
        }
    }
}
