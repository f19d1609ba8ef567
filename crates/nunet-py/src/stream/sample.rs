#![expect(unsafe_code, reason = "promises that a received message stays in place while its object lives")]
//! One message in shared memory, which its arrays keep alive.

use std::sync::Mutex;

use numpy::{PyArrayDescr, dtype};
use nunet_ipc::Topic;
use pyo3::prelude::*;

use super::header::VIOLATION;
use crate::error::{NunetError, hinted};
use crate::fork_guard::ForkGuard;
use crate::memory::{ArrayLayout, Memory, array};

/// Bytes of a float, the largest array element here.
const ELEMENT: usize = size_of::<f32>();

/// One message of a topic. Its memory stays unchanged until this object and all of its arrays are dropped,
/// even after the subscriber, the daemon and the frame are gone.
#[pyclass(frozen, name = "_Sample", module = "nunet_py")]
#[derive(Debug)]
pub(super) struct TopicMessage {
    // A copy, because the sender could change the original after it was checked.
    header: Box<nunet_ipc::FrameHeader>,
    address: usize,
    len: usize,
    topic: Topic,
    // A fork must not release it. The lock is never taken: it makes the frame `Sync`.
    _frame: ForkGuard<Mutex<nunet_ipc::Message>>,
}

// SAFETY: `_frame` borrows the chunk that `address` and `len` describe, and keeps it mapped and unchanged
// until it is dropped with this object. A fork never drops it, and inherits the mapping.
unsafe impl Memory for TopicMessage {
    const WRITEABLE: bool = false;

    fn bytes(&self) -> (*mut u8, usize) {
        (std::ptr::with_exposed_provenance_mut(self.address), self.len)
    }
}

impl TopicMessage {
    pub(super) fn new(frame: nunet_ipc::Message) -> Self {
        let bytes = frame.bytes();
        Self {
            header: Box::new(*frame.header()),
            address: bytes.as_ptr().expose_provenance(),
            len: bytes.len(),
            topic: frame.topic(),
            _frame: ForkGuard::new(Mutex::new(frame)),
        }
    }

    pub(super) fn header(&self) -> &nunet_ipc::FrameHeader {
        &self.header
    }

    pub(super) fn topic(&self) -> Topic {
        self.topic
    }

    /// The payload, in shared memory.
    pub(super) fn payload(&self) -> &[u8] {
        let (address, len) = self.bytes();
        // SAFETY: `bytes` of `Memory` are mapped and unchanged for as long as `self` lives; numbers of any
        // value are bytes.
        unsafe { std::slice::from_raw_parts(address, len) }
    }

    /// Rows and columns of pixels.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.header.height as usize, self.header.width as usize)
    }

    /// The grid of a payload with so many bytes per pixel.
    pub(super) fn grid(&self, cell_bytes: usize) -> PyResult<Grid> {
        let (rows, columns) = self.size();
        self.cells(rows, columns, cell_bytes)
    }

    /// The grid of a payload with so many rows and columns.
    ///
    /// # Errors
    /// `NunetError` if the header contradicts itself.
    pub(super) fn cells(&self, rows: usize, columns: usize, cell_bytes: usize) -> PyResult<Grid> {
        let row_bytes = columns.saturating_mul(cell_bytes);
        let stride = match self.header.row_stride_bytes as usize {
            0 => row_bytes,
            stride => stride,
        };
        // Depth and points are floats: numpy reads rows that are not aligned to them slowly or not at all.
        let straddles = cell_bytes.is_multiple_of(ELEMENT) && !stride.is_multiple_of(ELEMENT);
        if rows == 0 || columns == 0 || stride < row_bytes || straddles {
            let topic = self.topic;
            return Err(hinted::<NunetError>(
                format!(
                    "a message of topic `{topic}` contradicts itself: {columns}x{rows} cells of {cell_bytes} bytes in \
                     rows of {stride} bytes"
                ),
                VIOLATION,
            ));
        }
        Ok(Grid { rows, columns, stride: stride as isize })
    }
}

/// The grid of cells in a payload.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) stride: isize,
}

impl Grid {
    /// One element per cell, `offset` bytes into it.
    pub(super) fn plane(self, cell_bytes: isize, offset: usize) -> ArrayLayout<2> {
        ArrayLayout { lengths: [self.rows, self.columns], strides: [self.stride, cell_bytes], offset }
    }

    /// Three elements per cell, the first of them `offset` bytes into it, `step` bytes apart.
    pub(super) fn triples(self, cell_bytes: isize, offset: usize, step: isize) -> ArrayLayout<3> {
        ArrayLayout {
            lengths: [self.rows, self.columns, 3],
            strides: [self.stride, cell_bytes, step],
            offset,
        }
    }
}

/// The element type of an array of `T`.
pub(super) fn element<T: numpy::Element>(py: Python<'_>) -> Bound<'_, PyArrayDescr> {
    dtype::<T>(py)
}

/// An array with one element per cell.
pub(super) fn plane<'py, T: numpy::Element>(
    sample: &Bound<'py, TopicMessage>,
    cell_bytes: usize,
    offset: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let shape = sample.get().grid(cell_bytes)?.plane(cell_bytes as isize, offset);
    array(sample, element::<T>(sample.py()), shape)
}
