#![expect(unsafe_code, reason = "promises that a borrowed chunk stays in place while its object lives")]
//! A picture that is filled where its readers will see it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::layout::Layout;
use super::names;
use super::publisher::{Capture, Publisher};
use super::view::{Memory, references};
use crate::error::NunetError;
use crate::own::Own;

/// What this class is called in messages.
const NAME: &str = "loan";

/// A chunk that keeps the publisher's memory mapped, without keeping the camera.
pub(super) type Anchor = Arc<Mutex<nunet_ipc::Loan>>;

/// A picture that is filled in shared memory: a context manager that gives a writeable numpy array and sends it at the
/// end of the block. Nothing is copied.
///
/// After the block the array is read-only: its memory belongs to the readers, and later pictures overwrite it. Where
/// something else than the variables of the block's own function still looks at the array then (a view such as
/// `picture[..., 0]`, a memoryview, a tensor, a list, an attribute), it could write to what readers see; the picture is
/// copied once and sent, and `Publisher.copied` counts it. Let go of such things before the end of the block to save the copy. When the block ends with an exception, nothing is sent.
#[pyclass(frozen, module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct Loan {
    publisher: Py<Publisher>,
    layout: Layout,
    capture: Mutex<Capture>,
    open: Mutex<Option<Open>>,
}

/// The arrays of a block.
#[derive(Debug)]
struct Open {
    memory: Py<Chunk>,
    // numpy makes views of `picture` views of this one, so that they can be counted.
    root: Py<PyAny>,
    picture: Py<PyAny>,
}

/// The chunk behind a picture's arrays.
#[pyclass(frozen, name = "_Chunk", module = "nunet_py")]
#[derive(Debug)]
struct Chunk {
    address: usize,
    len: usize,
    // A fork must give nothing back. The chunk comes before what keeps it mapped.
    kept: Own<Kept>,
}

#[derive(Debug)]
struct Kept {
    loan: Mutex<Option<nunet_ipc::Loan>>,
    _anchor: Anchor,
}

// SAFETY: the loan borrows the chunk that `address` and `len` describe, so nobody else writes to it; when the loan is
// sent, no array is left that may write (`Loan::settle`). The anchor is a chunk of the same mapping and keeps it.
unsafe impl Memory for Chunk {
    const WRITEABLE: bool = true;

    fn bytes(&self) -> (*mut u8, usize) {
        (std::ptr::with_exposed_provenance_mut(self.address), self.len)
    }
}

impl Chunk {
    fn new(mut loan: nunet_ipc::Loan, anchor: Anchor) -> Self {
        let bytes = loan.bytes_mut();
        let (address, len) = (bytes.as_mut_ptr().expose_provenance(), bytes.len());
        let kept = Kept { loan: Mutex::new(Some(loan)), _anchor: anchor };
        Self { address, len, kept: Own::new(kept) }
    }

    fn loan(&self) -> PyResult<MutexGuard<'_, Option<nunet_ipc::Loan>>> {
        Ok(self.kept.get(NAME)?.loan.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// What leaves a block.
enum Settled {
    /// Nobody can write to it any more.
    Free(nunet_ipc::Loan),
    /// Somebody can, so it stays on loan until they are gone.
    Shared(Py<Chunk>),
}

impl Loan {
    pub(super) fn new(publisher: Py<Publisher>, layout: Layout, capture: Capture) -> Self {
        Self { publisher, layout, capture: Mutex::new(capture), open: Mutex::new(None) }
    }

    /// Takes the block's arrays away from it.
    fn settle(py: Python<'_>, open: &Open) -> PyResult<Settled> {
        for array in [&open.picture, &open.root] {
            array.call_method1(py, "setflags", (false,))?; // write=False
        }
        // One reference of ours each; beside it the root has the picture.
        if references(open.root.bind(py)) <= 2
            && names::are_all(open.picture.bind(py), 1)
            && let Some(loan) = open.memory.get().loan()?.take()
        {
            return Ok(Settled::Free(loan));
        }
        Ok(Settled::Shared(open.memory.clone_ref(py)))
    }

    fn send(&self, settled: Settled) -> PyResult<()> {
        let capture = *self.capture.lock().unwrap_or_else(PoisonError::into_inner);
        let publisher = self.publisher.get();
        match settled {
            Settled::Free(loan) => publisher.send(loan, capture).map(drop),
            Settled::Shared(chunk) => {
                let mut kept = chunk.get().loan()?;
                let Some(original) = kept.as_mut() else { return Ok(()) };
                let mut copy = publisher.chunk()?;
                copy.bytes_mut().copy_from_slice(original.bytes_mut());
                drop(kept);
                publisher.count_copy();
                publisher.send(copy, capture).map(drop)
            }
        }
    }
}

#[pymethods]
impl Loan {
    /// Borrow memory and give its array: uint8 of the publisher's shape, with whatever an earlier picture left in it.
    fn __enter__(slf: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        let py = slf.py();
        let this = slf.get();
        let publisher = this.publisher.get();
        let memory = Bound::new(py, Chunk::new(publisher.chunk()?, publisher.anchor()?))?;
        let root = this.layout.array(&memory)?;
        let picture = root.call_method0("view")?;
        let given = picture.clone().unbind();
        // Locked last: Python code above lets other threads run, and one of them may enter this loan too.
        let mut open = this.open.lock().unwrap_or_else(PoisonError::into_inner);
        if open.is_some() {
            return Err(NunetError::new_err("this loan is open already\nhint: take a loan for each picture"));
        }
        *open = Some(Open { memory: memory.unbind(), root: root.unbind(), picture: picture.unbind() });
        Ok(given)
    }

    /// Send the picture, or give the memory back when the block failed.
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

    /// When the picture was taken, nanoseconds of the loan's clock; `None` is the end of the block. May be set inside of
    /// the block.
    #[getter]
    fn capture_nanos(&self) -> Option<i64> {
        self.capture.lock().unwrap_or_else(PoisonError::into_inner).nanos
    }

    #[setter]
    fn set_capture_nanos(&self, nanos: Option<i64>) {
        self.capture.lock().unwrap_or_else(PoisonError::into_inner).nanos = nanos;
    }
}
