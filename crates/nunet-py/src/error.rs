//! Exceptions, their hints, and which exception an error becomes.

use std::error::Error;
use std::ffi::CString;
use std::fmt::Display;

use nunet_core::camera::CameraError;
use nunet_engine::{EngineError, EngineErrorKind};
use nunet_files::FilesError;
use nunet_ipc::{CameraNameError, IpcError};
use nunet_source::SourceError;
use nunet_types::{AsHint, ErrorReport, as_hint, is_usage, printable};
use pyo3::PyTypeInfo;
use pyo3::exceptions::{PyFileNotFoundError, PyUserWarning, PyValueError};
use pyo3::prelude::*;

pub(crate) use self::exceptions::CameraError as PyCameraError;
pub(crate) use self::exceptions::{ContractVersionError, ModelError, NunetError, WiringError};

/// The attribute that holds the hint of an exception.
const ATTRIBUTE: &str = "hint";

/// The error types of nunet's Rust code that can give hints or be about the user's arguments. A new one that
/// implements `Hint` needs its line here.
const HINTS: &[AsHint] = &[
    nunet_core::as_hint,
    as_hint::<EngineError>,
    as_hint::<FilesError>,
    as_hint::<IpcError>,
    as_hint::<CameraNameError>,
    as_hint::<SourceError>,
];

/// The classes as Python sees them. `CameraError` has the name of the Rust error that it is made from.
mod exceptions {
    use pyo3::create_exception;
    use pyo3::exceptions::PyException;

    create_exception!(
        nunet_py,
        NunetError,
        PyException,
        "Base class of the exceptions of nunet_py. The text says what failed, where, what was expected and what was found, \
         and ends with a line `hint: ...` if something can be done. `hint` is that line alone, or None."
    );
    create_exception!(
        nunet_py,
        ModelError,
        NunetError,
        "A model file cannot be used, or the network failed to run."
    );
    create_exception!(nunet_py, WiringError, NunetError, "The stages of a graph do not fit together.");
    create_exception!(
        nunet_py,
        CameraError,
        NunetError,
        "Intrinsics or distortion coefficients are invalid, or do not fit the image."
    );
    create_exception!(
        nunet_py,
        ContractVersionError,
        NunetError,
        "The publisher uses another version of the shared-memory contract."
    );
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    let base = py.get_type::<NunetError>();
    base.setattr(ATTRIBUTE, py.None())?;
    module.add("NunetError", base)?;
    module.add("ModelError", py.get_type::<ModelError>())?;
    module.add("WiringError", py.get_type::<WiringError>())?;
    module.add("CameraError", py.get_type::<PyCameraError>())?;
    module.add("ContractVersionError", py.get_type::<ContractVersionError>())
}

/// An exception whose text ends with the hint, which is its attribute `hint` too. Names in both cannot add
/// another one.
pub(crate) fn hinted<E: PyTypeInfo>(text: impl Display, hint: impl Display) -> PyErr {
    exception::<E>(&report_of_text(&text.to_string(), Some(&hint.to_string())))
}

/// A text and what can be done about it, without control characters in names.
pub(crate) fn report_of_text(text: &str, hint: Option<&str>) -> ErrorReport {
    let shown = |text: &str| printable::message(text).into_owned();
    ErrorReport { causes: vec![shown(text)], hints: hint.map(shown).into_iter().collect() }
}

/// An exception whose text has the causes and the hints, and whose attribute `hint` has the hints.
pub(crate) fn exception<E: PyTypeInfo>(report: &ErrorReport) -> PyErr {
    let error = PyErr::new::<E, _>(report.text());
    if !report.hints.is_empty() {
        let hint = report.hints.join("\n");
        // An exception class that takes no attributes still has the hint in its text.
        Python::attach(|py| error.value(py).setattr(ATTRIBUTE, hint).ok());
    }
    error
}

/// The exception for an error of nunet's Rust code.
pub(crate) fn failure(error: &anyhow::Error) -> PyErr {
    raise(kind_of(error), &report(error.as_ref()))
}

/// An error, its causes and their hints, as `nunetd` prints them.
pub(crate) fn report(error: &(dyn Error + 'static)) -> ErrorReport {
    ErrorReport::of(error, HINTS)
}

/// The kind of an error, which selects the exception.
fn kind_of(error: &anyhow::Error) -> EngineErrorKind {
    let argument = || is_usage(error.as_ref(), HINTS).then_some(EngineErrorKind::Argument);
    EngineErrorKind::of_chain(error.as_ref()).or_else(argument).unwrap_or(EngineErrorKind::Other)
}

/// The exception for invalid intrinsics or distortion coefficients.
pub(crate) fn of_camera(error: CameraError) -> PyErr {
    let mut described = report(&error);
    if described.hints.is_empty() {
        described.hints.push("intrinsics and size are in pixels, as a calibration gives them".to_owned());
    }
    raise(EngineErrorKind::Camera, &described)
}

fn raise(kind: EngineErrorKind, report: &ErrorReport) -> PyErr {
    match kind {
        EngineErrorKind::NotFound => exception::<PyFileNotFoundError>(report),
        EngineErrorKind::Argument => exception::<PyValueError>(report),
        EngineErrorKind::Model => exception::<ModelError>(report),
        EngineErrorKind::Wiring => exception::<WiringError>(report),
        EngineErrorKind::Camera => exception::<PyCameraError>(report),
        _ => exception::<NunetError>(report),
    }
}

/// Issues a `UserWarning` that ends with a hint.
pub(crate) fn warn_with_hint(py: Python<'_>, message: &str, hint: &str) -> PyResult<()> {
    issue(py, &report_of_text(message, Some(hint)).text())
}

/// Issues a `UserWarning` at the caller's line.
pub(crate) fn warn(py: Python<'_>, message: &str) -> PyResult<()> {
    issue(py, &printable::message(message))
}

fn issue(py: Python<'_>, text: &str) -> PyResult<()> {
    // It has no NUL, which would end the C string: that is a control character.
    let text = CString::new(text).unwrap_or_default();
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)
}
