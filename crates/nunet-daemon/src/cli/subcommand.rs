//! The registry of subcommands: the line of each in the help, its arguments, and the call that runs it.

use clap::Subcommand;

use super::text::{Hash, Text, value};
use super::{CalibrateArgs, EvalArgs, ReplayArgs, RunCommand, arguments};
use crate::Outcome;
use crate::exit::camera_name;
use crate::subcommands::{
    bench, calibrate, check_model, config, contract, doctor, eval, feed, infer, inspect, replay, run, tune,
    watch,
};

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum SubcommandArgs {
    /// Publish depth of a camera in shared memory (the default)
    Run(Box<RunCommand>),
    /// Write depth, labels and cloud of single images as files
    Infer(arguments::InferArgs),
    /// Publish the frames of a source in shared memory, as a camera driver does
    Feed(arguments::FeedArgs),
    /// Print what a running nunetd publishes
    Watch(arguments::WatchArgs),
    /// Describe a model file
    Inspect(arguments::InspectArgs),
    /// Check this machine, ONNX Runtime and the model; print a fix for each problem
    Doctor(arguments::DoctorArgs),
    /// Print the shared-memory contract
    Contract(arguments::ContractArgs),
    /// Measure the latency of predictions, as in Table 2 of the paper
    Bench(arguments::BenchArgs),
    /// Find the fastest provider and number of threads for a model on this machine
    Tune(arguments::TuneArgs),
    /// Re-run a recording through the model into another recording, deterministically
    Replay(Box<ReplayArgs>),
    /// Measure the accuracy of a model against images with known depth
    Eval(Box<EvalArgs>),
    /// Measure the factor that scales the depth of a camera, and write it into its calibration file
    Calibrate(Box<CalibrateArgs>),
    /// Check the flags and the configuration file of `run`, and print the resulting configuration
    Config(Box<RunCommand>),
    /// Load a model in this process and test it (what `run` does in a child before it trusts a file)
    #[command(hide = true)]
    CheckModel(arguments::CheckModelArgs),
}

impl SubcommandArgs {
    /// The subcommand if it takes a configuration file.
    pub(super) fn configured(&mut self) -> Option<&mut RunCommand> {
        match self {
            Self::Run(run) | Self::Config(run) => Some(run),
            _ => None,
        }
    }
}

/// Runs a subcommand.
pub(crate) fn dispatch(subcommand: SubcommandArgs) -> anyhow::Result<Outcome> {
    match subcommand {
        SubcommandArgs::Run(args) => run::run(&args.config()?, || args.warn()),
        SubcommandArgs::Infer(args) => infer::infer(&args.options()?),
        SubcommandArgs::Feed(args) => feed::feed(&args.options()?),
        SubcommandArgs::Watch(args) => {
            watch::watch(&camera_name(&args.camera)?, args.json, value(&args.frames), args.timeout)
        }
        SubcommandArgs::Inspect(args) => inspect::inspect(&args.model, args.engine.options(), args.json),
        SubcommandArgs::Doctor(args) => doctor::doctor(&args.model, args.engine.options(), args.json),
        SubcommandArgs::Contract(args) => contract::contract(args.json),
        SubcommandArgs::Bench(args) => bench::bench(&args.options()),
        SubcommandArgs::Tune(args) => tune::tune(&args.options()),
        SubcommandArgs::Replay(args) => replay::replay(&args.options()?),
        SubcommandArgs::Calibrate(args) => calibrate::calibrate(&args.options()?),
        SubcommandArgs::Eval(args) => eval::eval(args.options()?),
        SubcommandArgs::Config(args) => {
            let config = args.config()?;
            config::config(&config, &args.effective(&config), || args.warn())
        }
        SubcommandArgs::CheckModel(args) => {
            let hashes = args.hash.into_iter().map(|Text(Hash(hash))| hash).collect();
            check_model::check_model(&args.model, hashes, args.engine.options())
        }
    }
}
