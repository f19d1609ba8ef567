//! `publisher`: pictures for a daemon, or for anybody else who reads a camera.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use nunet_core::camera;
use nunet_daemon::embed;
use nunet_ipc::{
    CameraName, Clock, Limits, Topic, TopicPlan, UnknownWord, Wake, monotonic_nanos, unix_nanos,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::late::Served;
use super::layout::Layout;
use super::loan::{Anchor, Loan};
use super::{camera_name, ipc_error};
use crate::argument;
use crate::camera::{Camera, whole_size};
use crate::error::{NunetError, of_camera};
use crate::own::Own;

/// What this class is called in messages.
const NAME: &str = "publisher";

// What `readers` is without being named: a literal, since Python shows it.
const _: () = assert!(Limits::DEFAULT.max_readers == 4);

/// Chunks on loan at a time: the anchor, the picture of an open block, the copy that is sent in its place, and one that
/// an array of an earlier block keeps.
const MAX_LOANS: usize = 4;

pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Publisher>()?;
    module.add_function(wrap_pyfunction!(publisher, module)?)
}

/// Become the publisher of a camera's pictures, for `nunetd --source shm:CAMERA` and everybody else who reads them.
///
/// Parameters
/// ----------
/// camera : str
///     The camera's name: 1 to 64 of `a-z A-Z 0-9 _ - .`.
/// size : tuple of int
///     Width and height of every picture, pixels.
/// encoding : str, optional
///     How the pictures' bytes lie: `rgb8`, `bgr8` (OpenCV's), `mono8`, `yuyv` or `nv12`.
/// intrinsics : Camera, optional
///     What is known of the lens; it travels with every picture, and the daemon's metres are scaled by it.
/// clock : str, optional
///     The clock of capture times: `monotonic` (`time.monotonic_ns()`), `unix` (`time.time_ns()`) or `media` (the position
///     in a recording).
/// frame_id : str, optional
///     The name of the camera's coordinate frame.
/// readers : int, optional
///     For how many readers memory is reserved; the daemon is one.
///
/// Returns
/// -------
/// Publisher
///     A context manager; leaving it gives the camera up.
///
/// Raises
/// ------
/// NunetError
///     Another process publishes this camera (the text names it), or `/dev/shm` is too small.
/// CameraError
///     `intrinsics` are of pictures of another shape.
/// ValueError
///     A name, size, encoding or clock that there is not.
/// TypeError
///     `size` is no pair of whole numbers, or another argument is of another type.
///
/// Examples
/// --------
/// >>> import nunet_py as nunet
/// >>> with nunet.publisher("front", size=(640, 480)) as camera:
/// ...     camera.publish(rgb)              # uint8 (480, 640, 3): copied once, into shared memory
/// ...     with camera.loan() as picture:   # or filled there: no copy
/// ...         picture[:] = 0
#[pyfunction]
#[pyo3(
    signature = (camera, size, *, encoding = "rgb8", intrinsics = None, clock = "monotonic", frame_id = "", readers = 4),
)]
#[expect(clippy::too_many_arguments, reason = "in Python they are keywords with defaults")]
fn publisher(
    py: Python<'_>,
    #[pyo3(from_py_with = argument::camera_name)] camera: &str,
    size: &Bound<'_, PyAny>,
    #[pyo3(from_py_with = argument::encoding)] encoding: &str,
    #[pyo3(from_py_with = argument::intrinsics)] intrinsics: Option<Camera>,
    #[pyo3(from_py_with = argument::clock)] clock: &str,
    #[pyo3(from_py_with = argument::frame_id)] frame_id: &str,
    #[pyo3(from_py_with = argument::readers)] readers: u32,
) -> PyResult<Publisher> {
    let camera = camera_name(camera)?;
    let size = whole_size(size)?;
    let layout = Layout::new(size, encoding)?;
    let optics =
        intrinsics.map(|camera| camera.0.fitted_to(size.0, size.1)).transpose().map_err(of_camera)?;
    let clock = clock.parse().map_err(|error: UnknownWord| {
        PyValueError::new_err(format!("{error}\nhint: for example clock=\"monotonic\""))
    })?;
    let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: layout.bytes() };
    let limits = Limits { max_readers: readers as usize, max_loans: MAX_LOANS, ..Limits::default() };
    let port = py
        .detach(|| nunet_ipc::Publisher::create(&camera, &[plan], &limits))
        .map_err(|error| ipc_error(&error))?;
    let anchor = port.loan(Topic::Rgb).map_err(|error| ipc_error(&error))?;
    let open = Open { anchor: Arc::new(Mutex::new(anchor)), port, sequence: 0 };
    // A failure is told to whoever sends the next picture: sending does the same.
    let open = Served::start(open, |open| drop(open.port.refresh()))?;
    Ok(Publisher {
        camera,
        layout,
        optics,
        clock,
        frame_id: frame_id.to_owned(),
        copied: AtomicU64::new(0),
        open: Own::new(open),
    })
}

