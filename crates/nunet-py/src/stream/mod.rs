//! Frames of other processes, and pictures for them, in shared memory: nothing is copied.

mod feed;
mod figures;
mod frame;
mod header;
mod late;
mod layout;
mod loan;
mod names;
mod publisher;
mod sample;
mod subscribe;
mod view;

use std::time::{Duration, Instant};

use nunet_ipc::{CameraName, IpcError, Topic};
use nunet_types::{Hint as _, text_with_hint};
use pyo3::exceptions::{PyTimeoutError, PyValueError};
use pyo3::prelude::*;

use crate::error::{ContractVersionError, NunetError};

/// How long one wait may take with Python's signals unseen. A late joiner's first frame comes without a wake-up, so
/// this is also how late it may be.
const GLANCE: Duration = Duration::from_millis(50);

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    subscribe::register(module)?;
    publisher::register(module)?;
    module.add_class::<frame::Frame>()?;
    module.add_class::<header::FrameHeader>()?;
    module.add_class::<figures::Stats>()?;
    module.add_class::<loan::Loan>()
}

/// An error of shared memory as Python's.
fn ipc_error(error: &IpcError) -> PyErr {
    let text = text_with_hint(error);
    match error {
        IpcError::NobodyPublishes { .. } => PyTimeoutError::new_err(text),
        IpcError::ContractVersion { .. } => ContractVersionError::new_err(text),
        IpcError::Limit { .. } => PyValueError::new_err(text),
        IpcError::TooManyFramesHeld { topic, limit } => {
            let array = if *topic == Topic::Cloud { "cloud.points" } else { topic.name() };
            NunetError::new_err(format!(
                "this subscriber's frames and views hold {limit} messages of `{topic}`, as many as one reader may\n\
                 hint: let go of a frame and its arrays before taking the next, and copy what must live longer \
                 (`frame.{array}.copy()`)"
            ))
        }
        error => {
            let Some(cause) = std::error::Error::source(error) else { return NunetError::new_err(text) };
            let hint = error.hint().map(|hint| format!("\nhint: {hint}")).unwrap_or_default();
            NunetError::new_err(format!("{error}: {cause}{hint}"))
        }
    }
}

fn camera_name(name: &str) -> PyResult<CameraName> {
    CameraName::new(name).map_err(|error| PyValueError::new_err(text_with_hint(&error)))
}

/// Seconds as people give them; `None` and infinity are for ever.
fn timeout(seconds: Option<f64>) -> PyResult<Option<Duration>> {
    match seconds {
        None => Ok(None),
        Some(seconds) if seconds == f64::INFINITY => Ok(None),
        Some(seconds) => Duration::try_from_secs_f64(seconds).map(Some).map_err(|_| {
            PyValueError::new_err(format!(
                "timeout is `{seconds}`, but expected seconds, 0 or more\nhint: `None` waits for ever"
            ))
        }),
    }
}

/// When waiting ends.
#[derive(Debug, Clone, Copy)]
struct Deadline {
    start: Instant,
    patience: Option<Duration>,
}

impl Deadline {
    fn after(patience: Option<Duration>) -> Self {
        Self { start: Instant::now(), patience }
    }

    /// The next wait: what is left, but not longer than `GLANCE`.
    fn glance(&self) -> Duration {
        self.patience.map_or(GLANCE, |patience| GLANCE.min(patience.saturating_sub(self.start.elapsed())))
    }

    fn is_over(&self) -> bool {
        self.glance().is_zero()
    }
}
