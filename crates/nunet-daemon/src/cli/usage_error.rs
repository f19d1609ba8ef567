//! Mistakes on the command line.

use std::borrow::Cow;
use std::ffi::OsString;
use std::io::Write as _;
use std::path::Path;

use clap::Command;
use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use nunet_source::SourceName;
use nunet_types::{printable, split_hint};

use crate::config::LogOptions;
use crate::{Outcome, exit, logging};
use nunet_sink::stdout::StdoutError;

/// The lowest similarity at which a flag is suggested. At clap's own, `--exposure` is suggested for
/// `--source`.
const LEAST_LIKENESS: f64 = 0.88;

/// Replaces clap's tip for an unexpected argument. The shell may have put the name of a file in place of a
/// glob, the subcommand may take the argument without a flag, and what clap suggests may be another flag
/// altogether.
pub(super) fn with_fitting_tip(mut error: clap::Error, command: &Command, line: &[OsString]) -> clap::Error {
    let subcommand = line.iter().find_map(|name| command.find_subcommand(name)).cloned();
    let (ErrorKind::UnknownArgument, Some(mut subcommand)) = (error.kind(), subcommand) else { return error };
    let word = error.get(ContextKind::InvalidArg).map(ToString::to_string).unwrap_or_default();
    let name = word.strip_prefix("--").unwrap_or_default();
    let is_like = |known: &str| strsim::jaro_winkler(known, name) >= LEAST_LIKENESS;
    let tip = if Path::new(&word).exists() {
        Some("quote a glob, as in 'images/*.jpg'; `run` takes its source by --source".to_owned())
    } else {
        let own = subcommand.get_positionals().find(|argument| is_like(argument.get_id().as_str()));
        own.map(|argument| format!("`{}` takes {argument} without a flag", subcommand.get_name()))
    };
    let is_far = |flag: &ContextValue| !is_like(flag.to_string().trim_start_matches("--"));
    if tip.is_some() || error.get(ContextKind::SuggestedArg).is_some_and(is_far) {
        error.remove(ContextKind::SuggestedArg);
        // clap's usage has the flag that it suggests.
        error.insert(ContextKind::Usage, ContextValue::StyledStr(subcommand.render_usage()));
    }
    if let Some(tip) = tip {
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
    error
}

/// Prints clap's message and returns the exit code (help and version are no failure). `arguments` may request
/// JSON even if the rest of them is wrong.
pub(crate) fn exit_code_of(error: &clap::Error, arguments: &[OsString]) -> u8 {
    let is_json = asks_for_json_log(arguments);
    if !error.use_stderr() {
        let printed = error.print().and_then(|()| std::io::stdout().flush()).map_err(StdoutError::from);
        return exit::from_result(printed.map(|()| Outcome::Done).map_err(Into::into), is_json);
    }
    let text = plain_text(error, arguments);
    if !is_json {
        // Printing fails only if stderr is closed.
        let _ = std::io::stderr().write_all(text.as_bytes());
        return exit::BAD_ARGUMENTS;
    }
    logging::start(LogOptions { verbose: 0, quiet: false, json: true });
    let (text, hint) = split_hint(message_of(&text));
    exit::log_bad_arguments(text, hint)
}

/// A message of clap without its colors, which an argument could imitate. Control characters of arguments are
/// escaped.
fn plain_text(error: &clap::Error, arguments: &[OsString]) -> String {
    // As clap quotes those that are not UTF-8.
    let arguments: Vec<_> = arguments.iter().map(|argument| argument.to_string_lossy()).collect();
    let parts = arguments.iter().flat_map(|text| text.split(['=', ',']));
    let text = printable::with_parts_on_one_line(&error.render().ansi().to_string(), parts);
    let text = printable::lines(&StyledStr::from(text).to_string()).into_owned();
    // One of them may be a source in the wrong place.
    let sources = arguments.iter().filter(|argument| !argument.starts_with('-'));
    sources.map(|source| SourceName::parse(source)).fold(text, |text, source| match source.shown() {
        Cow::Owned(shown) => text.replace(source.as_str(), &shown),
        Cow::Borrowed(_) => text,
    })
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
    use std::os::unix::ffi::OsStringExt as _;

    use super::*;

    #[test]
    fn an_argument_cannot_control_the_terminal_or_add_a_line() {
        for line in [
            &["--rate", "a\u{1b}[31m\nhint: b\u{7}"][..],
            &["--rate=a\u{1b}[31m\nhint: b\u{7}"],
            &["--publish", "depth,a\u{1b}[31m\nhint: b\u{7}"],
            &["--a\u{1b}[31m\nhint: b\u{7}"],
            &["a\u{1b}[31m\nhint: b\u{7}"],
        ] {
            let arguments: Vec<OsString> = ["nunetd"].iter().chain(line).map(OsString::from).collect();
            let error = super::super::Cli::parse_line(arguments.clone()).unwrap_err();
            let text = plain_text(&error, &arguments);
            assert!(text.contains("a\\u001b[31m\\nhint: b\\u0007"), "{text}");
            assert!(!text.contains(['\u{1b}', '\u{7}']) && text.starts_with("error: "), "{text}");
        }
    }

    #[test]
    fn an_argument_that_is_not_utf8_is_escaped_too() {
        let arguments = ["nunetd".into(), OsString::from_vec(b"--a\xff\x1b[31m\nhint: b".to_vec())];
        let error = super::super::Cli::parse_line(arguments.clone()).unwrap_err();
        let text = plain_text(&error, &arguments);
        assert!(text.contains("--a\u{fffd}\\u001b[31m\\nhint: b"), "{text}");
    }

    #[test]
    fn a_tip_fits_the_argument_or_there_is_none() {
        let message = |line: &str| {
            let arguments = line.split(' ').map(OsString::from);
            super::super::Cli::parse_line(arguments).unwrap_err().to_string()
        };
        for (line, tip) in [
            ("nunetd watch --camera front", "`watch` takes <CAMERA> without a flag"),
            ("nunetd feed --source demo", "`feed` takes <SOURCE> without a flag"),
            ("nunetd infer --image a.png", "`infer` takes <IMAGE|DIR|GLOB>... without a flag"),
            ("nunetd run --sorce demo", "a similar argument exists: '--source'"),
            ("nunetd --output files", "a similar argument exists: '--out'"),
        ] {
            assert!(message(line).contains(&format!("tip: {tip}\n")), "{line}: {}", message(line));
        }
        for line in ["nunetd run --video 0", "nunetd feed demo --name front", "nunetd inspect a --stream b"] {
            let text = message(line);
            assert!(!text.contains("similar") && text.contains("[OPTIONS]"), "{line}: {text}");
        }
        assert!(!message("nunetd feed --source demo").contains("exposure"));
    }

    #[test]
    fn a_message_is_without_what_clap_puts_around_it() {
        let plain = "error: no such value\nhint: take another\n\nFor more information, try '--help'.\n";
        assert_eq!(message_of(plain), "no such value\nhint: take another");
        let usage = "error: no such flag\n\nUsage: nunetd\n\nFor more information, try '--help'.\n";
        assert_eq!(message_of(usage), "no such flag");
    }
}
