//! `nunetd` as a library: everything the binary does, so that the Python package can offer the same command.
//!
//! The entry point is [`main`]: arguments -> [`cli`] -> [`config`] -> one of the [`subcommands`]. A stream of
//! frames runs through [`source`] -> the loop in [`stream`] -> [`sink`]; modules import in the order
//! [`config`], [`sink`], [`stream`], subcommands, [`cli`], never the other way.

pub mod cli;
pub mod config;
mod exit;
mod logging;
pub mod sink;
pub mod stream;
mod subcommands;
mod version;

use std::ffi::OsString;
use std::io::Write as _;
use std::process::ExitCode;

pub use exit::Outcome;
use nunet_source as source;

/// Runs the command line `arguments` (the program's name first) and returns its exit code.
///
/// Data goes to stdout, messages to stderr. Exit codes: 0 done, 1 failure, 2 bad arguments, 3 finished but
/// frames were lost, 130 interrupted twice.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    stream::survive_size_limits(); // not in a host program, whose signals are its own
    exit_code(arguments).into()
}

/// As [`main`], for a host program that sets the exit code itself.
pub fn exit_code(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let cli = match cli::Cli::parse_line(arguments.clone()) {
        Ok(cli) => cli,
        Err(error) => return cli::exit_code_of(&error, &arguments),
    };
    let log = cli.logging.options();
    logging::start(log);
    let code = exit::from_result(cli::dispatch(cli.subcommand), log.json);
    // A binary flushes at its end, a host program may not. If the reader is gone, the subcommand has reported
    // it.
    let _ = std::io::stdout().flush();
    code
}
