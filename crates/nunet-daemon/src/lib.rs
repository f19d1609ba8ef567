//! `nunetd` as a library: everything the binary does, so that the Python package can offer the same command.
//!
//! The way in is [`main`]: arguments -> [`cli`] -> one of the [`subcommands`]. A stream of frames runs through
//! [`source`] -> the loop in [`stream`] -> [`sink`]; modules import in the order [`telemetry`], [`source`],
//! [`sink`], [`stream`], subcommands, never the other way.

mod buffers;
pub mod cli;
pub mod embed;
mod engine;
mod exit;
#[doc(hidden)]
pub mod fuzzing;
mod logging;
pub mod sink;
pub mod source;
pub mod stream;
mod subcommands;
pub mod telemetry;
mod version;
mod words;

use std::ffi::OsString;
use std::io::Write as _;
use std::process::ExitCode;

pub use exit::Outcome;

/// Runs the command line `arguments` (the program's name first) and returns its exit code.
///
/// stdout is data, stderr is people. Exit codes: 0 done, 1 failure, 2 bad arguments, 3 finished but frames were
/// lost, 130 interrupted twice.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    exit_code(arguments).into()
}

/// The same, for a host that has exit codes of its own.
pub fn exit_code(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let cli = match cli::Cli::parse_line(arguments) {
        Ok(cli) => cli,
        Err(error) => return exit::from_usage_error(&error),
    };
    logging::start(&cli.logging);
    let code = exit::from_result(subcommands::dispatch(cli.verb));
    // A binary's end does it by itself, another host's does not: a last line without its end would be lost. A reader that
    // went away is told of by the verb, or is none.
    let _ = std::io::stdout().flush();
    code
}
