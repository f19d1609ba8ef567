//! Exceptions, and which of them a failure becomes.

use std::ffi::CString;

use nunet_core::camera::CameraError;
use nunet_core::pipeline::PipelineError;
use nunet_daemon::embed::{self, Fault};
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyFileNotFoundError, PyUserWarning, PyValueError};
use pyo3::prelude::*;

use self::exceptions::CameraError as CameraFault;
pub(crate) use self::exceptions::{ContractVersionError, ModelError, NunetError, WiringError};

/// The classes as Python sees them; `CameraError` has the name of the error that it is made of.
mod exceptions {
    use super::{PyException, create_exception};

    create_exception!(
        nunet_py,
        NunetError,
        PyException,
        "What nunet_py raises where Python has no exception of its own. The text says what, where, expected and got, and \
         ends with a line `hint: ...`."
    );
    create_exception!(
        nunet_py,
        ModelError,
        NunetError,
        "A model file that cannot be used, or a network that did not run."
    );
    create_exception!(nunet_py, WiringError, NunetError, "Stages of a graph that do not fit together.");
    create_exception!(
        nunet_py,
        CameraError,
        NunetError,
        "Intrinsics or a lens that no camera has, or that do not fit the picture."
    );
    create_exception!(
        nunet_py,
        ContractVersionError,
        NunetError,
        "A daemon that publishes another version of the shared-memory contract."
    );
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("NunetError", py.get_type::<NunetError>())?;
    module.add("ModelError", py.get_type::<ModelError>())?;
    module.add("WiringError", py.get_type::<WiringError>())?;
    module.add("CameraError", py.get_type::<CameraFault>())?;
    module.add("ContractVersionError", py.get_type::<ContractVersionError>())
}

/// A failure of the daemon's half as the exception that Python has for it.
pub(crate) fn failure(error: &anyhow::Error) -> PyErr {
    raise(Fault::of(error), embed::message(error))
}

/// A failure of the pipeline.
pub(crate) fn of_pipeline(error: PipelineError) -> PyErr {
    failure(&error.into())
}

/// A failure of a camera's numbers.
pub(crate) fn of_camera(error: CameraError) -> PyErr {
    let hint = "intrinsics and size are pixels, as a calibration gives them";
    raise(Fault::Camera, with_hint(embed::message(&error.into()), hint))
}

/// A message with a way out, where it has none of its own.
pub(crate) fn with_hint(mut message: String, hint: &str) -> String {
    if !message.contains("\nhint: ") {
        message.push_str("\nhint: ");
        message.push_str(hint);
    }
    message
}

fn raise(fault: Fault, message: String) -> PyErr {
    match fault {
        Fault::NotFound => PyFileNotFoundError::new_err(message),
        Fault::Argument => PyValueError::new_err(message),
        Fault::Model => ModelError::new_err(message),
        Fault::Wiring => WiringError::new_err(message),
        Fault::Camera => CameraFault::new_err(message),
        Fault::Other => NunetError::new_err(message),
    }
}

/// Something that is worth a warning and no failure.
pub(crate) fn warn(py: Python<'_>, message: &str) -> PyResult<()> {
    // A model's own text may hold a NUL, which ends a C string.
    let message = CString::new(message.replace('\0', "")).unwrap_or_default();
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &message, 1)
}
