//! Exit codes, and the one place where an error chain is printed.

use std::io::Write as _;

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

/// Something named that is not there: an error of the arguments, which programs that this one is a part of tell from others.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct NotFound(pub(crate) String);

/// A camera's name as the user wrote it.
pub(crate) fn camera_name(name: &str) -> Result<CameraName, BadArguments> {
    CameraName::new(name).map_err(|error| BadArguments(error.to_string()))
}

const DONE: u8 = 0;
const FAILURE: u8 = 1;
const BAD_ARGUMENTS: u8 = 2;
const LOST: u8 = 3;

/// Prints clap's message (help and version are no failure).
pub(crate) fn from_usage_error(error: &clap::Error) -> u8 {
    // Printing fails only when the terminal is gone: there is nobody left to tell.
    let _ = error.print();
    if error.use_stderr() { BAD_ARGUMENTS } else { DONE }
}

/// Prints the chain of a failure and picks the exit code.
pub(crate) fn from_result(result: anyhow::Result<Outcome>) -> u8 {
    match result {
        Ok(Outcome::Done) => DONE,
        Ok(Outcome::Lost) => LOST,
        Err(error) if is_closed_pipe(&error) => DONE,
        Err(error) => {
            print_chain(&error);
            if error.is::<BadArguments>() || error.is::<NotFound>() { BAD_ARGUMENTS } else { FAILURE }
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

/// The one place where a failure is told to people. A stderr that is gone has nobody behind it.
fn print_chain(error: &anyhow::Error) {
    let mut stderr = std::io::stderr().lock();
    let _ = stderr.write_all(chain_text(error).as_bytes());
}

/// One line a cause, hints behind the last.
pub(crate) fn chain_text(error: &anyhow::Error) -> String {
    let (mut text, mut hints, mut before) = (String::new(), String::new(), String::new());
    for (depth, cause) in error.chain().enumerate() {
        let cause = cause.to_string();
        let (body, hint) = cause.split_once("\nhint: ").unwrap_or((&cause, ""));
        // Some libraries repeat their cause within their own message.
        if depth == 0 || !before.contains(body.trim()) {
            let start = if depth == 0 { "error: " } else { "  because: " };
            text += &format!("{start}{}\n", lines_without_gaps(body));
        }
        if !hint.is_empty() {
            hints += &format!("hint: {hint}\n");
        }
        before = body.to_owned();
    }
    text + &hints
}

fn lines_without_gaps(text: &str) -> String {
    text.lines().map(str::trim_end).filter(|line| !line.is_empty()).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hints_follow_the_last_cause_and_repeated_causes_are_told_once() {
        let error = anyhow::anyhow!("bits are missing")
            .context("cannot decode:\n\nbits are missing\nhint: get it again")
            .context("cannot read `a.jpg`");
        assert_eq!(
            chain_text(&error),
            "error: cannot read `a.jpg`\n  because: cannot decode:\nbits are missing\nhint: get it again\n"
        );
    }
}
