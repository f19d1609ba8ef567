#![expect(unsafe_code, reason = "promises that a received message stays in place while its object lives")]
//! One message in shared memory, as the thing that its arrays keep alive.

use std::sync::Mutex;

use numpy::{PyArrayDescr, dtype};
use nunet_ipc::Topic;
use pyo3::prelude::*;

use super::view::{Memory, Shape, array};
use crate::error::NunetError;
use crate::own::Own;

/// Bytes of a float, the largest of numpy's elements here.
const ELEMENT: usize = size_of::<f32>();

/// One message of a topic. Its memory stays as it is until this object and every array of it are gone, also after the
/// subscriber, the daemon and the frame are.
#[pyclass(frozen, name = "_Sample", module = "nunet_py")]
#[derive(Debug)]
pub(super) struct Sample {
    // Copies, because the sender could change the originals after they were checked.
    header: Box<nunet_ipc::FrameHeader>,
    address: usize,
    len: usize,
    topic: Topic,
    // A fork must not give it back. Nobody waits for the lock: nobody looks at the frame again.
    _frame: Own<Mutex<nunet_ipc::Frame>>,
}

// SAFETY: `_frame` borrows the chunk that `address` and `len` describe, and keeps it mapped and unchanged until it is
// dropped with this object. A fork never drops it, and inherits the mapping.
unsafe impl Memory for Sample {
    const WRITEABLE: bool = false;

    fn bytes(&self) -> (*mut u8, usize) {
        (std::ptr::with_exposed_provenance_mut(self.address), self.len)
    }
}

impl Sample {
    pub(super) fn new(frame: nunet_ipc::Frame) -> Self {
        let bytes = frame.bytes();
        Self {
            header: Box::new(*frame.header()),
            address: bytes.as_ptr().expose_provenance(),
            len: bytes.len(),
            topic: frame.topic(),
            _frame: Own::new(Mutex::new(frame)),
        }
    }

    pub(super) fn header(&self) -> &nunet_ipc::FrameHeader {
        &self.header
    }

    pub(super) fn topic(&self) -> Topic {
        self.topic
    }

    /// Rows and columns of pixels.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.header.height as usize, self.header.width as usize)
    }

    /// Where the cells of a payload with so many bytes a pixel are.
    pub(super) fn grid(&self, cell_bytes: usize) -> PyResult<Grid> {
        let (rows, columns) = self.size();
        self.cells(rows, columns, cell_bytes)
    }

    /// Where so many rows and columns of cells are.
    pub(super) fn cells(&self, rows: usize, columns: usize, cell_bytes: usize) -> PyResult<Grid> {
        let row_bytes = columns.saturating_mul(cell_bytes);
        let stride = match self.header.row_stride_bytes as usize {
            0 => row_bytes,
            stride => stride,
        };
        // Depth and points are floats: numpy takes rows that begin between two, and reads them slowly or not at all.
        let straddles = cell_bytes.is_multiple_of(ELEMENT) && !stride.is_multiple_of(ELEMENT);
        if rows == 0 || columns == 0 || stride < row_bytes || straddles {
            return Err(NunetError::new_err(format!(
                "a message of topic `{}` contradicts itself: {columns}x{rows} cells of {cell_bytes} bytes in rows of \
                 {stride} bytes\nhint: the sender does not keep to the contract",
                self.topic
            )));
        }
        Ok(Grid { rows, columns, stride: stride as isize })
    }
}

/// Where the cells of a payload are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) stride: isize,
}

impl Grid {
    /// One element a cell, `offset` bytes into it.
    pub(super) fn plane(self, cell_bytes: isize, offset: usize) -> Shape<2> {
        Shape { lengths: [self.rows, self.columns], strides: [self.stride, cell_bytes], offset }
    }

    /// Three elements a cell, the first of them `offset` bytes into it, `step` bytes apart.
    pub(super) fn triples(self, cell_bytes: isize, offset: usize, step: isize) -> Shape<3> {
        Shape { lengths: [self.rows, self.columns, 3], strides: [self.stride, cell_bytes, step], offset }
    }
}

/// The first elements of numpy's own kinds.
pub(super) fn element<T: numpy::Element>(py: Python<'_>) -> Bound<'_, PyArrayDescr> {
    dtype::<T>(py)
}

/// One element a cell.
pub(super) fn plane<'py, T: numpy::Element>(
    sample: &Bound<'py, Sample>,
    cell_bytes: usize,
    offset: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let shape = sample.get().grid(cell_bytes)?.plane(cell_bytes as isize, offset);
    array(sample, element::<T>(sample.py()), shape)
}
