//! Failures of images, each reason reported once.

use std::collections::BTreeMap;

use nunet_types::text_with_causes;

use crate::error::EvalError;
use crate::error_hint::hint_of_chain;
use crate::event::{Event, OnEvent};

/// The reported failures. A failure of many images is reported once and counted.
#[derive(Default)]
pub(crate) struct Reported(BTreeMap<String, Failures>);

/// Failures with the same reason.
#[derive(Default)]
struct Failures {
    hint: Option<String>,
    count: u64,
}

impl Reported {
    /// Reports a failure, if it is the first of its reason.
    pub(crate) fn report(&mut self, id: &str, error: &EvalError, on_event: OnEvent<'_>) {
        let reason = text_with_causes(error);
        let failures = self.0.entry(reason.replace(id, "ID")).or_default();
        failures.count += 1;
        if failures.count == 1 {
            failures.hint = hint_of_chain(error);
            on_event(Event::Skipped { id, reason: &reason, hint: failures.hint.as_deref() });
        }
    }

    /// Reports how often the failures with more than one image occurred.
    pub(crate) fn summarize(&self, on_event: OnEvent<'_>) {
        for (reason, Failures { hint, count }) in self.0.iter().filter(|(_, failures)| failures.count > 1) {
            on_event(Event::SkippedAlike { count: *count, reason, hint: hint.as_deref() });
        }
    }
}
