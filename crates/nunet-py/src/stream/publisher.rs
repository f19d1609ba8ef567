//! `publisher`: pictures for a daemon, or for anybody else who reads a camera.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use numpy::{
    PyArrayDyn, PyArrayMethods as _, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods as _,
};
use nunet_ipc::{CameraName, Clock, Encoding, Limits, Topic, TopicPlan, Wake, monotonic_nanos};
use pyo3::PyClass;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::frame::unix_nanos;
use super::loan::{Anchor, Loan};
use super::own::Own;
use super::sample::element;
use super::view::{Memory, Shape, array};
use super::{camera_name, ipc_error};
use crate::error::NunetError;

/// What this class is called in messages.
const NAME: &str = "publisher";

const ENCODINGS: [Encoding; 5] =
    [Encoding::Rgb8, Encoding::Bgr8, Encoding::Mono8, Encoding::Yuyv, Encoding::Nv12];

/// Pixels of a side: more is a slip of the finger.
const MAX_SIDE: u32 = 16_384;

/// Chunks on loan at a time: the anchor, the picture of an open block, the copy that is sent in its place, and one that
/// an array of an earlier block keeps.
const MAX_LOANS: usize = 4;

pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Publisher>()?;
    module.add_function(wrap_pyfunction!(publisher, module)?)
}

/// Become the publisher of a camera's pictures, for `nunetd --source shm:CAMERA` and everybody else who reads them.
///
/// `size` is (width, height) of every picture, `encoding` one of `rgb8`, `bgr8` (OpenCV's), `mono8`, `yuyv`, `nv12`.
/// `clock` is that of the capture times: `monotonic` (`time.monotonic_ns()`), `unix` (`time.time_ns()`) or `media` (the
/// position in a recording). `frame_id` names the camera's coordinate frame. `readers` is for how many readers memory is
/// reserved.
///
/// Returns a `Publisher`: a context manager.
///
/// Raises `NunetError` when another process publishes this camera (named in the text) or `/dev/shm` is too small, and
/// `ValueError` for a name, size or encoding that no camera has.
///
///     with nunet_py.publisher("front", size=(640, 480)) as camera:
///         camera.publish(rgb)                # uint8 (480, 640, 3), copied once into shared memory
///         with camera.loan() as picture:     # or filled there: no copy
///             picture[:] = 0
#[pyfunction]
#[pyo3(signature = (camera, size, *, encoding = "rgb8", clock = "monotonic", frame_id = "", readers = Limits::DEFAULT.max_readers))]
fn publisher(
    py: Python<'_>,
    camera: &str,
    size: (u32, u32),
    encoding: &str,
    clock: &str,
    frame_id: &str,
    readers: usize,
) -> PyResult<Publisher> {
    let camera = camera_name(camera)?;
    let layout = Layout::new(size, encoding)?;
    let clock =
        clock.parse().map_err(|error: nunet_ipc::UnknownWord| PyValueError::new_err(error.to_string()))?;
    let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: layout.bytes() };
    let limits = Limits { max_readers: readers, max_loans: MAX_LOANS, ..Limits::default() };
    let port = py
        .detach(|| nunet_ipc::Publisher::create(&camera, &[plan], &limits))
        .map_err(|error| ipc_error(&error))?;
    let anchor = port.loan(Topic::Rgb).map_err(|error| ipc_error(&error))?;
    let open = Open { anchor: Arc::new(Mutex::new(anchor)), port, sequence: 0 };
    Ok(Publisher {
        camera,
        layout,
        clock,
        frame_id: frame_id.to_owned(),
        copied: AtomicU64::new(0),
        open: Own::new(Mutex::new(Some(open))),
    })
}

/// The owner of a camera's pictures. Readers that are slow, keep frames or die take nothing away from it.
///
/// Methods may be called from several threads, one picture after the other. A process made by `os.fork` must make its
/// own, under another name.
#[pyclass(frozen, module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct Publisher {
    camera: CameraName,
    layout: Layout,
    clock: Clock,
    frame_id: String,
    copied: AtomicU64,
    open: Own<Mutex<Option<Open>>>,
}

