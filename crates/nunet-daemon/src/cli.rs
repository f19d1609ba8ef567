//! The clap structs of the command line, and the checked values made from them. The last module: it imports
//! all others, and only the entry of the program imports it.
//!
//! Arguments -> [`Cli`] -> (with `--config`, the file between defaults and flags) ->
//! [`Config`](crate::config::Config) or the options of a subcommand -> that subcommand. A new flag of `run`
//! is a field of a struct here, which makes it a key of the file as well, and a field of `config`.
#![expect(missing_docs, reason = "a doc comment on a flattened group would become its help text")]

use std::ffi::OsString;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::builder::{OsStringValueParser, TypedValueParser as _};
use clap::{ArgAction, Args, CommandFactory as _, FromArgMatches as _, Parser, ValueEnum};
use nunet_core::graph::Provider;
use nunet_engine::EngineOptions;
use serde::Deserialize;

use crate::config::LogOptions;

pub mod arguments;
mod calibrate;
mod default_subcommand;
mod eval;
mod file;
mod filter;
mod foxglove_args;
mod keys;
mod lens;
mod obstacles;
mod record;
mod run;
mod settings;
mod subcommand;
#[cfg(test)]
mod tests;
mod text;
mod usage_error;

pub use calibrate::CalibrateArgs;
pub use eval::{DepthUnitArgs, EvalArgs, ProtocolArg};
pub use filter::FilterArgs;
pub use foxglove_args::FoxgloveArgs;
pub use lens::{CameraArgs, FocalArg, GeometryArgs, LensArgs, ScaleArg};
pub use obstacles::{ImageObstacleArgs, ObstacleArgs};
pub use record::{RecordArgs, ReplayArgs};
pub use run::{AccessArgs, RunArgs, SourceArgs, StreamArgs};
pub use settings::RunCommand;
pub use subcommand::SubcommandArgs;
pub(crate) use subcommand::dispatch;
pub use text::Text;
pub(crate) use usage_error::exit_code_of;

/// The model that runs when none is named.
pub const DEFAULT_MODEL: &str = "wnet_c.onnx";

/// Turns one camera into a depth sensor
///
/// nunetd runs a neural network on the images of a camera and publishes depth maps, labels and point clouds
/// in shared memory.
///
/// Without a subcommand, nunetd runs the subcommand `run`: see `nunetd run --help` for its flags.
#[derive(Debug, Parser)]
// `run` is the default. clap's own flags for help and version would be above all headings.
#[command(name = "nunetd", version, override_usage = "nunetd [OPTIONS] [COMMAND]")]
#[command(disable_help_flag = true, disable_version_flag = true, next_help_heading = "Global options")]
pub struct Cli {
    #[command(flatten)]
    pub logging: LogArgs,
    /// Print help; -h prints a summary
    #[arg(short, long, action = ArgAction::Help, global = true)]
    pub help: Option<bool>,
    /// Print version
    #[arg(short = 'V', long, action = ArgAction::Version)]
    pub version: Option<bool>,
    #[command(subcommand)]
    pub subcommand: SubcommandArgs,
}

impl Cli {
    /// Parses a command line, the program's name first, and the configuration file that it names.
    ///
    /// # Errors
    /// The message of clap: a mistake, or the requested help.
    pub fn parse_line(arguments: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        let mut arguments: Vec<_> = arguments.into_iter().collect();
        default_subcommand::insert(&mut arguments)?;
        let mut command = Self::command().mut_subcommands(with_negative_numbers);
        if arguments.iter().any(|argument| argument == "--version") {
            // clap keeps the text for the life of the process.
            command = command.long_version(&*crate::version::long().leak());
        }
        let matches = command.try_get_matches_from_mut(&arguments);
        let matches = matches.map_err(|error| usage_error::with_fitting_tip(error, &command, &arguments))?;
        let mut cli = Self::from_arg_matches(&matches).map_err(|error| error.format(&mut command))?;
        let completed = (cli.subcommand.configured(), &mut cli.logging);
        settings::complete(completed, &mut command, &matches)?;
        Ok(cli)
    }
}

/// Accepts negative numbers as values of flags, so that the error states what is expected.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command.mut_args(|argument| {
        let is_option = argument.get_long().is_some() && argument.get_action().takes_values();
        argument.allow_negative_numbers(is_option)
    })
}

/// Log level and format.
#[derive(Debug, Args, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct LogArgs {
    /// Log more to stderr; repeat to log every frame
    #[arg(short, long, action = ArgAction::Count, global = true)]
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

/// The format of log lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// Plain text.
    Text,
    /// One JSON object per line.
    Json,
}

/// The options of the inference engine.
#[derive(Debug, Args, Clone, Deserialize)]
pub struct EngineArgs {
    /// The execution provider: auto, cpu, openvino, cuda or tensorrt
    #[arg(long, default_value = Provider::Auto.name())]
    pub provider: Text<Provider>,
    /// Threads per prediction, at most four per core [default: one per core]
    #[arg(long, value_name = "N")]
    pub threads: Option<Text<NonZeroUsize>>,
    /// The shared library of ONNX Runtime [default: searched]
    #[arg(long, value_name = "PATH", env = "ORT_DYLIB_PATH", value_parser = OsStringValueParser::new().map(PathBuf::from))]
    pub onnxruntime: Option<PathBuf>,
}

impl EngineArgs {
    /// As checked values.
    pub(crate) fn options(&self) -> EngineOptions {
        let Self { provider: Text(provider), threads, onnxruntime } = self.clone();
        EngineOptions { provider, threads: text::value(&threads), onnxruntime }
    }
}
