#![expect(unsafe_code, reason = "promises that a borrowed chunk stays in place while its object lives")]
//! An image that is written directly into shared memory.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::port::{Anchor, ImageStamp, ImageTopic};
use crate::argument;
use crate::error::{NunetError, hinted};
use crate::fork_guard::ForkGuard;
use crate::memory::{Memory, references};

/// The name of the class in messages.
const NAME: &str = "loan";

/// References to a block's array that are expected at its end: ours, and that of the variable in
/// `with ... as image`.
const EXPECTED_REFERENCES: isize = 2;

/// An image that is written directly into shared memory: a context manager that gives a writeable numpy array
/// and sends it at the end of the block. Nothing is copied.
///
/// After the block the array is read-only: its memory belongs to the subscribers and will be reused.
///
/// If anything besides one variable still refers to the array at the end of the block (a view such as
/// `image[..., 0]`, a memoryview, a tensor, a list, a second variable), the image is copied once and the copy
/// is sent. `Publisher.copied` counts such copies. Drop such references inside the block to avoid the copy.
///
/// Do not replace the variable by a tensor or a memoryview of the same memory: this is not detected, and
/// writing to it after the block changes what subscribers see.
///
/// If the block ends with an exception, nothing is sent.
#[pyclass(frozen, name = "Loan", module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct PyLoan {
    port: Arc<ImageTopic>,
    capture: Mutex<ImageStamp>,
    open: Mutex<Option<OpenArrays>>,
}

/// The arrays of a block.
#[derive(Debug)]
struct OpenArrays {
    chunk: Py<LoanChunk>,
    // The base of `image` and of all of its views, so that its references count the views.
    root: Py<PyAny>,
    image: Py<PyAny>,
}

/// The chunk under the arrays of a block.
#[pyclass(frozen, name = "_Chunk", module = "nunet_py")]
#[derive(Debug)]
struct LoanChunk {
    address: usize,
    len: usize,
    // A fork must not release it. The chunk is dropped before what keeps it mapped.
    kept: ForkGuard<KeptLoan>,
}

#[derive(Debug)]
struct KeptLoan {
    loan: Mutex<Option<nunet_ipc::Loan>>,
    _anchor: Anchor,
}

// SAFETY: the loan borrows the chunk that `address` and `len` describe, so no other image is written to it.
// When the loan is sent, arrays are read-only and no view is left (`PyLoan::settle`). The anchor is a chunk
// of the same mapping and keeps it mapped.
unsafe impl Memory for LoanChunk {
    const WRITEABLE: bool = true;

    fn bytes(&self) -> (*mut u8, usize) {
        (std::ptr::with_exposed_provenance_mut(self.address), self.len)
    }
}

impl LoanChunk {
    fn new(mut loan: nunet_ipc::Loan, anchor: Anchor) -> Self {
        let bytes = loan.bytes_mut();
        let (address, len) = (bytes.as_mut_ptr().expose_provenance(), bytes.len());
        let kept = KeptLoan { loan: Mutex::new(Some(loan)), _anchor: anchor };
        Self { address, len, kept: ForkGuard::new(kept) }
    }

    fn loan(&self) -> PyResult<MutexGuard<'_, Option<nunet_ipc::Loan>>> {
        Ok(self.kept.get(NAME)?.loan.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The chunk at the end of a block.
enum Settled {
    /// No array can write to it.
    Free(nunet_ipc::Loan),
    /// An array may write to it, so it stays on loan until the array is dropped.
    Shared(Py<LoanChunk>),
}

impl PyLoan {
    pub(super) fn new(port: Arc<ImageTopic>, capture: ImageStamp) -> Self {
        Self { port, capture: Mutex::new(capture), open: Mutex::new(None) }
    }

    /// Makes the arrays read-only and finds out whether the chunk can be sent as it is.
    ///
    /// A reference to the array does not tell whether it is a variable, which cannot write any more, or a
    /// buffer that kept the right to write. One reference is taken for the variable of the block; more mean
    /// that the image is copied.
    fn settle(py: Python<'_>, open: &OpenArrays) -> PyResult<Settled> {
        for array in [&open.image, &open.root] {
            array.call_method1(py, "setflags", (false,))?; // write=False
        }
        // `image` is the one expected view of `root`.
        if references(open.root.bind(py)) <= EXPECTED_REFERENCES
            && references(open.image.bind(py)) <= EXPECTED_REFERENCES
            && let Some(loan) = open.chunk.get().loan()?.take()
        {
            return Ok(Settled::Free(loan));
        }
        Ok(Settled::Shared(open.chunk.clone_ref(py)))
    }

    fn send(&self, settled: Settled) -> PyResult<()> {
        let capture = *self.capture.lock().unwrap_or_else(PoisonError::into_inner);
        match settled {
            Settled::Free(loan) => self.port.send(loan, capture).map(drop),
            Settled::Shared(chunk) => match chunk.get().loan()?.as_mut() {
                Some(original) => self.port.send_copy(original.bytes_mut(), capture).map(drop),
                None => Ok(()),
            },
        }
    }
}

#[pymethods]
impl PyLoan {
    /// Borrow memory and return its array: uint8 of the publisher's shape, with the pixels of an earlier
    /// image.
    fn __enter__(slf: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        let py = slf.py();
        let this = slf.get();
        let chunk = Bound::new(py, LoanChunk::new(this.port.chunk()?, this.port.anchor()?))?;
        let root = this.port.source.layout.array(&chunk)?;
        let image = root.call_method0("view")?;
        let given = image.clone().unbind();
        // Locked last: the Python code above lets other threads run, which may enter this loan too.
        let mut open = this.open.lock().unwrap_or_else(PoisonError::into_inner);
        if open.is_some() {
            return Err(hinted::<NunetError>("this loan is already open", "make a loan for each image"));
        }
        *open = Some(OpenArrays { chunk: chunk.unbind(), root: root.unbind(), image: image.unbind() });
        Ok(given)
    }

    /// Send the image, or release the memory if the block failed.
    #[pyo3(signature = (exception, *_rest))]
    fn __exit__(
        &self,
        py: Python<'_>,
        exception: &Bound<'_, PyAny>,
        _rest: &Bound<'_, PyTuple>,
    ) -> PyResult<()> {
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(open) = open else { return Ok(()) };
        let settled = Self::settle(py, &open)?;
        drop(open);
        if exception.is_none() { self.send(settled) } else { Ok(()) }
    }

    /// Capture time, nanoseconds of the publisher's clock; `None` for the end of the block. Can be set inside
    /// the block.
    #[getter]
    fn capture_nanos(&self) -> Option<i64> {
        self.capture.lock().unwrap_or_else(PoisonError::into_inner).nanos
    }

    #[setter]
    fn set_capture_nanos(&self, nanos: &Bound<'_, PyAny>) -> PyResult<()> {
        let nanos = argument::capture_nanos(nanos)?;
        ImageStamp { nanos, sequence: None }.check()?;
        self.capture.lock().unwrap_or_else(PoisonError::into_inner).nanos = nanos;
        Ok(())
    }
}