#[derive(Debug)]
struct Open {
    // Given back before the port ends, unless an array still needs it.
    anchor: Anchor,
    port: nunet_ipc::Publisher,
    sequence: u64,
}

/// When a picture was taken, and its number: `None` is now, and the next one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Capture {
    pub(super) nanos: Option<i64>,
    pub(super) sequence: Option<u64>,
}

impl Publisher {
    fn open(&self) -> PyResult<MutexGuard<'_, Option<Open>>> {
        Ok(self.open.get(NAME)?.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Does something with what is open; never while Python code may run.
    fn with<T>(&self, action: impl FnOnce(&mut Open) -> Result<T, nunet_ipc::IpcError>) -> PyResult<T> {
        let mut open = self.open()?;
        let open = open.as_mut().ok_or_else(|| {
            NunetError::new_err(format!(
                "this publisher of camera `{}` is closed\nhint: use it inside of its `with` block, or make a new one",
                self.camera
            ))
        })?;
        action(open).map_err(|error| match error {
            nunet_ipc::IpcError::TooManyLoans { .. } => NunetError::new_err(format!(
                "no memory is left for another picture of camera `{}`: arrays of earlier loans still hold it\n\
                 hint: let go of the arrays and views of a loan before the next one",
                self.camera
            )),
            error => ipc_error(&error),
        })
    }

    /// A chunk for one picture.
    pub(super) fn chunk(&self) -> PyResult<nunet_ipc::Loan> {
        self.with(|open| open.port.loan(Topic::Rgb))
    }

    pub(super) fn anchor(&self) -> PyResult<Anchor> {
        self.with(|open| Ok(Arc::clone(&open.anchor)))
    }

    pub(super) fn count_copy(&self) {
        self.copied.fetch_add(1, Ordering::Relaxed);
    }

    /// Sends a filled chunk and wakes its readers; the picture's number.
    pub(super) fn send(&self, mut loan: nunet_ipc::Loan, capture: Capture) -> PyResult<u64> {
        self.with(|open| {
            let sequence = capture.sequence.unwrap_or(open.sequence);
            self.describe(loan.header_mut(), capture, sequence);
            loan.publish(monotonic_nanos())?;
            open.sequence = sequence.wrapping_add(1);
            open.port.notify(Wake::Picture)?;
            Ok(sequence)
        })
    }

    fn describe(&self, header: &mut nunet_ipc::FrameHeader, capture: Capture, sequence: u64) {
        *header = nunet_ipc::FrameHeader::default();
        header.sequence = sequence;
        let (monotonic, unix) = (monotonic_nanos(), unix_nanos());
        let (nanos, unix_nanos) = match (self.clock, capture.nanos) {
            (Clock::Monotonic, nanos) => {
                let nanos = nanos.unwrap_or(monotonic);
                (nanos, unix.saturating_sub(monotonic.saturating_sub(nanos)))
            }
            (Clock::Unix, nanos) => (nanos.unwrap_or(unix), nanos.unwrap_or(unix)),
            (Clock::Media, nanos) => (nanos.unwrap_or(0), unix),
        };
        header.capture_nanos = nanos;
        header.capture_unix_nanos = unix_nanos;
        header.set_capture_clock(self.clock);
        header.set_encoding(self.layout.encoding);
        (header.width, header.height) = self.layout.size;
        header.row_stride_bytes = self.layout.row_bytes();
        header.set_frame_id(&self.frame_id);
    }
}

#[pymethods]
impl Publisher {
    /// Send a picture: uint8, C-contiguous, of this publisher's shape (`Publisher.shape`). It is copied once, into
    /// shared memory; `loan` saves that.
    ///
    /// `capture_nanos` is when it was taken, nanoseconds of the publisher's clock; `None` is now. `sequence` is its
    /// number, which should rise; `None` is the next one.
    ///
    /// Returns the number. Raises `TypeError` for anything but a numpy array of uint8, `ValueError` for another shape
    /// and for memory that is not contiguous, `NunetError` when this publisher is closed.
    #[pyo3(signature = (picture, capture_nanos = None, *, sequence = None))]
    fn publish(
        &self,
        picture: &Bound<'_, PyAny>,
        capture_nanos: Option<i64>,
        sequence: Option<u64>,
    ) -> PyResult<u64> {
        let picture = self.layout.check(picture)?;
        let mut chunk = self.chunk()?;
        chunk.bytes_mut().copy_from_slice(picture.as_slice()?);
        self.send(chunk, Capture { nanos: capture_nanos, sequence })
    }

