//! `subscribe`: the frames of a running daemon.

use std::time::{Duration, Instant};

use nunet_ipc::{CameraName, IpcError, Reader, Topic};
use pyo3::exceptions::PyTimeoutError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::errors::{camera_name, ipc_error};
use super::feed::{Arrival, BorrowedFeed, Feed, SharedFeed, TakenFeed};
use super::frame::PyFrame;
use super::sample::TopicMessage;
use super::stats::PyStats;
use super::topics::{TOPICS, topics_of};
use super::wait::{self, Deadline, MAX_WAIT};
use crate::argument;
use crate::array::import_numpy;
use crate::error::{NunetError, hinted};
use crate::fork_guard::ForkGuard;

/// The name of the class in messages.
const NAME: &str = "subscriber";

pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Subscriber>()?;
    module.add_function(wrap_pyfunction!(subscribe, module)?)
}

/// Subscribe to a camera that a running `nunetd` publishes. Frames are not copied.
///
/// Parameters
/// ----------
/// camera : str
///     The camera's name, as in `nunetd --camera`.
/// topics : sequence of str, optional
///     The content of each frame: any of `rgb`, `depth` (the default), `labels`, `confidence`, `cloud`,
///     `obstacles` and `stats`. Cloud, labels and obstacles are computed only while there is a subscriber.
///     `rgb` comes from the camera's own publisher (`nunetd feed`, `nunet_py.publisher`), with its depth.
/// timeout : float, optional
///     Seconds to wait for the daemon, and later for each frame. `None` and `math.inf` wait without limit.
///
/// Returns
/// -------
/// Subscriber
///     A context manager, and an iterator over frames, with `for` or `async for`.
///
/// Raises
/// ------
/// TimeoutError
///     The camera or one of the topics is not published.
/// ContractVersionError
///     The daemon has another version of the shared-memory contract.
/// NunetError
///     The daemon has no room for another subscriber.
/// ValueError
///     An invalid camera name or topic, or a negative timeout.
///
/// Examples
/// --------
/// >>> import nunet_py as nunet
/// >>> with nunet.subscribe("front", topics=["depth", "cloud"], timeout=1.0) as frames:
/// ...     for frame in frames:
/// ...         print(frame.sequence, frame.depth.shape, frame.age)
#[pyfunction]
#[pyo3(
    signature = (camera, topics = None, timeout = Some(5.0)),
    text_signature = "(camera, topics=None, timeout=5.0)"
)]
fn subscribe(
    py: Python<'_>,
    #[pyo3(from_py_with = argument::camera_name)] camera: &str,
    topics: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = argument::timeout)] timeout: Option<f64>,
) -> PyResult<Subscriber> {
    import_numpy(py)?;
    let camera = camera_name(camera)?;
    let topics = topics.map_or_else(|| Ok(vec![Topic::Depth]), topics_of)?;
    let timeout = wait::timeout(timeout)?;
    let reader = open(py, &camera, &topics, timeout)?;
    let feed = ForkGuard::new(SharedFeed::new(Feed::new(reader, topics.clone())));
    Ok(Subscriber { camera, topics, timeout, feed })
}

/// The newest frames of a camera: an iterator, an asynchronous iterator and a context manager.
///
/// Each frame holds all subscribed topics of one image. Frames older than the newest complete one are
/// skipped, so a slow loop delays no other process. Waiting takes no CPU time, releases the GIL, and is ended
/// by Ctrl-C. `async for` lets other tasks run; a canceled task loses at most one frame.
///
/// If the daemon ends or is killed, the next frame raises `TimeoutError` with the reason. Once it runs again,
/// the same subscriber continues. The loop ends when the subscriber is closed.
///
/// Several threads may share a subscriber: each frame goes to one of them, and the limit on held messages
/// applies to all. One subscriber per thread is better. A forked process must make its own. Do not use the
/// package `iceoryx2` in the same process: each would remove the files of the other.
#[pyclass(frozen, module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct Subscriber {
    camera: CameraName,
    topics: Vec<Topic>,
    timeout: Option<Duration>,
    feed: ForkGuard<SharedFeed>,
}

