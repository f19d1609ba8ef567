//! Timeouts and deadlines.

use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::hinted;

/// Longest wait between two checks for signals of Python. The first frame of a late subscriber comes without
/// an event, so this is also its greatest delay.
pub(super) const MAX_WAIT: Duration = Duration::from_millis(50);

/// A timeout in seconds; `None` and infinity wait without limit.
pub(super) fn timeout(seconds: Option<f64>) -> PyResult<Option<Duration>> {
    match seconds {
        None => Ok(None),
        Some(seconds) if seconds == f64::INFINITY => Ok(None),
        Some(seconds) => Duration::try_from_secs_f64(seconds).map(Some).map_err(|_| {
            hinted::<PyValueError>(
                format!("`timeout` is `{seconds}`; expected seconds, 0 or more"),
                "pass `None` to wait without limit",
            )
        }),
    }
}

/// The end of a wait.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deadline {
    start: Instant,
    timeout: Option<Duration>,
}

impl Deadline {
    pub(super) fn after(timeout: Option<Duration>) -> Self {
        Self { start: Instant::now(), timeout }
    }

    /// The duration of the next wait: the remaining time, but at most `MAX_WAIT`.
    pub(super) fn next_wait(&self) -> Duration {
        self.timeout.map_or(MAX_WAIT, |timeout| MAX_WAIT.min(timeout.saturating_sub(self.start.elapsed())))
    }

    pub(super) fn is_over(&self) -> bool {
        self.next_wait().is_zero()
    }
}
