//! Checks of numpy arrays: an error says what is wrong with the array and which call fixes it.

use numpy::{
    Element, PyArrayDescrMethods as _, PyArrayMethods as _, PyReadonlyArray, PyUntypedArray,
    PyUntypedArrayMethods as _,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::error::hinted;

/// Imports numpy, which the package itself does not. Otherwise the first array imports it, and a failure
/// there (Ctrl-C, or no numpy) would be a panic.
///
/// # Errors
/// The exception of the import.
pub(crate) fn import_numpy(py: Python<'_>) -> PyResult<()> {
    py.import("numpy").map(drop)
}

/// The argument called `name` as an array of any type.
pub(crate) fn untyped<'a, 'py>(
    name: &str,
    object: &'a Bound<'py, PyAny>,
    expected: &str,
) -> PyResult<&'a Bound<'py, PyUntypedArray>> {
    object.cast::<PyUntypedArray>().map_err(|_| {
        hinted::<PyTypeError>(
            format!("`{name}` is of type `{}`; expected {expected}", type_name(object)),
            format!("convert it, `np.asarray({name})`"),
        )
    })
}

/// The name of an object's type.
pub(crate) fn type_name(object: &Bound<'_, PyAny>) -> String {
    object.get_type().name().map_or_else(|_| "object".to_owned(), |name| name.to_string())
}

/// Whether the elements of an array are of type `T`.
pub(crate) fn holds<T: Element>(array: &Bound<'_, PyUntypedArray>) -> bool {
    array.dtype().is_equiv_to(&T::get_dtype(array.py()))
}

/// Refuses other elements than `T`. In `hint`, `{name}` stands for the argument.
pub(crate) fn check_type<T: Element>(
    name: &str,
    array: &Bound<'_, PyUntypedArray>,
    hint: &str,
) -> PyResult<()> {
    if holds::<T>(array) {
        return Ok(());
    }
    let (found, expected) = (array.dtype(), T::get_dtype(array.py()));
    Err(hinted::<PyTypeError>(
        format!("`{name}` is an array of `{found}`; expected `{expected}`"),
        hint.replace("{name}", name),
    ))
}

/// Refuses an array whose elements are not stored row after row without gaps.
pub(crate) fn check_order(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyResult<()> {
    if array.is_c_contiguous() {
        return check_alignment(name, array);
    }
    Err(hinted::<PyValueError>(
        format!("`{name}` is not C-contiguous"),
        format!("make a contiguous copy, `np.ascontiguousarray({name})`"),
    ))
}

/// Refuses an array whose elements are not aligned in memory, such as a view of packed records.
fn check_alignment(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyResult<()> {
    let flags = array.getattr("flags")?;
    if flags.getattr("aligned")?.extract()? {
        return Ok(());
    }
    Err(hinted::<PyValueError>(
        format!("`{name}` is not aligned in memory for elements of type `{}`", array.dtype()),
        format!("make an aligned copy, `{name}.copy()`"),
    ))
}

/// Borrows an array for reading, once its type and its order were checked.
pub(crate) fn read<'py, T: Element, D: numpy::ndarray::Dimension>(
    name: &str,
    object: &Bound<'py, PyAny>,
) -> PyResult<PyReadonlyArray<'py, T, D>> {
    let array = object.cast::<numpy::PyArray<T, D>>()?;
    array.try_readonly().map_err(|error| {
        hinted::<PyValueError>(
            format!("`{name}` cannot be read: {error}"),
            format!("pass a copy that no other thread writes to, `{name}.copy()`"),
        )
    })
}

/// The shape as Python writes it.
pub(crate) fn shape_text(array: &Bound<'_, PyUntypedArray>) -> String {
    let shape = PyTuple::new(array.py(), array.shape());
    shape.map_or_else(|_| format!("{:?}", array.shape()), |shape| shape.to_string())
}
