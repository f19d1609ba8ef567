//! numpy arrays over results' memory, which goes back to the model when the last of them is gone.
#![expect(unsafe_code, reason = "numpy is told whose memory an array is")]

use numpy::ndarray::{ArrayViewMut, Dimension};
use numpy::{Element, PyArray};
use nunet_daemon::embed::Recycled;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Owns the memory of one array: the array's `base`.
#[pyclass(frozen, module = "nunet_py")]
struct ResultMemory {
    /// Held, never looked at: it is the array's.
    _values: Kept,
}

/// One of the kinds that results are made of.
pub(crate) enum Kept {
    Numbers { _values: Recycled<f32> },
    Bytes { _values: Recycled<u8> },
}

impl From<Recycled<f32>> for Kept {
    fn from(values: Recycled<f32>) -> Self {
        Self::Numbers { _values: values }
    }
}

impl From<Recycled<u8>> for Kept {
    fn from(values: Recycled<u8>) -> Self {
        Self::Bytes { _values: values }
    }
}

/// An array of `shape` over `values`: its own from now on, and writable.
pub(crate) fn array<T: Element, D: Dimension>(
    py: Python<'_>,
    mut values: Recycled<T>,
    shape: D,
) -> PyResult<Py<PyArray<T, D>>>
where
    Kept: From<Recycled<T>>,
{
    if shape.size_checked() != Some(values.len()) {
        let text = format!("{} numbers are no array of shape {shape:?}", values.len());
        return Err(PyValueError::new_err(text));
    }
    let first = values.as_mut_ptr();
    let owner = Bound::new(py, ResultMemory { _values: values.into() })?;
    // SAFETY: as many numbers as the shape has lie at `first`, in a vector that `owner` keeps as it is and that nobody
    // else reaches.
    let view = unsafe { ArrayViewMut::from_shape_ptr(shape, first) };
    // SAFETY: the array keeps `owner`, which keeps the memory and never moves it.
    Ok(unsafe { PyArray::borrow_from_array(&view, owner.into_any()) }.unbind())
}
