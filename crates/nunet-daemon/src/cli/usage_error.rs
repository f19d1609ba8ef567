//! Mistakes on the command line.

use std::ffi::OsString;

use nunet_types::split_hint;

use crate::config::LogOptions;
use crate::{exit, logging};

/// Prints clap's message and returns the exit code (help and version are no failure). `arguments` may request
/// JSON even if the rest of them is wrong.
pub(crate) fn exit_code_of(error: &clap::Error, arguments: &[OsString]) -> u8 {
    if !error.use_stderr() || !asks_for_json_log(arguments) {
        // Printing fails only if stderr is closed.
        let _ = error.print();
        return if error.use_stderr() { exit::BAD_ARGUMENTS } else { exit::DONE };
    }
    logging::start(LogOptions { verbose: 0, quiet: false, json: true });
    let text = error.render().to_string();
    let (text, hint) = split_hint(message_of(&text));
    exit::log_bad_arguments(text, hint)
}

/// A message of clap without `error:` and the usage.
fn message_of(text: &str) -> &str {
    let text = text.trim_start_matches("error: ");
    let frame = ["\n\nUsage", "\n\nFor more information"].iter().filter_map(|start| text.find(start)).min();
    text[..frame.unwrap_or(text.len())].trim_end()
}

/// Whether a command line asks for `--log-format json`.
fn asks_for_json_log(arguments: &[OsString]) -> bool {
    let follows = |pair: &[OsString]| pair[0] == "--log-format" && pair[1] == "json";
    arguments.iter().any(|argument| argument == "--log-format=json") || arguments.windows(2).any(follows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_without_what_clap_puts_around_it() {
        let plain = "error: no such value\nhint: take another\n\nFor more information, try '--help'.\n";
        assert_eq!(message_of(plain), "no such value\nhint: take another");
        let usage = "error: no such flag\n\nUsage: nunetd\n\nFor more information, try '--help'.\n";
        assert_eq!(message_of(usage), "no such flag");
    }
}
