//! The location of this installation's files, set by the Python code of the package.

use std::ffi::OsString;
use std::path::PathBuf;

use nunet_engine::Installation;
use pyo3::prelude::*;

/// Sets how `nunetd` is started and where the models and the ONNX Runtime library are. Called once, on
/// import.
#[pyfunction]
#[pyo3(signature = (*, command, model_folders, library_folders))]
fn describe_installation(command: Vec<OsString>, model_folders: Vec<PathBuf>, library_folders: Vec<PathBuf>) {
    Installation { command, model_folders, library_folders }.describe();
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(describe_installation, module)?)
}
