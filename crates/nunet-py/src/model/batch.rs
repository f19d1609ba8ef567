//! Several images in one call.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyIterator, PyString};

use crate::array::type_name;
use crate::error::hinted;

/// The images of a batch; a single image is refused.
pub(super) fn images<'py>(images: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyIterator>> {
    let one_array =
        images.getattr("ndim").and_then(|count| count.extract::<usize>()).is_ok_and(|count| count < 4);
    let one_path = images.is_instance_of::<PyString>() || images.hasattr("__fspath__")?;
    match images.try_iter() {
        Ok(iterator) if !one_array && !one_path => Ok(iterator),
        _ => Err(hinted::<PyTypeError>(
            format!("`images` is a single `{}`; expected several images", type_name(images)),
            "pass a list, `[image]`, or call `infer`",
        )),
    }
}

/// The error with a note that says which image of a batch caused it. Python 3.10 has no notes.
pub(super) fn with_note(py: Python<'_>, error: PyErr, index: usize) -> PyErr {
    let _ = error.value(py).call_method1("add_note", (format!("image {index} of the batch"),));
    error
}
