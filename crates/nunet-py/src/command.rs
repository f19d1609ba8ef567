//! The command `nunetd` inside an interpreter.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs the command line `arguments` (the program name first) without the GIL and returns its exit code.
#[pyfunction]
fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| nunet_daemon::exit_code(arguments))
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(command, module)?)
}
