//! `nunet_py._native`: what the Python package is made of. Its Python half finds the files; everything else is here.

mod command;
mod error;
mod installation;
mod stream;

use pyo3::prelude::*;

/// What nunet_py is made of: use `nunet_py`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    error::register(module)?;
    installation::register(module)?;
    command::register(module)?;
    stream::register(module)
}
