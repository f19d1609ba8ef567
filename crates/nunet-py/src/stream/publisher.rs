//! `publisher`: images for a daemon, or for any other subscriber of a camera.

use std::sync::Arc;

use nunet_ipc::{Clock, Limits};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::errors::camera_name;
use super::layout::ImageLayout;
use super::loan::PyLoan;
use super::port::{ImageOrigin, ImageStamp, ImageTopic};
use crate::argument;
use crate::array::import_numpy;
use crate::camera::{PyCamera, intrinsics_argument, whole_size};
use crate::error::{hinted, of_camera};

// The default of `readers`: a literal, because Python shows it.
const _: () = assert!(Limits::DEFAULT.max_readers == 4);

pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyPublisher>()?;
    module.add_function(wrap_pyfunction!(publisher, module)?)
}

/// Publish the images of a camera, for `nunetd --source shm:CAMERA` and other subscribers.
///
/// Parameters
/// ----------
/// camera : str
///     The camera's name: 1 to 64 of `a-z A-Z 0-9 _ - .`.
/// size : tuple of int
///     Width and height of all images, pixels.
/// encoding : str, optional
///     The encoding of the images: `rgb8`, `bgr8` (OpenCV), `mono8`, `yuyv` or `nv12`.
/// intrinsics : Camera, optional
///     The camera's intrinsics and distortion. They are sent with every image, and the daemon scales meters
///     by them.
/// clock : str, optional
///     The clock of capture times: `monotonic` (`time.monotonic_ns()`), `unix` (`time.time_ns()`) or `media`
///     (the position in a recording).
/// frame_id : str, optional
///     The name of the camera's coordinate frame.
/// readers : int, optional
///     The largest number of subscribers at a time; a daemon counts as one. Memory is reserved for them.
///
/// Returns
/// -------
/// Publisher
///     A context manager that stops publishing at the end of its block.
///
/// Raises
/// ------
/// NunetError
///     Another process publishes this camera (the text names it), or `/dev/shm` is too small.
/// CameraError
///     The aspect ratio of `intrinsics` is not that of `size`.
/// ValueError
///     An invalid name, size, encoding or clock, or a `frame_id` of more than 64 bytes.
/// TypeError
///     An argument of another type, such as a list for `size`.
///
/// Examples
/// --------
/// >>> import numpy as np, nunet_py as nunet
/// >>> with nunet.publisher("front", size=(640, 480)) as camera:
/// ...     camera.publish(np.zeros((480, 640, 3), np.uint8))  # copied once, into shared memory
/// ...     with camera.loan() as image:     # or written there: no copy
/// ...         image[:] = 0
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
    #[pyo3(from_py_with = intrinsics_argument)] intrinsics: Option<PyCamera>,
    #[pyo3(from_py_with = argument::clock)] clock: &str,
    #[pyo3(from_py_with = argument::frame_id)] frame_id: &str,
    #[pyo3(from_py_with = argument::readers)] readers: u32,
) -> PyResult<PyPublisher> {
    import_numpy(py)?;
    let camera = camera_name(camera)?;
    let size = whole_size(size)?;
    let layout = ImageLayout::new(size, encoding)?;
    let camera_info = intrinsics.map(|camera| camera.0.fitted_to(size.width, size.height)).transpose();
    let camera_info = camera_info.map_err(of_camera)?;
    let clock = clock_of(clock)?;
    let source = ImageOrigin { camera, layout, camera_info, clock, frame_id: frame_id.to_owned() };
    Ok(PyPublisher { port: Arc::new(ImageTopic::create(py, source, readers)?) })
}

/// The clock by its name.
pub(super) fn clock_of(name: &str) -> PyResult<Clock> {
    name.parse().map_err(|_| {
        let choices: Vec<_> = Clock::ALL.iter().map(|clock| format!("`{clock}`")).collect();
        hinted::<PyValueError>(
            format!("`clock` is `{name}`; expected a clock of capture times"),
            format!("pass one of {}", choices.join(", ")),
        )
    })
}

/// The publisher of a camera's images. Subscribers that are slow, hold frames or crash do not affect it. A
/// late subscriber receives the last image.
///
/// Several threads may share a publisher. A forked process must make its own, under another name.
#[pyclass(frozen, name = "Publisher", module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct PyPublisher {
    port: Arc<ImageTopic>,
}

