//! Errors of sources and of their frames.

use std::borrow::Cow;
use std::error::Error;
use std::fmt;

use nunet_types::{Hint, text_with_causes};

use crate::secret::Secrets;

/// The kind of a [`SourceError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SourceErrorKind {
    /// The name of the source or its options are wrong: other arguments would help.
    Argument,
    /// The source cannot be opened, or reading it failed.
    Unavailable,
    /// One frame cannot be read.
    BadFrame,
    /// The source ended before it should have.
    CutOff,
    /// The source never delivered a readable frame.
    NothingReadable,
}

/// An error of a source.
#[derive(Debug)]
pub struct SourceError {
    kind: SourceErrorKind,
    message: String,
    hint: Option<Cow<'static, str>>,
    setting: Option<&'static str>,
    cause: Option<Box<dyn Error + Send + Sync>>,
}

impl SourceError {
    /// An error of a kind.
    #[must_use]
    pub fn new(kind: SourceErrorKind, message: impl Into<String>) -> Self {
        Self { kind, message: message.into(), hint: None, setting: None, cause: None }
    }

    /// Wrong arguments.
    #[must_use]
    pub fn bad_arguments(message: impl Into<String>) -> Self {
        Self::new(SourceErrorKind::Argument, message)
    }

    /// A frame that cannot be read.
    #[must_use]
    pub fn bad_frame(message: impl Into<String>) -> Self {
        Self::new(SourceErrorKind::BadFrame, message)
    }

    /// Adds a hint: one imperative sentence on how to fix the error.
    #[must_use]
    pub fn with_hint(self, hint: impl Into<Cow<'static, str>>) -> Self {
        Self { hint: Some(hint.into()), ..self }
    }

    /// Adds the setting that the hint is about.
    #[cfg(feature = "mcap")]
    #[must_use]
    pub(crate) fn with_setting(self, setting: Option<&'static str>) -> Self {
        Self { setting, ..self }
    }

    /// Adds the cause.
    #[must_use]
    pub fn with_cause(self, cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self { cause: Some(cause.into()), ..self }
    }

    /// Wraps the error: `message` says what failed, and this error becomes its cause and keeps its hint.
    pub(crate) fn context(self, message: impl Into<String>) -> Self {
        Self {
            kind: self.kind,
            message: message.into(),
            hint: None,
            setting: None,
            cause: Some(Box::new(self)),
        }
    }

    /// The error without the secrets of the source's name.
    pub(crate) fn hiding(self, secrets: &Secrets) -> Self {
        if secrets.is_empty() {
            return self;
        }
        let cause = self.cause.map(|cause| {
            let text = text_with_causes(&*cause);
            let hidden = secrets.hide(&text);
            if hidden == text { cause } else { hidden.into() }
        });
        let hint = self.hint.map(|hint| secrets.hide(&hint).into());
        Self { message: secrets.hide(&self.message), hint, cause, kind: self.kind, setting: self.setting }
    }

    /// The kind of the error.
    #[must_use]
    pub fn kind(&self) -> SourceErrorKind {
        self.kind
    }
}

impl fmt::Display for SourceError {
    /// `{:#}` adds the causes, as anyhow does.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if f.alternate() { f.write_str(&text_with_causes(self)) } else { f.write_str(&self.message) }
    }
}

impl Error for SourceError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.cause.as_deref().map(|cause| cause as &(dyn Error + 'static))
    }
}

impl Hint for SourceError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        self.hint.clone()
    }

    fn setting(&self) -> Option<&'static str> {
        self.setting
    }

    fn is_usage(&self) -> bool {
        self.kind == SourceErrorKind::Argument
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_context_keeps_the_kind_and_leaves_the_hint_with_the_cause() {
        let error =
            SourceError::bad_frame("it is too large").with_hint("make it smaller").context("cannot read `a`");
        assert_eq!((error.kind(), error.hint()), (SourceErrorKind::BadFrame, None));
        assert_eq!(
            (error.to_string(), format!("{error:#}")),
            ("cannot read `a`".into(), "cannot read `a`: it is too large".into())
        );
        let cause = error.source().unwrap().downcast_ref::<SourceError>().unwrap();
        assert_eq!(cause.hint().as_deref(), Some("make it smaller"));
    }
}
