//! What `nunetd` can do, one file per subcommand.

mod bench;
mod check_model;
mod config;
mod contract;
mod doctor;
mod eval;
mod feed;
mod infer;
mod inspect;
mod progress;
mod replay;
mod run;
mod tune;
mod watch;

use crate::Outcome;
use crate::cli::SubcommandArgs;

/// Runs a subcommand.
pub(crate) fn dispatch(subcommand: SubcommandArgs) -> anyhow::Result<Outcome> {
    match subcommand {
        SubcommandArgs::Run(arguments) => run::run(*arguments),
        SubcommandArgs::Infer(arguments) => infer::infer(&arguments),
        SubcommandArgs::Feed(arguments) => feed::feed(&arguments),
        SubcommandArgs::Watch(arguments) => watch::watch(&arguments),
        SubcommandArgs::Inspect(arguments) => inspect::inspect(&arguments),
        SubcommandArgs::Doctor(arguments) => doctor::doctor(&arguments),
        SubcommandArgs::Contract(_) => contract::contract(),
        SubcommandArgs::Bench(arguments) => bench::bench(&arguments),
        SubcommandArgs::Tune(arguments) => tune::tune(&arguments),
        SubcommandArgs::Replay(arguments) => replay::replay(&arguments),
        SubcommandArgs::Eval(arguments) => eval::eval(&arguments),
        SubcommandArgs::Config(arguments) => config::config(&arguments),
        SubcommandArgs::Vet(arguments) => check_model::check_model(&arguments),
    }
}