    /// A picture to be filled where its readers will see it: a context manager that gives a writeable uint8 array of
    /// this publisher's shape and sends it at the end of the block. See `Loan`.
    ///
    /// Arguments as for `publish`, but `capture_nanos=None` is the end of the block. Raises `NunetError` on entering
    /// when this publisher is closed, or when arrays of earlier loans hold all memory.
    #[pyo3(signature = (capture_nanos = None, *, sequence = None))]
    fn loan(slf: Py<Self>, capture_nanos: Option<i64>, sequence: Option<u64>) -> PyResult<Loan> {
        let layout = slf.get().layout.clone();
        slf.get().with(|_| Ok(()))?;
        Ok(Loan::new(slf, layout, Capture { nanos: capture_nanos, sequence }))
    }

    /// Hand the last picture to readers that came since. Sending does the same; call this from time to time while
    /// there is nothing to send.
    fn refresh(&self) -> PyResult<()> {
        self.with(|open| open.port.refresh())
    }

    /// Give the camera up. Readers keep the frames they have. Closing twice is no error.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let open = self.open()?.take();
        py.detach(|| drop(open));
        Ok(())
    }

    /// The camera's name.
    #[getter]
    fn camera(&self) -> &str {
        self.camera.as_str()
    }

    /// (width, height) of every picture.
    #[getter]
    fn size(&self) -> (u32, u32) {
        self.layout.size
    }

    /// How every picture's bytes are laid out.
    #[getter]
    fn encoding(&self) -> &'static str {
        self.layout.encoding.name()
    }

    /// The shape of every picture's array: (H, W, 3) for `rgb8` and `bgr8`, (H, W) for `mono8`, (H, W, 2) for `yuyv`,
    /// (H * 3 / 2, W) for `nv12`.
    #[getter]
    fn shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.layout.lengths)
    }

    /// Whether anybody reads the pictures.
    #[getter]
    fn has_readers(&self) -> PyResult<bool> {
        self.with(|open| Ok(open.port.has_readers(Topic::Rgb)))
    }

    /// Loans that were copied because something still looked at them when they were sent.
    #[getter]
    fn copied(&self) -> u64 {
        self.copied.load(Ordering::Relaxed)
    }

    /// Whether `close` was called.
    #[getter]
    fn closed(&self) -> PyResult<bool> {
        Ok(self.open()?.is_none())
    }

    fn __enter__(slf: Py<Self>) -> PyResult<Py<Self>> {
        slf.get().with(|_| Ok(()))?;
        Ok(slf)
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) -> PyResult<()> {
        self.close(py)
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.layout.size;
        format!("Publisher({:?}, {width}x{height} {})", self.camera.as_str(), self.layout.encoding)
    }
}

/// How a camera's pictures lie in memory.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    encoding: Encoding,
    size: (u32, u32),
    lengths: Vec<usize>,
}

