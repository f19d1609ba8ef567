//! numpy arrays over the memory of a result, which returns to the model's pool when the last array is gone.
#![expect(unsafe_code, reason = "promises that the memory of a result stays in place while its object lives")]

use numpy::{Element, PyArrayDescr, dtype};
use nunet_engine::Pooled;
use pyo3::prelude::*;

use crate::memory::{self, ArrayLayout, Memory};

/// Owns the memory of one array: the array's `base`.
#[pyclass(frozen, module = "nunet_py")]
struct ResultMemory {
    address: usize,
    bytes: usize,
    /// Never read; it keeps the memory alive.
    _values: PooledValues,
}

/// One of the kinds of values that results consist of.
pub(super) enum PooledValues {
    Numbers { _values: Pooled<f32> },
    Bytes { _values: Pooled<u8> },
}

impl From<Pooled<f32>> for PooledValues {
    fn from(values: Pooled<f32>) -> Self {
        Self::Numbers { _values: values }
    }
}

impl From<Pooled<u8>> for PooledValues {
    fn from(values: Pooled<u8>) -> Self {
        Self::Bytes { _values: values }
    }
}

// SAFETY: `address` and `bytes` describe the vector in `_values`, which is neither read, written nor resized
// before it is dropped with this object.
unsafe impl Memory for ResultMemory {
    const WRITEABLE: bool = true;

    fn bytes(&self) -> (*mut u8, usize) {
        (std::ptr::with_exposed_provenance_mut(self.address), self.bytes)
    }
}

/// An array with these lengths over `values`. It owns them from now on and is writeable.
///
/// # Errors
/// Fewer values than the lengths ask for.
pub(super) fn array<T: Element, const N: usize>(
    py: Python<'_>,
    mut values: Pooled<T>,
    lengths: [usize; N],
) -> PyResult<Bound<'_, PyAny>>
where
    PooledValues: From<Pooled<T>>,
{
    let (address, bytes) = (values.as_mut_ptr().expose_provenance(), size_of_val(&*values));
    let owner = Bound::new(py, ResultMemory { address, bytes, _values: values.into() })?;
    let element: Bound<'_, PyArrayDescr> = dtype::<T>(py);
    memory::array(&owner, element, ArrayLayout::packed(lengths, size_of::<T>()))
}
