//! `nunetd` as a library: everything the binary does, so that the Python package can offer the same command.
//!
//! The way in is [`main`]: arguments -> [`cli`] -> one of the [`verbs`]. A stream of frames runs through
//! [`source`] -> the loop in [`stream`] -> [`sink`]; modules import in the order [`telemetry`], [`source`],
//! [`sink`], [`stream`], verbs, never the other way.

mod buffers;
pub mod cli;
mod engine;
mod exit;
#[doc(hidden)]
pub mod fuzzing;
mod library;
mod logging;
mod models;
pub mod sink;
pub mod source;
pub mod stream;
pub mod telemetry;
mod verbs;
mod vetting;
mod words;

use std::ffi::OsString;
use std::process::ExitCode;

pub use exit::Outcome;

/// Runs the command line `arguments` (the program's name first) and returns its exit code.
///
/// stdout is data, stderr is people. Exit codes: 0 done, 1 failure, 2 bad arguments, 3 finished but frames were
/// lost, 130 interrupted twice.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match cli::Cli::parse_line(arguments) {
        Ok(cli) => cli,
        Err(error) => return exit::from_usage_error(&error),
    };
    logging::start(&cli.logging);
    exit::from_result(verbs::dispatch(cli.verb))
}
