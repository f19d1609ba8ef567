//! `nunetd check-model` (hidden): the child process of the model check.

use std::io::Write as _;

use nunet_engine::{EngineErrorKind, Refusal, check_model_in_this_process};

use crate::Outcome;
use crate::cli::VetArgs;
use crate::engine::options;
use crate::exit::message_and_hints;

/// Loads and self-tests a model within limits. A refusal is one JSON object on stdout, and an error as usual.
pub(super) fn check_model(arguments: &VetArgs) -> anyhow::Result<Outcome> {
    let checked =
        check_model_in_this_process(&arguments.model, arguments.hash.clone(), options(&arguments.engine));
    let Err(error) = checked else { return Ok(Outcome::Done) };
    let kind = error.kind();
    let error = anyhow::Error::from(error);
    writeln!(std::io::stdout(), "{}", refusal(kind, &error).to_json())?;
    Err(error)
}

fn refusal(kind: EngineErrorKind, error: &anyhow::Error) -> Refusal {
    let (message, hints) = message_and_hints(error);
    Refusal::new(kind, message, (!hints.is_empty()).then(|| hints.join("\nhint: ")))
}
