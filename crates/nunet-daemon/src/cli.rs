//! The command line as clap sees it. Checked values are made from it in the verbs.
#![expect(missing_docs, reason = "a doc comment on a flattened group would become its help text")]

use std::ffi::OsString;
use std::num::{NonZeroU32, NonZeroU64, NonZeroUsize};
use std::path::PathBuf;
use std::str::FromStr;

use clap::builder::{OsStringValueParser, TypedValueParser as _};
use clap::{Args, CommandFactory as _, FromArgMatches as _, Parser, Subcommand, ValueEnum};
use nunet_core::graph::Provider;

mod config;
mod eval;
mod filter;
mod lens;
mod record;
mod run;

pub use config::ConfigArgs;
pub use eval::{DepthUnitArgs, EvalArgs, ProtocolArg, Window};
pub use filter::FilterArgs;
pub use lens::{CameraArgs, FocalArg, GeometryArgs, LensArgs};
pub use record::{MountArg, RecordArgs, ReplayArgs};
pub(crate) use run::MAX_FRAME_ID;
pub use run::{AccessArgs, Publish, RunArgs, SourceArgs, StreamArgs};

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
        if let Some(run) = cli.verb.run_mut() {
            run.others = parsed.filter_map(|mut other| Some(other.verb.run_mut()?.stream.clone())).collect();
        }
        if let Verb::Config(config) = &mut cli.verb {
            config.effective = config::effective(&command, &matches);
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
    /// Find out which provider and how many threads are fastest for a model on this machine
    Tune(TuneArgs),
    /// Take a recording through the network into another recording, every frame, the same bytes each time
    Replay(Box<ReplayArgs>),
    /// Measure a model against pictures with true depth
    Eval(Box<EvalArgs>),
    /// Check what `run` would do with these flags and this file, and print it with all defaults, as a file
    Config(Box<ConfigArgs>),
    /// Load a model in this process and test it (what `run` does in a child before it trusts a file)
    #[command(hide = true, name = "check-model")]
    Vet(VetArgs),
}

impl Verb {
    /// What `run` is to do, of the verbs that take its arguments.
    fn run_mut(&mut self) -> Option<&mut RunArgs> {
        match self {
            Self::Run(run) => Some(run),
            Self::Config(config) => Some(&mut config.run),
            _ => None,
        }
    }
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

/// A count; what the standard library says of a bad one speaks of its types.
fn count<N: FromStr>(text: &str) -> Result<N, String> {
    text.parse().map_err(|_| format!("expected a whole number of 1 or more, got `{text}`"))
}

/// What runs the networks.
#[derive(Debug, Args, Clone)]
pub struct EngineArgs {
    /// What computes: auto, cpu, openvino, cuda or tensorrt
    #[arg(long, default_value_t = Provider::Auto, value_parser = crate::exit::parsed::<Provider>)]
    pub provider: Provider,
    /// Threads of one prediction, at most four a core [default: one a core]
    #[arg(long, value_name = "N", value_parser = count::<NonZeroUsize>)]
    pub threads: Option<NonZeroUsize>,
    /// ONNX Runtime's shared library
    #[arg(long, value_name = "PATH", env = "ORT_DYLIB_PATH", value_parser = OsStringValueParser::new().map(PathBuf::from))]
    pub onnxruntime: Option<PathBuf>,
}

/// `nunetd infer`
#[derive(Debug, Args, Clone)]
pub struct InferArgs {
    /// JPEG or PNG pictures, folders of them, or globs
    #[arg(required = true, value_name = "IMAGE|DIR|GLOB")]
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
    #[arg(long, value_name = "N", value_parser = count::<NonZeroU64>)]
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
    #[arg(long, value_name = "N", default_value = "100", value_parser = count::<NonZeroU32>)]
    pub runs: NonZeroU32,
    /// The result as JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// `nunetd tune`
#[derive(Debug, Args, Clone)]
pub struct TuneArgs {
    /// An .onnx file, a staged graph's .toml, or the name of a bundled model
    #[arg(value_name = "NAME|PATH")]
    pub model: PathBuf,
    /// The picture to predict from [default: the demo scene's first]
    #[arg(long, value_name = "IMAGE")]
    pub image: Option<PathBuf>,
    /// Predictions to measure, of each way
    #[arg(long, value_name = "N", default_value = "50", value_parser = count::<NonZeroU32>)]
    pub runs: NonZeroU32,
    /// Write the fastest way as a configuration, which `--config` reads
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// The result as JSON
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