#[pymethods]
impl PyPublisher {
    /// Send an image. It is copied once, into shared memory; `loan` avoids the copy.
    ///
    /// Parameters
    /// ----------
    /// image : numpy.ndarray
    ///     uint8, C-contiguous, of this publisher's `shape`, rows from the top.
    /// capture_nanos : int, optional
    ///     Capture time, nanoseconds of the publisher's clock. By default the current time, or 0 for the
    ///     clock `media`.
    /// sequence : int, optional
    ///     The image's number, which should increase. By default the next one.
    ///
    /// Returns
    /// -------
    /// int
    ///     The image's number.
    ///
    /// Raises
    /// ------
    /// TypeError
    ///     `image` is not a numpy array of uint8, or another argument is not a whole number.
    /// ValueError
    ///     The array has another shape or is not C-contiguous, or `capture_nanos` is negative.
    /// NunetError
    ///     This publisher is closed.
    #[pyo3(signature = (image, capture_nanos = None, *, sequence = None))]
    fn publish(
        &self,
        image: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = argument::capture_nanos)] capture_nanos: Option<i64>,
        #[pyo3(from_py_with = argument::sequence)] sequence: Option<u64>,
    ) -> PyResult<u64> {
        let image = self.port.source.layout.check(image)?;
        let mut chunk = self.port.chunk()?;
        chunk.bytes_mut().copy_from_slice(image.as_slice()?);
        self.port.send(chunk, ImageStamp { nanos: capture_nanos, sequence })
    }

    /// Write an image directly into shared memory: nothing is copied.
    ///
    /// Parameters
    /// ----------
    /// capture_nanos : int, optional
    ///     Capture time, nanoseconds of the publisher's clock. By default the end of the block, or 0 for the
    ///     clock `media`.
    /// sequence : int, optional
    ///     The image's number, which should increase. By default the next one.
    ///
    /// Returns
    /// -------
    /// Loan
    ///     A context manager. It gives a writeable uint8 array of this publisher's `shape`, with the pixels
    ///     of an earlier image, and sends it at the end of the block. Then the array is read-only.
    ///
    /// Raises
    /// ------
    /// TypeError
    ///     An argument is not a whole number.
    /// ValueError
    ///     `capture_nanos` is negative.
    /// NunetError
    ///     This publisher is closed; on entering also: arrays of earlier loans hold all memory.
    #[pyo3(signature = (capture_nanos = None, *, sequence = None))]
    fn loan(
        &self,
        #[pyo3(from_py_with = argument::capture_nanos)] capture_nanos: Option<i64>,
        #[pyo3(from_py_with = argument::sequence)] sequence: Option<u64>,
    ) -> PyResult<PyLoan> {
        let capture = ImageStamp { nanos: capture_nanos, sequence };
        capture.check()?;
        self.port.check_open()?;
        Ok(PyLoan::new(Arc::clone(&self.port), capture))
    }

    /// Send the last image to late subscribers now. Sending an image does the same, and so does a thread a
    /// few times per second.
    fn refresh(&self) -> PyResult<()> {
        self.port.refresh()
    }

    /// Stop publishing. Subscribers keep the frames that they have. Closing twice is not an error.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.port.close(py)
    }

    /// The camera's name.
    #[getter]
    fn camera(&self) -> &str {
        self.port.source.camera.as_str()
    }

    /// Width and height of all images, pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        let size = self.port.source.layout.size;
        (size.width, size.height)
    }

    /// The encoding of all images.
    #[getter]
    fn encoding(&self) -> &'static str {
        self.port.source.layout.encoding.name()
    }

    /// The shape of an image's array: (H, W, 3) for `rgb8` and `bgr8`, (H, W) for `mono8`, (H, W, 2) for
    /// `yuyv`, (H + H / 2, W) for `nv12`. For the last two, W is rounded up to an even number and H / 2 is
    /// rounded up.
    #[getter]
    fn shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.port.source.layout.lengths)
    }

    /// Whether there is a subscriber.
    #[getter]
    fn has_readers(&self) -> PyResult<bool> {
        self.port.has_readers()
    }

    /// Number of loans that were copied, because something besides one variable referred to their array at
    /// the end.
    #[getter]
    fn copied(&self) -> u64 {
        self.port.copied()
    }

    /// Whether `close` was called.
    #[getter]
    fn closed(&self) -> PyResult<bool> {
        self.port.is_closed()
    }

    fn __enter__(slf: Py<Self>) -> PyResult<Py<Self>> {
        slf.get().port.check_open()?;
        Ok(slf)
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) -> PyResult<()> {
        self.close(py)
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.size();
        format!("Publisher({:?}, {width}x{height} {})", self.camera(), self.encoding())
    }
}