impl Layout {
    fn new(size: (u32, u32), encoding: &str) -> PyResult<Self> {
        let known = ENCODINGS.into_iter().find(|known| known.name() == encoding);
        let Some(known) = known else {
            let choices: Vec<_> = ENCODINGS.iter().map(|known| format!("`{known}`")).collect();
            return Err(PyValueError::new_err(format!(
                "`{encoding}` is no encoding of pictures\nhint: one of {}",
                choices.join(", ")
            )));
        };
        let (columns, rows) = size;
        let even = |side: u32| side.is_multiple_of(2);
        let fits = match known {
            Encoding::Yuyv => even(columns),
            Encoding::Nv12 => even(columns) && even(rows),
            _ => true,
        };
        if ![columns, rows].iter().all(|side| (1..=MAX_SIDE).contains(side)) || !fits {
            let even = if fits { "" } else { ", even for this encoding" };
            return Err(PyValueError::new_err(format!(
                "size is `{columns}x{rows}` for `{known}`, but expected (width, height) of 1 to {MAX_SIDE}{even}\n\
                 hint: for example size=(640, 480)"
            )));
        }
        let (columns, rows) = (columns as usize, rows as usize);
        let lengths = match known {
            Encoding::Mono8 => vec![rows, columns],
            Encoding::Yuyv => vec![rows, columns, 2],
            Encoding::Nv12 => vec![rows * 3 / 2, columns],
            _ => vec![rows, columns, 3],
        };
        Ok(Self { encoding: known, size, lengths })
    }

    fn bytes(&self) -> usize {
        self.lengths.iter().product()
    }

    fn row_bytes(&self) -> u32 {
        self.lengths[1..].iter().product::<usize>() as u32 // at most 16384 * 3
    }

    /// The array of a picture in this memory.
    pub(super) fn array<'py, M>(&self, owner: &Bound<'py, M>) -> PyResult<Bound<'py, PyAny>>
    where
        M: Memory + PyClass<Frozen = pyo3::pyclass::boolean_struct::True> + Sync,
    {
        let bytes = element::<u8>(owner.py());
        if let [rows, columns, channels] = self.lengths[..] {
            let strides = [(columns * channels) as isize, channels as isize, 1];
            return array(owner, bytes, Shape { lengths: [rows, columns, channels], strides, offset: 0 });
        }
        let lengths = [self.lengths[0], self.lengths[1]];
        array(owner, bytes, Shape { lengths, strides: [lengths[1] as isize, 1], offset: 0 })
    }

    /// A picture that may be sent as it lies.
    fn check<'py>(&self, picture: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArrayDyn<'py, u8>> {
        let untyped = picture.cast::<PyUntypedArray>().map_err(|_| {
            let kind = picture.get_type().name().map_or_else(|_| "?".to_owned(), |name| name.to_string());
            PyTypeError::new_err(format!(
                "the picture is a `{kind}`, but expected a numpy array of uint8\n\
                 hint: numpy.asarray(picture, dtype=numpy.uint8)"
            ))
        })?;
        let bytes = picture.cast::<PyArrayDyn<u8>>().map_err(|_| {
            PyTypeError::new_err(format!(
                "the picture has dtype `{}`, but expected `uint8`\n\
                 hint: picture.astype(numpy.uint8), after scaling it to 0..255",
                untyped.dtype()
            ))
        })?;
        if untyped.shape() != self.lengths {
            return Err(PyValueError::new_err(format!(
                "the picture has shape {:?}, but this publisher sends {:?} ({})\n\
                 hint: resize it, or make a publisher of its size",
                untyped.shape(),
                self.lengths,
                self.encoding
            )));
        }
        if !untyped.is_c_contiguous() {
            return Err(PyValueError::new_err(format!(
                "the picture is not contiguous: its strides are {:?}\nhint: numpy.ascontiguousarray(picture)",
                untyped.strides()
            )));
        }
        bytes.try_readonly().map_err(|_| {
            PyValueError::new_err(
                "the picture is being written to at this moment\nhint: let the other thread finish first",
            )
        })
    }
}
