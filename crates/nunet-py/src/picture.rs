//! Arrays that come from Python: what is wrong with one, and what to call.

use numpy::{
    Element, Ix3, PyArrayDescrMethods as _, PyArrayMethods as _, PyReadonlyArray, PyReadonlyArray3,
    PyUntypedArray, PyUntypedArrayMethods as _,
};
use nunet_core::frame::{ImageView, PixelFormat};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::error::with_hint;

/// A picture: uint8 `(H, W, 3)`, C-contiguous, red first.
pub(crate) struct Picture<'py>(PyReadonlyArray3<'py, u8>);

impl<'py> Picture<'py> {
    /// Takes the argument called `name`.
    ///
    /// # Errors
    /// `TypeError` for what is no array of uint8, `ValueError` for another shape, order or size.
    pub(crate) fn take(name: &str, object: &Bound<'py, PyAny>) -> PyResult<Self> {
        let array = untyped(name, object, "a numpy array of uint8 (H, W, 3)")?;
        check_type::<u8>(
            name,
            array,
            "(255 * {name}).round().astype(np.uint8)` for colours from 0 to 1, \
                                       `{name}.astype(np.uint8)` for 0 to 255",
        )?;
        check_picture_shape(name, array)?;
        check_order(name, array)?;
        let picture = Self(read::<u8, Ix3>(name, object)?);
        picture.view()?;
        Ok(picture)
    }

    /// The picture as the pipeline reads it.
    ///
    /// # Errors
    /// `ValueError` for a side that is 0 or longer than any camera's.
    pub(crate) fn view(&self) -> PyResult<ImageView<'_>> {
        let [height, width] = [0, 1].map(|axis| u32::try_from(self.0.shape()[axis]).unwrap_or(u32::MAX));
        let bytes = self.0.as_slice().map_err(|error| PyValueError::new_err(error.to_string()))?;
        let view = ImageView::packed(bytes, width, height, PixelFormat::Rgb8);
        let hint = "a picture has at least one row and one column; resize one that is larger than that";
        view.map_err(|error| PyValueError::new_err(with_hint(error.to_string(), hint)))
    }
}

/// The argument called `name` as an array of whatever.
pub(crate) fn untyped<'a, 'py>(
    name: &str,
    object: &'a Bound<'py, PyAny>,
    expected: &str,
) -> PyResult<&'a Bound<'py, PyUntypedArray>> {
    object.cast::<PyUntypedArray>().map_err(|_| {
        let found = object.get_type().name().map_or_else(|_| "object".to_owned(), |name| name.to_string());
        PyTypeError::new_err(format!(
            "`{name}` is of type `{found}`; expected {expected}\nhint: `np.asarray({name})` makes an array of a PIL \
             image or a list"
        ))
    })
}

/// Refuses another element type than `T`; `conversion` is a hint in which `{name}` stands for the argument.
pub(crate) fn check_type<T: Element>(
    name: &str,
    array: &Bound<'_, PyUntypedArray>,
    conversion: &str,
) -> PyResult<()> {
    let (found, expected) = (array.dtype(), T::get_dtype(array.py()));
    if found.is_equiv_to(&expected) {
        return Ok(());
    }
    let conversion = conversion.replace("{name}", name);
    Err(PyTypeError::new_err(format!("`{name}` holds `{found}`; expected `{expected}`\nhint: `{conversion}")))
}

/// Refuses an array whose elements do not lie one behind the other, row after row.
pub(crate) fn check_order(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyResult<()> {
    if array.is_c_contiguous() {
        return check_alignment(name, array);
    }
    Err(PyValueError::new_err(format!(
        "`{name}` is not C-contiguous: its elements do not lie one behind the other\nhint: \
         `np.ascontiguousarray({name})` makes a copy that is"
    )))
}

/// Refuses an array whose elements begin anywhere in memory, as views of packed records may.
fn check_alignment(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyResult<()> {
    let flags = array.getattr("flags")?;
    if flags.getattr("aligned")?.extract()? {
        return Ok(());
    }
    Err(PyValueError::new_err(format!(
        "`{name}` is not aligned: its elements begin between two places of memory for a `{}`\nhint: `{name}.copy()` \
         makes an array that is",
        array.dtype()
    )))
}

/// The array for reading, once everything was checked.
pub(crate) fn read<'py, T: Element, D: numpy::ndarray::Dimension>(
    name: &str,
    object: &Bound<'py, PyAny>,
) -> PyResult<PyReadonlyArray<'py, T, D>> {
    let array = object.cast::<numpy::PyArray<T, D>>()?;
    array.try_readonly().map_err(|error| {
        PyValueError::new_err(format!(
            "`{name}` cannot be read: {error}\nhint: `{name}.copy()` is an array that nobody writes to"
        ))
    })
}

/// The shape as Python writes it.
pub(crate) fn shown(array: &Bound<'_, PyUntypedArray>) -> String {
    let shape = PyTuple::new(array.py(), array.shape());
    shape.map_or_else(|_| format!("{:?}", array.shape()), |shape| shape.to_string())
}

fn check_picture_shape(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyResult<()> {
    let hint = match array.shape() {
        [_, _, 3] => return Ok(()),
        [_, _] => format!("of a grey picture: `np.repeat({name}[..., None], 3, axis=2)`"),
        [_, _, 1] => format!("of a grey picture: `np.repeat({name}, 3, axis=2)`"),
        [_, _, 4] => format!("without its fourth channel: `np.ascontiguousarray({name}[..., :3])`"),
        [3, _, _] => format!("channels last: `np.ascontiguousarray({name}.transpose(1, 2, 0))`"),
        [_, _, _, 3] => format!("one picture at a time: `{name}[0]`"),
        _ => "rows from the top, then columns, then red, green and blue".to_owned(),
    };
    Err(PyValueError::new_err(format!(
        "`{name}` has shape `{}`; expected (H, W, 3)\nhint: {hint}",
        shown(array)
    )))
}
