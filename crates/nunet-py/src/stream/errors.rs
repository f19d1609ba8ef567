//! Errors of shared memory as exceptions.

use std::error::Error;

use nunet_ipc::{CameraName, IpcError, Topic};
use nunet_types::{ErrorReport, Hint, counted, text_with_causes};
use pyo3::exceptions::{PyTimeoutError, PyValueError};
use pyo3::prelude::*;

use crate::error::{ContractVersionError, NunetError, exception, hinted, report_of_text};

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
        IpcError::NobodyPublishes { .. } => exception::<PyTimeoutError>(&report(&error)),
        IpcError::ContractVersion { .. } => exception::<ContractVersionError>(&report(&error)),
        IpcError::Limit { .. } | IpcError::CaptureTime { .. } => exception::<PyValueError>(&report(&error)),
        error => exception::<NunetError>(&report(&error)),
    }
}

/// An error with its causes on one line, and its hint.
fn report<E: Error + Hint>(error: &E) -> ErrorReport {
    report_of_text(&text_with_causes(error), error.hint().as_deref())
}

/// The name of a camera.
///
/// # Errors
/// `ValueError` for an invalid name.
pub(super) fn camera_name(name: &str) -> PyResult<CameraName> {
    CameraName::new(name).map_err(|error| exception::<PyValueError>(&report(&error)))
}
