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
use crate::cli::Verb;

/// Runs a subcommand.
pub(crate) fn dispatch(verb: Verb) -> anyhow::Result<Outcome> {
    match verb {
        Verb::Run(arguments) => run::run(*arguments),
        Verb::Infer(arguments) => infer::infer(&arguments),
        Verb::Feed(arguments) => feed::feed(&arguments),
        Verb::Watch(arguments) => watch::watch(&arguments),
        Verb::Inspect(arguments) => inspect::inspect(&arguments),
        Verb::Doctor(arguments) => doctor::doctor(&arguments),
        Verb::Contract(_) => contract::contract(),
        Verb::Bench(arguments) => bench::bench(&arguments),
        Verb::Tune(arguments) => tune::tune(&arguments),
        Verb::Replay(arguments) => replay::replay(&arguments),
        Verb::Eval(arguments) => eval::eval(&arguments),
        Verb::Config(arguments) => config::config(&arguments),
        Verb::Vet(arguments) => check_model::check_model(&arguments),
    }
}