impl Subscriber {
    /// Waits for a frame; `None` if the subscriber is closed.
    fn wait(&self, py: Python<'_>, timeout: Option<Duration>) -> PyResult<Option<PyFrame>> {
        let shared = self.feed.get(NAME)?;
        let deadline = Deadline::after(timeout);
        let Some(mut borrowed) = self.borrow(py, shared, deadline)? else { return Ok(None) };
        let Some(feed) = borrowed.feed.as_mut() else { return Ok(None) };
        loop {
            let over = deadline.is_over();
            let found = py.detach(|| feed.poll(deadline.next_wait())).map_err(ipc_error)?;
            if let Some(arrival) = found {
                return self.frame(py, arrival).map(Some);
            }
            py.check_signals()?;
            if shared.is_closed() {
                return Ok(None);
            }
            if over {
                return Err(feed.timeout_error(&self.camera, timeout));
            }
        }
    }

    /// Takes the feed, in turn with other threads; `None` if the subscriber is closed.
    fn borrow<'a>(
        &self,
        py: Python<'_>,
        shared: &'a SharedFeed,
        deadline: Deadline,
    ) -> PyResult<Option<BorrowedFeed<'a>>> {
        loop {
            let over = deadline.is_over();
            match py.detach(|| shared.take(deadline.next_wait())) {
                TakenFeed::Feed(feed) => return Ok(Some(BorrowedFeed::new(shared, feed))),
                TakenFeed::Closed => return Ok(None),
                TakenFeed::Busy if over => {
                    let camera = &self.camera;
                    return Err(hinted::<PyTimeoutError>(
                        format!("another thread waits for frames of this subscriber of camera `{camera}`"),
                        "make a subscriber for each thread",
                    ));
                }
                TakenFeed::Busy => py.check_signals()?,
            }
        }
    }

    /// A frame that arrives within `timeout`, which another thread may take up, or `None`.
    fn poll(&self, py: Python<'_>, timeout: Duration) -> PyResult<Option<PyFrame>> {
        let shared = self.feed.get(NAME)?;
        let mut borrowed = match py.detach(|| shared.take(timeout)) {
            TakenFeed::Feed(feed) => BorrowedFeed::new(shared, feed),
            TakenFeed::Busy => return Ok(None),
            TakenFeed::Closed => return Err(self.closed_error()),
        };
        let Some(feed) = borrowed.feed.as_mut() else { return Ok(None) };
        let found = py.detach(|| feed.poll(timeout)).map_err(ipc_error)?;
        found.map(|arrival| self.frame(py, arrival)).transpose()
    }

    fn frame(&self, py: Python<'_>, arrival: Arrival) -> PyResult<PyFrame> {
        let mut samples = Vec::with_capacity(self.topics.len());
        if let Some(mut set) = arrival.set {
            for topic in &self.topics {
                if let Some(frame) = set.take(*topic) {
                    samples.push(Py::new(py, TopicMessage::new(frame))?);
                }
            }
        }
        let stats = arrival.stats.as_ref().map(PyStats::read);
        Ok(PyFrame::new(samples, stats, self.topics.clone()))
    }

    fn closed_error(&self) -> PyErr {
        hinted::<NunetError>(
            format!("this subscriber of camera `{}` is closed", self.camera),
            "use it inside its `with` block, or subscribe again",
        )
    }
}

