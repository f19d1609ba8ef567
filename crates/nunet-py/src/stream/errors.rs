//! Errors of shared memory as exceptions.

use std::error::Error;

use nunet_ipc::{CameraName, IpcError, Topic};
use nunet_types::{Hint, counted, join_hint, printable, text_with_causes};
use pyo3::exceptions::{PyTimeoutError, PyValueError};
use pyo3::prelude::*;

use crate::error::{ContractVersionError, NunetError, exception, hinted};

/// The exception for an error of shared memory.
pub(super) fn ipc_error(error: IpcError) -> PyErr {
    match error {
        IpcError::TooManyFramesHeld { topic, limit } => {
            let array = if topic == Topic::Cloud { "cloud.points" } else { topic.name() };
            hinted::<NunetError>(
                format!(
                    "this subscriber's frames and arrays hold {} of `{topic}`, the most that one subscriber may hold",
                    counted(limit, "message")
                ),
                format!(
                    "drop a frame and its arrays before you take the next one, and copy what must live longer, \
                     `frame.{array}.copy()`"
                ),
            )
        }
        IpcError::NobodyPublishes { .. } => exception::<PyTimeoutError>(message(&error)),
        IpcError::ContractVersion { .. } => exception::<ContractVersionError>(message(&error)),
        IpcError::Limit { .. } | IpcError::CaptureTime { .. } => exception::<PyValueError>(message(&error)),
        error => exception::<NunetError>(message(&error)),
    }
}

/// The text of an error with its causes and its hint.
fn message<E: Error + Hint>(error: &E) -> String {
    let text = text_with_causes(error);
    let text = printable::message(&text);
    match error.hint() {
        Some(hint) => join_hint(text, printable::message(&hint)),
        None => text.into_owned(),
    }
}

/// The name of a camera.
///
/// # Errors
/// `ValueError` for an invalid name.
pub(super) fn camera_name(name: &str) -> PyResult<CameraName> {
    CameraName::new(name).map_err(|error| exception::<PyValueError>(message(&error)))
}