/// The owner of a camera's pictures. Readers that are slow, keep frames or die take nothing away from it, and one that
/// comes late gets the last picture.
///
/// Methods may be called from several threads, one picture after the other. A process made by `os.fork` must make its
/// own, under another name.
#[pyclass(frozen, module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct Publisher {
    camera: CameraName,
    layout: Layout,
    optics: Option<camera::Camera>,
    clock: Clock,
    frame_id: String,
    copied: AtomicU64,
    open: Own<Served<Open>>,
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
        let now = match self.clock {
            Clock::Monotonic => monotonic,
            Clock::Unix => unix,
            Clock::Media => 0,
        };
        header.capture_nanos = capture.nanos.unwrap_or(now);
        header.set_capture_clock(self.clock);
        header.capture_unix_nanos = header.unix_of_capture(monotonic, unix);
        header.set_encoding(self.layout.encoding);
        (header.width, header.height) = self.layout.size;
        header.row_stride_bytes = self.layout.row_bytes;
        header.set_frame_id(&self.frame_id);
        if let Some(optics) = &self.optics {
            embed::set_camera(header, optics);
        }
    }
}

#[pymethods]
impl Publisher {
    /// Send a picture. It is copied once, into shared memory; `loan` saves that.
    ///
    /// Parameters
    /// ----------
    /// picture : numpy.ndarray
    ///     uint8, C-contiguous, of this publisher's `shape`, rows from the top.
    /// capture_nanos : int, optional
    ///     When it was taken, nanoseconds of the publisher's clock. Without it: now.
    /// sequence : int, optional
    ///     Its number, which should rise. Without it: the next one.
    ///
    /// Returns
    /// -------
    /// int
    ///     Its number.
    ///
    /// Raises
    /// ------
    /// TypeError
    ///     Anything but a numpy array of uint8.
    /// ValueError
    ///     Another shape, or memory that is not contiguous.
    /// NunetError
    ///     This publisher is closed.
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

    /// Fill a picture where its readers will see it: nothing is copied.
    ///
    /// Parameters
    /// ----------
    /// capture_nanos : int, optional
    ///     When it was taken, nanoseconds of the publisher's clock. Without it: the end of the block.
    /// sequence : int, optional
    ///     Its number, which should rise. Without it: the next one.
    ///
    /// Returns
    /// -------
    /// Loan
    ///     A context manager that gives a writeable uint8 array of this publisher's `shape`, with whatever an earlier picture
    ///     left in it, and sends it at the end of the block. The array is read-only from then on.
    ///
    /// Raises
    /// ------
    /// NunetError
    ///     This publisher is closed; on entering also: arrays of earlier loans hold all memory.
    #[pyo3(signature = (capture_nanos = None, *, sequence = None))]
    fn loan(slf: Py<Self>, capture_nanos: Option<i64>, sequence: Option<u64>) -> PyResult<Loan> {
        let layout = slf.get().layout.clone();
        slf.get().with(|_| Ok(()))?;
        Ok(Loan::new(slf, layout, Capture { nanos: capture_nanos, sequence }))
    }

    /// Hand the last picture to readers that came since. Sending does the same, and a thread does it a few times a second:
    /// call this where a reader should not wait for that.
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
    /// (H + H / 2, W) for `nv12`; of the last two W is rounded up to an even number, and so is H / 2.
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