#[pymethods]
impl Subscriber {
    /// Wait for the next frame: the newest one that is complete and was not returned yet.
    ///
    /// Parameters
    /// ----------
    /// timeout : float, optional
    ///     Seconds; `math.inf` waits without limit. By default the timeout of `subscribe`.
    ///
    /// Raises
    /// ------
    /// TimeoutError
    ///     No frame arrived in time. The text says which publisher is dead or silent.
    /// NunetError
    ///     This subscriber is closed, or earlier frames hold as many messages as one subscriber may.
    #[pyo3(signature = (*, timeout = None))]
    fn next(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = argument::timeout)] timeout: Option<f64>,
    ) -> PyResult<PyFrame> {
        let timeout = match timeout {
            None => self.timeout,
            given => wait::timeout(given)?,
        };
        self.wait(py, timeout)?.ok_or_else(|| self.closed_error())
    }

    /// Return the newest frame that is complete and was not returned yet, or `None`. Does not wait.
    ///
    /// Raises
    /// ------
    /// NunetError
    ///     This subscriber is closed, or earlier frames hold as many messages as one subscriber may.
    fn latest(&self, py: Python<'_>) -> PyResult<Option<PyFrame>> {
        self.poll(py, Duration::ZERO)
    }

    /// One step of `async for`: a frame that arrives within `seconds`, or `None`.
    fn _poll(&self, py: Python<'_>, seconds: f64) -> PyResult<Option<PyFrame>> {
        self.poll(py, wait::timeout(Some(seconds))?.unwrap_or(MAX_WAIT))
    }

    /// Close the subscriber. Frames and arrays that are still in use stay valid. A thread that waits for a
    /// frame stops waiting. Closing twice is not an error.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let feed = self.feed.get(NAME)?;
        py.detach(|| feed.close());
        Ok(())
    }

    /// Whether a living process publishes each of the topics. Does not wait for other threads that use this
    /// subscriber. Reads the file system, so do not call it for every frame.
    ///
    /// Raises
    /// ------
    /// NunetError
    ///     This subscriber is closed.
    #[getter]
    fn connected(&self, py: Python<'_>) -> PyResult<bool> {
        let publishers = self.feed.get(NAME)?.publishers().ok_or_else(|| self.closed_error())?;
        Ok(py.detach(|| publishers.are_all_alive()))
    }

    /// Whether `close` was called.
    #[getter]
    fn closed(&self) -> PyResult<bool> {
        Ok(self.feed.get(NAME)?.is_closed())
    }

    /// The timeout for each frame, seconds; `None` waits without limit.
    #[getter]
    fn timeout(&self) -> Option<f64> {
        self.timeout.map(|timeout| timeout.as_secs_f64())
    }

    /// The camera's name.
    #[getter]
    fn camera(&self) -> &str {
        self.camera.as_str()
    }

    /// The topics of each frame.
    #[getter]
    fn topics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.topics.iter().map(|topic| topic.name()))
    }

    fn __enter__(slf: Bound<'_, Self>) -> PyResult<Bound<'_, Self>> {
        if slf.get().closed()? { Err(slf.get().closed_error()) } else { Ok(slf) }
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) -> PyResult<()> {
        self.close(py)
    }

    fn __iter__(slf: Bound<'_, Self>) -> PyResult<Bound<'_, Self>> {
        Self::__enter__(slf)
    }

    fn __aiter__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        if slf.get().closed()? {
            return Err(slf.get().closed_error());
        }
        slf.py().import("nunet_py._asynchronous")?.call_method1("frames", (slf,))
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<PyFrame>> {
        self.wait(py, self.timeout)
    }

    fn __repr__(&self) -> String {
        let topics: Vec<_> = self.topics.iter().map(|topic| topic.name()).collect();
        format!("Subscriber({:?}, topics={topics:?})", self.camera.as_str())
    }
}

/// Opens a reader. Ctrl-C ends the wait.
fn open(
    py: Python<'_>,
    camera: &CameraName,
    topics: &[Topic],
    timeout: Option<Duration>,
) -> PyResult<Reader> {
    let mut interrupted = None;
    let mut checked = Instant::now();
    let opened = py.detach(|| {
        Reader::open_unless(camera, topics, timeout.unwrap_or(Duration::MAX), || {
            if checked.elapsed() >= MAX_WAIT {
                interrupted = Python::attach(|py| py.check_signals()).err();
                checked = Instant::now();
            }
            interrupted.is_some()
        })
    });
    match (opened, interrupted) {
        (_, Some(interrupted)) => Err(interrupted),
        (Ok(reader), None) => Ok(reader),
        (Err(error), None) => Err(py.detach(|| open_error(camera, error))),
    }
}

/// The exception for a reader that cannot be opened. It tells a missing camera from a missing topic.
fn open_error(camera: &CameraName, error: IpcError) -> PyErr {
    let IpcError::NobodyPublishes { service, timeout } = &error else { return ipc_error(error) };
    let Some(topic) = TOPICS.into_iter().find(|topic| camera.service(*topic) == *service) else {
        return ipc_error(error);
    };
    // Without topics, a reader opens only the camera's event.
    if Reader::open(camera, &[], Duration::ZERO).is_err() {
        return ipc_error(error);
    }
    let hint = if topic == Topic::Rgb {
        "start the camera's own publisher: `nunetd feed`, or `nunet_py.publisher`".to_owned()
    } else {
        format!("start nunetd for this camera with `{topic}` in `--publish`, or omit this topic")
    };
    let seconds = timeout.as_secs_f64();
    hinted::<PyTimeoutError>(
        format!("camera `{camera}` exists, but its `{topic}` was not published within {seconds} s"),
        hint,
    )
}
