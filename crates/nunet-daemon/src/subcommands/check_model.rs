//! `nunetd check-model` (hidden): the child process of the model check.

use std::path::Path;

use nunet_engine::{EngineErrorKind, EngineOptions, Refusal, check_model_in_this_process};

use crate::Outcome;
use crate::exit::message_and_hints;
use nunet_sink::stdout::print;

/// Loads and self-tests a model within limits. A refusal is one JSON object on stdout, and an error as usual.
pub(crate) fn check_model(
    model: &Path,
    hashes: Vec<[u8; 32]>,
    engine: EngineOptions,
) -> anyhow::Result<Outcome> {
    let Err(error) = check_model_in_this_process(model, hashes, engine) else { return Ok(Outcome::Done) };
    let (kind, details) = (error.kind(), error.details().map(str::to_owned));
    let error = anyhow::Error::from(error);
    print(refusal(kind, &error).with_details(details.as_deref()).to_json())?;
    Err(error)
}

fn refusal(kind: EngineErrorKind, error: &anyhow::Error) -> Refusal {
    let (message, hints) = message_and_hints(error);
    Refusal::new(kind, message, (!hints.is_empty()).then(|| hints.join("; ")))
}
