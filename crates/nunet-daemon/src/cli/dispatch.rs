//! From a subcommand's arguments to the subcommand.

use super::text::{Hash, Text, value};
use super::{BenchArgs, CheckModelArgs, FeedArgs, InferArgs, SubcommandArgs, TuneArgs, WatchArgs};
use crate::Outcome;
use crate::exit::camera_name;
use crate::source::SourceName;
use crate::subcommands::{
    bench, calibrate, check_model, config, contract, doctor, eval, feed, infer, inspect, replay, run, tune,
    watch,
};

/// Runs a subcommand.
pub(crate) fn dispatch(subcommand: SubcommandArgs) -> anyhow::Result<Outcome> {
    match subcommand {
        SubcommandArgs::Run(arguments) => run::run(&arguments.config()?),
        SubcommandArgs::Infer(arguments) => infer::infer(&arguments.options()?),
        SubcommandArgs::Feed(arguments) => feed::feed(&arguments.options()?),
        SubcommandArgs::Watch(WatchArgs { camera, json, frames, timeout }) => {
            watch::watch(&camera_name(&camera)?, json, value(&frames), timeout)
        }
        SubcommandArgs::Inspect(arguments) => {
            inspect::inspect(&arguments.model, arguments.engine.options(), arguments.json)
        }
        SubcommandArgs::Doctor(arguments) => {
            doctor::doctor(&arguments.model, arguments.engine.options(), arguments.json)
        }
        SubcommandArgs::Contract(arguments) => contract::contract(arguments.json),
        SubcommandArgs::Bench(arguments) => bench::bench(&arguments.options()),
        SubcommandArgs::Tune(arguments) => tune::tune(&arguments.options()),
        SubcommandArgs::Replay(arguments) => replay::replay(&arguments.options()?),
        SubcommandArgs::Calibrate(arguments) => calibrate::calibrate(&arguments.options()?),
        SubcommandArgs::Eval(arguments) => eval::eval(arguments.options()?),
        SubcommandArgs::Config(arguments) => {
            let config = arguments.config()?;
            config::config(&config, &arguments.effective(&config))
        }
        SubcommandArgs::CheckModel(CheckModelArgs { model, hash, engine }) => {
            let hashes = hash.into_iter().map(|Text(Hash(hash))| hash).collect();
            check_model::check_model(&model, hashes, engine.options())
        }
    }
}

impl InferArgs {
    fn options(self) -> anyhow::Result<infer::InferOptions> {
        let (mount, engine) = (value(&self.obstacles.mount), self.engine.options());
        let processing = self.processing.config(mount)?;
        let max_range_m = processing.pipeline.max_range_m;
        self.obstacles.check_mount(&processing.pipeline)?;
        let obstacles = self.obstacles.options.config(mount, max_range_m, self.obstacles.obstacles)?;
        let obstacles = obstacles.filter(|obstacles| obstacles.is_required);
        Ok(infer::InferOptions {
            images: self.images,
            out: self.out,
            model: self.model,
            processing,
            obstacles,
            engine,
        })
    }
}

impl FeedArgs {
    fn options(&self) -> anyhow::Result<feed::FeedOptions> {
        Ok(feed::FeedOptions {
            source: self.pace.config(SourceName::parse(&self.source)),
            camera: camera_name(&self.camera)?,
            geometry: self.geometry.options(),
        })
    }
}

impl BenchArgs {
    fn options(self) -> bench::BenchOptions {
        let (runs, engine) = (self.runs.0, self.engine.options());
        bench::BenchOptions { models: self.model, image: self.image, runs, engine, json: self.json }
    }
}

impl TuneArgs {
    fn options(self) -> tune::TuneOptions {
        let (runs, engine) = (self.runs.0, self.engine.options());
        let Self { model, image, out, json, .. } = self;
        tune::TuneOptions { model, image, runs, engine, out, json }
    }
}
