//! `nunet_py._native`: what the Python package is made of. Its Python half finds the files; everything else is here.
#![expect(
    clippy::doc_markdown,
    reason = "doc comments of what Python sees are its docstrings, in numpydoc's form"
)]

mod argument;
mod camera;
mod cloud;
mod colour;
mod command;
mod error;
mod installation;
mod memory;
mod model;
mod own;
mod picture;
mod replay;
mod result;
mod stream;

use pyo3::prelude::*;

/// What nunet_py is made of: use `nunet_py`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    error::register(module)?;
    installation::register(module)?;
    command::register(module)?;
    camera::register(module)?;
    model::register(module)?;
    result::register(module)?;
    cloud::register(module)?;
    colour::register(module)?;
    replay::register(module)?;
    stream::register(module)
}
