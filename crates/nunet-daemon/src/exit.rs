//! Exit codes, and the one place where an error chain is printed.

use std::process::ExitCode;

use nunet_ipc::CameraName;

/// How a verb ended that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Everything asked for was done.
    Done,
    /// Finished, but frames or data were lost; the counts have been printed.
    Lost,
}

/// An error of the arguments: exit code 2 instead of 1.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct BadArguments(pub(crate) String);

/// A camera's name as the user wrote it.
pub(crate) fn camera_name(name: &str) -> Result<CameraName, BadArguments> {
    CameraName::new(name).map_err(|error| BadArguments(error.to_string()))
}

const FAILURE: u8 = 1;
const BAD_ARGUMENTS: u8 = 2;
const LOST: u8 = 3;

/// Prints clap's message (help and version are no failure).
pub(crate) fn from_usage_error(error: &clap::Error) -> ExitCode {
    // Printing fails only when the terminal is gone: there is nobody left to tell.
    let _ = error.print();
    if error.use_stderr() { ExitCode::from(BAD_ARGUMENTS) } else { ExitCode::SUCCESS }
}

/// Prints the chain of a failure and picks the exit code.
pub(crate) fn from_result(result: anyhow::Result<Outcome>) -> ExitCode {
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Lost) => ExitCode::from(LOST),
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            print_chain(&error);
            let code = if error.is::<BadArguments>() { BAD_ARGUMENTS } else { FAILURE };
            ExitCode::from(code)
        }
    }
}

/// `nunetd watch front --json | head -1` is a success.
fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<std::io::Error>())
        .any(|cause| cause.kind() == std::io::ErrorKind::BrokenPipe)
}

#[expect(clippy::print_stderr, reason = "the one place where a failure is told to people")]
fn print_chain(error: &anyhow::Error) {
    // A message may end in a line `hint: ...`; hints belong after the last cause.
    let mut hints = Vec::new();
    for (depth, cause) in error.chain().enumerate() {
        let text = cause.to_string();
        let (body, hint) = match text.split_once("\nhint: ") {
            Some((body, hint)) => (body.to_owned(), Some(hint.to_owned())),
            None => (text, None),
        };
        eprintln!("{}{body}", if depth == 0 { "error: " } else { "  because: " });
        hints.extend(hint);
    }
    for hint in hints {
        eprintln!("hint: {hint}");
    }
}
