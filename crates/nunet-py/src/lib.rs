//! `nunet_py._native`: the compiled part of the Python package `nunet_py`.
#![expect(
    clippy::doc_markdown,
    reason = "doc comments of Python classes and functions are their docstrings, in numpydoc's format"
)]

mod argument;
mod array;
mod camera;
mod cloud;
mod colorize;
mod command;
mod error;
mod fork_guard;
mod image;
mod image_replay;
mod installation;
mod memory;
mod model;
mod obstacles;
mod replay;
mod result;
mod stream;

use pyo3::prelude::*;

/// The native part of nunet_py. Import `nunet_py` instead.
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
    obstacles::register(module)?;
    colorize::register(module)?;
    replay::register(module)?;
    stream::register(module)
}
