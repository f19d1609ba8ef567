//! What a user can do about an error, kept apart from the error's text.

use std::borrow::Cow;
use std::error::Error;

/// An error that can say what to do about it.
///
/// Front ends (the command line, Python, C) print the hint on a line of its own after the error. `Display` of an error
/// never contains its hint, and a library's hint names no command line flag: the front end knows those.
pub trait Hint {
    /// One imperative sentence, lower case, without a full stop: ``pass a size of 640x480``. `None` if there is nothing
    /// that a user could do.
    fn hint(&self) -> Option<Cow<'static, str>>;
}

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

/// An error and its hint in one text, for front ends that have no separate place for it: the hint is a last line that
/// begins with `hint: `.
#[must_use]
pub fn text_with_hint<E: Error + Hint>(error: &E) -> String {
    match error.hint() {
        Some(hint) => format!("{error}\nhint: {hint}"),
        None => error.to_string(),
    }
}
