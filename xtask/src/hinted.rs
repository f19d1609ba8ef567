//! Errors with a hint.

use std::error::Error as StdError;
use std::fmt;

use anyhow::Error;

/// An error, and what can be done about it: one imperative sentence.
#[derive(Debug)]
pub(crate) struct Hinted {
    message: String,
    pub(crate) hint: &'static str,
    cause: Option<Error>,
}

impl Hinted {
    pub(crate) fn new(message: impl Into<String>, hint: &'static str) -> Self {
        Self { message: message.into(), hint, cause: None }
    }

    pub(crate) fn because(self, cause: impl Into<Error>) -> Self {
        Self { cause: Some(cause.into()), ..self }
    }
}

impl fmt::Display for Hinted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl StdError for Hinted {
    fn source(&self) -> Option<&(dyn StdError + 'static)> {
        self.cause.as_deref().map(|cause| cause as _)
    }
}
