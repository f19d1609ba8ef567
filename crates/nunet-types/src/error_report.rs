//! An error as front ends print it: its causes and their hints.

use std::borrow::Cow;
use std::error::Error;
use std::iter::successors;

use crate::hint::{CAUSE_MARK, Hint, join_hint};
use crate::printable;

/// One error of a chain as a [`Hint`], if the error is of a certain type. A front end has a list of them for
/// all types that it knows.
pub type AsHint = for<'a> fn(&'a (dyn Error + 'static)) -> Option<&'a dyn Hint>;

/// The [`AsHint`] of the type `E`.
#[must_use]
pub fn as_hint<'a, E: Error + Hint + 'static>(error: &'a (dyn Error + 'static)) -> Option<&'a dyn Hint> {
    error.downcast_ref::<E>().map(|error| -> &dyn Hint { error })
}

fn find_hint<'a>(error: &'a (dyn Error + 'static), hints: &[AsHint]) -> Option<&'a dyn Hint> {
    hints.iter().find_map(|as_hint| as_hint(error))
}

/// Whether a value that the user chose is at fault ([`Hint::is_usage`]), by the error or one of its causes.
#[must_use]
pub fn is_usage(error: &(dyn Error + 'static), hints: &[AsHint]) -> bool {
    let mut chain = successors(Some(error), |&error| error.source());
    chain.any(|cause| find_hint(cause, hints).is_some_and(|hint| hint.is_usage()))
}

/// A library's hint, completed by the flag of the setting that it is about:
/// `name one of the topics (--topic)`.
#[must_use]
pub fn flag_hint(error: &(impl Hint + ?Sized)) -> Option<Cow<'static, str>> {
    let hint = error.hint()?;
    Some(match error.setting() {
        Some(setting) => format!("{hint} (--{setting})").into(),
        None => hint,
    })
}

/// An error, its causes and the hints of all of them, without control characters in names ([`printable`]).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ErrorReport {
    /// The error, then what caused it. A cause that the error before it repeats is omitted.
    pub causes: Vec<String>,
    /// The hints, in the order of the causes.
    pub hints: Vec<String>,
}

impl ErrorReport {
    /// The report of an error. `hints` has the types of errors whose hints are found.
    #[must_use]
    pub fn of(error: &(dyn Error + 'static), hints: &[AsHint]) -> Self {
        let mut report = Self { causes: Vec::new(), hints: Vec::new() };
        let mut previous = String::new();
        for cause in successors(Some(error), |&error| error.source()) {
            let text = cause.to_string();
            // Some libraries repeat their cause within their own message.
            if report.causes.is_empty() || !previous.contains(text.trim()) {
                report.causes.push(without_empty_lines(&printable::message(&text)));
            }
            let hint = find_hint(cause, hints).and_then(flag_hint);
            report.hints.extend(hint.map(|hint| printable::message(&hint).into_owned()));
            previous = text;
        }
        report
    }

    /// The report of a text that can be printed as it is.
    #[must_use]
    pub fn of_text(text: &str, hint: Option<String>) -> Self {
        Self { causes: vec![without_empty_lines(text)], hints: hint.into_iter().collect() }
    }

    /// The error and its causes, one per line.
    #[must_use]
    pub fn message(&self) -> String {
        self.causes.join(CAUSE_MARK)
    }

    /// One line per cause, then one per hint, without a line end after the last.
    #[must_use]
    pub fn text(&self) -> String {
        self.hints.iter().fold(self.message(), join_hint)
    }
}

fn without_empty_lines(text: &str) -> String {
    text.lines().map(str::trim_end).filter(|line| !line.is_empty()).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use std::fmt;

    use super::*;

    /// An error with a hint and perhaps a setting.
    #[derive(Debug)]
    struct Failed {
        text: &'static str,
        setting: Option<&'static str>,
        cause: Option<Box<Failed>>,
    }

    impl fmt::Display for Failed {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(self.text)
        }
    }

    impl Error for Failed {
        fn source(&self) -> Option<&(dyn Error + 'static)> {
            self.cause.as_deref().map(|cause| -> &(dyn Error + 'static) { cause })
        }
    }

    impl Hint for Failed {
        fn hint(&self) -> Option<Cow<'static, str>> {
            Some(format!("fix `{}`", self.text).into())
        }

        fn setting(&self) -> Option<&'static str> {
            self.setting
        }

        fn is_usage(&self) -> bool {
            self.setting.is_some()
        }
    }

    #[test]
    fn hints_of_listed_types_follow_the_last_cause_with_the_flag_of_their_setting() {
        let cause = Failed { text: "two topics", setting: Some("topic"), cause: None };
        let error = Failed { text: "cannot read `a\nb`", setting: None, cause: Some(Box::new(cause)) };
        let report = ErrorReport::of(&error, &[as_hint::<Failed>]);
        assert_eq!(
            report.text(),
            "cannot read `a\\nb`\n  because: two topics\nhint: fix `cannot read `a\\nb``\n\
             hint: fix `two topics` (--topic)"
        );
        assert_eq!(ErrorReport::of(&error, &[]).text(), report.message());
    }

    #[test]
    fn an_error_is_of_the_users_values_if_one_of_its_causes_is() {
        let cause = Failed { text: "two topics", setting: Some("topic"), cause: None };
        let error = Failed { text: "cannot read `a`", setting: None, cause: Some(Box::new(cause)) };
        assert!(is_usage(&error, &[as_hint::<Failed>]));
        assert!(!is_usage(&error, &[]));
        let error = Failed { text: "cannot read `a`", setting: None, cause: None };
        assert!(!is_usage(&error, &[as_hint::<Failed>]));
    }

    #[test]
    fn a_cause_that_its_error_repeats_is_omitted() {
        let cause = Failed { text: "bits are missing", setting: None, cause: None };
        let error =
            Failed { text: "no image:\n\n bits are missing\n", setting: None, cause: Some(cause.into()) };
        assert_eq!(ErrorReport::of(&error, &[]).causes, ["no image:\n     bits are missing"]);
        let text = ErrorReport::of_text("no such flag\n\nUsage: a", Some("see --help".to_owned()));
        assert_eq!(text.text(), "no such flag\nUsage: a\nhint: see --help");
    }
}
