//! A command line without a subcommand is one of `run`.

use std::ffi::OsString;

use clap::{Command, CommandFactory as _};
use nunet_source::SourceName;
use nunet_types::join_hint;

use super::Cli;

/// Puts `run` where a subcommand is missing. A bare word in its place is a subcommand that does not exist.
pub(super) fn insert(arguments: &mut Vec<OsString>) -> Result<(), clap::Error> {
    if let Some(place) = place_of_default_subcommand(arguments) {
        refuse_unknown_subcommand(arguments.get(place))?;
        arguments.insert(place, "run".into());
    }
    Ok(())
}

/// `run` takes flags only, so a bare word in its place is a subcommand that does not exist.
fn refuse_unknown_subcommand(argument: Option<&OsString>) -> Result<(), clap::Error> {
    let word = argument.map(|word| word.to_string_lossy());
    let Some(word) = word.filter(|word| !word.starts_with('-')) else { return Ok(()) };
    let source = SourceName::parse(&word);
    let word = source.shown();
    let mut command = Cli::command();
    let hint = if word.contains(['/', '.', ':']) {
        format!("pass a source as --source {word}")
    } else {
        let shown = command.get_subcommands().filter(|subcommand| !subcommand.is_hide_set());
        format!("one of {}", shown.map(Command::get_name).collect::<Vec<_>>().join(", "))
    };
    let message = join_hint(format!("`{word}` is not a subcommand of nunetd"), hint);
    Err(command.error(clap::error::ErrorKind::InvalidSubcommand, message))
}

/// Where `run` is to be put in; `None` if a subcommand, help or the version is given.
///
/// clap's own way (flattening the arguments of the default subcommand into the program's) would refuse
/// `nunetd -q infer ...`.
fn place_of_default_subcommand(arguments: &[OsString]) -> Option<usize> {
    let mut place = 1;
    while let Some(argument) = arguments.get(place).and_then(|argument| argument.to_str()) {
        let letters = argument.strip_prefix('-').filter(|letters| !letters.is_empty());
        match argument {
            "--log-format" => place += 2,
            "--verbose" | "--quiet" => place += 1,
            _ if argument.starts_with("--log-format=") => place += 1,
            _ if letters.is_some_and(|letters| letters.chars().all(|letter| "vq".contains(letter))) => {
                place += 1;
            }
            "help" | "-h" | "--help" | "-V" | "--version" => return None,
            _ if Cli::command().find_subcommand(argument).is_some() => return None,
            _ => break,
        }
    }
    Some(place.min(arguments.len()))
}
