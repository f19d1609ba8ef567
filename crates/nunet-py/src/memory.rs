#![expect(
    unsafe_code,
    reason = "numpy arrays over memory that is not numpy's own are made through its C API"
)]
//! numpy arrays over memory that a Python object owns: the memory of a result, or a message in shared memory.

use std::ffi::c_int;

use numpy::npyffi::{NPY_ARRAY_WRITEABLE, NpyTypes, PyArrayObject, get_type_object};
use numpy::{PY_ARRAY_API, PyArrayDescr, PyArrayDescrMethods as _};
use pyo3::PyClass;
use pyo3::prelude::*;

use crate::error::{NunetError, hinted};

/// Memory that a Python object keeps in place.
///
/// # Safety
/// The bytes must stay mapped, at the same place, for as long as the object lives. Where
/// [`WRITEABLE`](Self::WRITEABLE) is true, nothing but the arrays may read or write them.
pub(crate) unsafe trait Memory {
    /// Whether arrays may write to it.
    const WRITEABLE: bool;

    /// Its first byte, and the number of bytes.
    fn bytes(&self) -> (*mut u8, usize);
}

/// The layout of an array in a memory.
#[derive(Debug, Clone)]
pub(crate) struct ArrayLayout<const N: usize> {
    pub(crate) lengths: [usize; N],
    /// Bytes from one element to the next, for each dimension.
    pub(crate) strides: [isize; N],
    /// Bytes before the element whose indices are all zero.
    pub(crate) offset: usize,
}

impl<const N: usize> ArrayLayout<N> {
    /// Elements of so many bytes, row after row without gaps.
    pub(crate) fn packed(lengths: [usize; N], element_bytes: usize) -> Self {
        let mut strides = [0; N];
        let mut stride = element_bytes as isize;
        for (own, length) in strides.iter_mut().zip(lengths).rev() {
            *own = stride;
            stride *= length as isize;
        }
        Self { lengths, strides, offset: 0 }
    }

    /// Makes sure that every element of so many bytes lies within the memory.
    fn check(&self, element_bytes: usize, memory_bytes: usize) -> PyResult<()> {
        if self.fits(element_bytes, memory_bytes) {
            return Ok(());
        }
        let lengths = self.lengths;
        Err(hinted::<NunetError>(
            format!("an array of {lengths:?} elements does not fit into a message of {memory_bytes} bytes"),
            "update the sender: it violates the shared-memory contract",
        ))
    }

    fn fits(&self, element_bytes: usize, memory_bytes: usize) -> bool {
        self.span(element_bytes).is_some_and(|(first, end)| first >= 0 && end <= memory_bytes as i128)
    }

    /// The first byte, and the one after the last; `None` if there is no element.
    fn span(&self, element_bytes: usize) -> Option<(i128, i128)> {
        let (mut first, mut last) = (self.offset as i128, self.offset as i128);
        for (length, stride) in self.lengths.iter().zip(&self.strides) {
            let reach = (length.checked_sub(1)? as i128).checked_mul(*stride as i128)?;
            (first, last) = (first + reach.min(0), last + reach.max(0));
        }
        Some((first, last + element_bytes as i128))
    }
}

/// An array over the memory of `owner`, which it keeps alive. A read-only array cannot be made writeable from
/// Python.
///
/// # Errors
/// `NunetError` if the array does not fit in the memory.
pub(crate) fn array<'py, M, const N: usize>(
    owner: &Bound<'py, M>,
    element: Bound<'py, PyArrayDescr>,
    shape: ArrayLayout<N>,
) -> PyResult<Bound<'py, PyAny>>
where
    M: Memory + PyClass<Frozen = pyo3::pyclass::boolean_struct::True> + Sync,
{
    let py = owner.py();
    let (bytes, count) = owner.get().bytes();
    shape.check(element.itemsize(), count)?;
    let mut lengths = shape.lengths.map(|length| length as isize);
    let mut strides = shape.strides;
    let flags: c_int = if M::WRITEABLE { NPY_ARRAY_WRITEABLE } else { 0 };
    let first = bytes.wrapping_add(shape.offset).cast();
    // SAFETY: numpy's module stays loaded, and so does its array type.
    let type_ = unsafe { get_type_object(py, NpyTypes::PyArray_Type) };
    // SAFETY: every element lies within the memory (checked above), which stays as long as `owner`
    // (`Memory`), which becomes the array's base below. numpy copies lengths and strides and takes over the
    // reference to `element`.
    let made = unsafe {
        PY_ARRAY_API.PyArray_NewFromDescr(
            py,
            type_,
            element.into_dtype_ptr(),
            N as c_int,
            lengths.as_mut_ptr(),
            strides.as_mut_ptr(),
            first,
            flags,
            std::ptr::null_mut(),
        )
    };
    // SAFETY: a new reference, or null with an exception set.
    let array = unsafe { Bound::from_owned_ptr_or_err(py, made) }?;
    let base = owner.clone().into_any().into_ptr();
    // SAFETY: `array` is an array (just made) without a base; numpy takes over the reference to `base`.
    let failed =
        unsafe { PY_ARRAY_API.PyArray_SetBaseObject(py, array.as_ptr().cast::<PyArrayObject>(), base) };
    if failed == 0 { Ok(array) } else { Err(PyErr::fetch(py)) }
}

/// The number of references to an object.
pub(crate) fn references(object: &Bound<'_, PyAny>) -> isize {
    // SAFETY: the object is alive as long as it is borrowed, and the interpreter is held.
    unsafe { pyo3::ffi::Py_REFCNT(object.as_ptr()) }
}
