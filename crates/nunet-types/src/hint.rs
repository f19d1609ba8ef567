//! What a user can do about an error, kept apart from the error's text.

use std::borrow::Cow;
use std::error::Error;
use std::fmt::Display;
use std::io;

/// An error that can say what to do about it.
///
/// Front ends (the command line, Python, C) print the hint on a line of its own after the error. `Display` of
/// an error never contains its hint, and a library's hint names no command line flag: the front end knows
/// those.
pub trait Hint {
    /// One imperative sentence, lower case, without a full stop: ``pass a size of 640x480``. `None` if there
    /// is nothing that a user could do.
    fn hint(&self) -> Option<Cow<'static, str>>;

    /// The setting that the hint is about, as the configuration file names it: `topic`. Front ends add how
    /// they spell it: the command line `--topic`.
    fn setting(&self) -> Option<&'static str> {
        None
    }

    /// Whether a value that the user chose is at fault: the command line exits with 2 instead of 1 then.
    fn is_usage(&self) -> bool {
        false
    }
}

/// The hint for an address that a server cannot listen on. `example` is an address that it can.
#[must_use]
pub fn hint_of_listen(error: &io::Error, example: &str) -> Option<Cow<'static, str>> {
    match error.kind() {
        io::ErrorKind::AddrInUse => {
            Some("choose another port, or stop the program that uses this one".into())
        }
        io::ErrorKind::PermissionDenied => Some("choose a port above 1023".into()),
        io::ErrorKind::AddrNotAvailable => {
            Some(format!("choose an address of this machine, such as {example}").into())
        }
        _ => None,
    }
}

/// Between an error and each of its causes, where all are one text of several lines.
pub const CAUSE_MARK: &str = "\n  because: ";

/// An error and its causes in one line: `cannot read a.png: it is cut off`.
#[must_use]
pub fn text_with_causes(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text.push_str(": ");
        text.push_str(&error.to_string());
        cause = error.source();
    }
    text
}

/// Between a text and its hint, where both must be one text.
const HINT_MARK: &str = "\nhint: ";

/// A text and its hint in one text, for front ends that have no separate place for the hint: it is a last
/// line that begins with `hint: `.
#[must_use]
pub fn join_hint(text: impl Display, hint: impl Display) -> String {
    format!("{text}{HINT_MARK}{hint}")
}

/// A text and its hints, if it came through an interface that carries one text only. Several hints are one
/// per line.
#[must_use]
pub fn split_hint(text: &str) -> (&str, Option<String>) {
    match text.split_once(HINT_MARK) {
        Some((text, hints)) => (text, Some(hints.replace(HINT_MARK, "\n"))),
        None => (text, None),
    }
}

/// An error and its hint in one text, as [`join_hint`] writes it.
#[must_use]
pub fn text_with_hint<E: Error + Hint>(error: &E) -> String {
    match error.hint() {
        Some(hint) => join_hint(error, hint),
        None => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hint_is_split_from_a_text() {
        let text = join_hint(join_hint("it is cut off", "copy it again"), "pass another file");
        assert_eq!(split_hint(&text), ("it is cut off", Some("copy it again\npass another file".to_owned())));
        assert_eq!(split_hint("the hint: look"), ("the hint: look", None));
    }
}
