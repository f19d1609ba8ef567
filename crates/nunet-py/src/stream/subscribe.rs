//! `subscribe`: the frames of a running daemon.

use std::time::{Duration, Instant};

use nunet_ipc::{CameraName, IpcError, Reader, Topic};
use pyo3::exceptions::{PyTimeoutError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyString, PyTuple};

use super::feed::{Arrival, Desk, Feed, Found, Turn};
use super::figures::Stats;
use super::frame::Frame;
use super::sample::Sample;
use super::{Deadline, GLANCE, camera_name, ipc_error, timeout};
use crate::argument;
use crate::error::NunetError;
use crate::own::Own;

/// What this class is called in messages.
const NAME: &str = "subscriber";

/// What may be subscribed to.
const TOPICS: [Topic; 5] = [Topic::Rgb, Topic::Depth, Topic::Labels, Topic::Cloud, Topic::Stats];

pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Subscriber>()?;
    module.add_function(wrap_pyfunction!(subscribe, module)?)
}

/// Attach to a camera that a running `nunetd` publishes, without copying its frames.
///
/// Parameters
/// ----------
/// camera : str
///     The camera's name, as of `nunetd --camera`.
/// topics : sequence of str, optional
///     What each frame holds: names among `rgb`, `depth`, `labels`, `cloud` and `stats`. The cloud and the labels are
///     computed only while somebody asks for them. `rgb` is what the camera's own publisher sends (`nunetd feed`,
///     `nunet_py.publisher`); its picture is joined with the depth that was made of it.
/// timeout : float, optional
///     Seconds to wait for the daemon, here, and for each frame, later. `None` or `math.inf` waits for ever.
///
/// Returns
/// -------
/// Subscriber
///     A context manager, and an iterator of frames.
///
/// Raises
/// ------
/// TimeoutError
///     Nobody publishes the camera or one of the topics.
/// ContractVersionError
///     The daemon is of another version.
/// NunetError
///     The daemon has no room for another reader.
/// ValueError
///     A name that no camera or topic has; a timeout below 0.
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
    let camera = camera_name(camera)?;
    let topics = topics.map_or_else(|| Ok(vec![Topic::Depth]), topics_of)?;
    let timeout = self::timeout(timeout)?;
    let reader = open(py, &camera, &topics, timeout)?;
    let desk = Own::new(Desk::new(Feed::new(reader, topics.clone())));
    Ok(Subscriber { camera, topics, timeout, desk })
}

/// A camera's newest frames, as they come: an iterator and a context manager.
///
/// Each frame holds every topic that was asked for, of one and the same picture; what is older when it is asked for, or
/// can no longer become complete, is left out, so a slow loop sees the newest frames and slows nobody down. Waiting
/// takes no processor time, lets other Python threads run, and is ended by Ctrl-C.
///
/// When the daemon ends or is killed, the next frame is a `TimeoutError` that says so; when it is back, the same
/// subscriber goes on with its frames. The loop ends when the subscriber is closed.
///
/// Several threads may share one: each frame goes to one of them, and what they hold counts together, so a subscriber for
/// each is better. A process made by `os.fork` must make its own. The package `iceoryx2` must not be used in the same
/// process: each takes the other for dead.
#[pyclass(frozen, module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct Subscriber {
    camera: CameraName,
    topics: Vec<Topic>,
    timeout: Option<Duration>,
    desk: Own<Desk>,
}

impl Subscriber {
    /// Waits for a frame; `None` when the subscriber is closed.
    fn wait(&self, py: Python<'_>, patience: Option<Duration>) -> PyResult<Option<Frame>> {
        let desk = self.desk.get(NAME)?;
        let deadline = Deadline::after(patience);
        let Some(mut turn) = self.turn(py, desk, deadline)? else { return Ok(None) };
        let Some(feed) = turn.feed.as_mut() else { return Ok(None) };
        loop {
            let over = deadline.is_over();
            let found = py.detach(|| feed.look(deadline.glance())).map_err(|error| ipc_error(&error))?;
            if let Some(arrival) = found {
                return self.frame(py, arrival).map(Some);
            }
            py.check_signals()?;
            if desk.is_closed() {
                return Ok(None);
            }
            if over {
                return Err(feed.silence(&self.camera, patience));
            }
        }
    }

    /// Takes the feed, in turn with other threads; `None` when the subscriber is closed.
    fn turn<'a>(&self, py: Python<'_>, desk: &'a Desk, deadline: Deadline) -> PyResult<Option<Turn<'a>>> {
        loop {
            let over = deadline.is_over();
            match py.detach(|| desk.take(deadline.glance())) {
                Found::Feed(feed) => return Ok(Some(Turn::new(desk, feed))),
                Found::Closed => return Ok(None),
                Found::Busy if over => {
                    return Err(PyTimeoutError::new_err(format!(
                        "another thread waits for frames of this subscriber of camera `{}`\n\
                         hint: give each thread a subscriber of its own",
                        self.camera
                    )));
                }
                Found::Busy => py.check_signals()?,
            }
        }
    }

    fn frame(&self, py: Python<'_>, arrival: Arrival) -> PyResult<Frame> {
        let mut samples = Vec::with_capacity(self.topics.len());
        if let Some(mut set) = arrival.set {
            for topic in &self.topics {
                if let Some(frame) = set.take(*topic) {
                    samples.push(Py::new(py, Sample::new(frame))?);
                }
            }
        }
        let stats = arrival.stats.as_ref().map(Stats::read);
        Ok(Frame::new(samples, stats, self.topics.clone()))
    }

    fn closed_error(&self) -> PyErr {
        NunetError::new_err(format!(
            "this subscriber of camera `{}` is closed\nhint: use it inside of its `with` block, or subscribe again",
            self.camera
        ))
    }
}

#[pymethods]
impl Subscriber {
    /// Wait for the next frame: the newest that is complete and was not seen yet.
    ///
    /// Parameters
    /// ----------
    /// timeout : float, optional
    ///     Seconds; `math.inf` waits for ever. Without it: that of `subscribe`.
    ///
    /// Raises
    /// ------
    /// TimeoutError
    ///     No frame in time; the text says who is dead or silent.
    /// NunetError
    ///     This subscriber is closed, or its earlier frames are not let go of.
    #[pyo3(signature = (*, timeout = None))]
    fn next(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = argument::timeout)] timeout: Option<f64>,
    ) -> PyResult<Frame> {
        let patience = match timeout {
            None => self.timeout,
            given => super::timeout(given)?,
        };
        self.wait(py, patience)?.ok_or_else(|| self.closed_error())
    }

    /// The newest frame that is complete and was not seen yet, or `None`. Does not wait.
    ///
    /// Raises
    /// ------
    /// NunetError
    ///     This subscriber is closed, or its earlier frames are not let go of.
    fn latest(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        let desk = self.desk.get(NAME)?;
        let mut feed = match py.detach(|| desk.take(Duration::ZERO)) {
            Found::Feed(feed) => Turn::new(desk, feed),
            Found::Busy => return Ok(None), // another thread waits for the same frames
            Found::Closed => return Err(self.closed_error()),
        };
        let Some(feed) = feed.feed.as_mut() else { return Ok(None) };
        let found = feed.look(Duration::ZERO).map_err(|error| ipc_error(&error))?;
        found.map(|arrival| self.frame(py, arrival)).transpose()
    }

    /// Let go of the daemon. Frames and arrays that are still around stay as they are. A thread that waits for a frame
    /// stops waiting. Closing twice is no error.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let desk = self.desk.get(NAME)?;
        py.detach(|| desk.close());
        Ok(())
    }

    /// Whether a living process publishes each of the topics. Asks the file system: not for every frame. Does not wait,
    /// whatever other threads do with this subscriber.
    ///
    /// Raises
    /// ------
    /// NunetError
    ///     This subscriber is closed.
    #[getter]
    fn connected(&self, py: Python<'_>) -> PyResult<bool> {
        let owners = self.desk.get(NAME)?.owners().ok_or_else(|| self.closed_error())?;
        Ok(py.detach(|| owners.are_all_alive()))
    }

    /// Whether `close` was called.
    #[getter]
    fn closed(&self) -> PyResult<bool> {
        Ok(self.desk.get(NAME)?.is_closed())
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

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        self.wait(py, self.timeout)
    }

    fn __repr__(&self) -> String {
        let topics: Vec<_> = self.topics.iter().map(|topic| topic.name()).collect();
        format!("Subscriber({:?}, topics={topics:?})", self.camera.as_str())
    }
}

/// Opens a reader, and listens for Ctrl-C meanwhile.
fn open(
    py: Python<'_>,
    camera: &CameraName,
    topics: &[Topic],
    patience: Option<Duration>,
) -> PyResult<Reader> {
    let mut interrupted = None;
    let mut looked = Instant::now();
    let opened = py.detach(|| {
        Reader::open_unless(camera, topics, patience.unwrap_or(Duration::MAX), || {
            if looked.elapsed() >= GLANCE {
                interrupted = Python::attach(|py| py.check_signals()).err();
                looked = Instant::now();
            }
            interrupted.is_some()
        })
    });
    match (opened, interrupted) {
        (_, Some(interrupted)) => Err(interrupted),
        (Ok(reader), None) => Ok(reader),
        (Err(error), None) => Err(py.detach(|| nobody(camera, &error))),
    }
}

/// Nobody publishes the camera, or the camera is there and has no such topic.
fn nobody(camera: &CameraName, error: &IpcError) -> PyErr {
    let IpcError::NobodyPublishes { service, timeout } = error else { return ipc_error(error) };
    let Some(topic) = TOPICS.into_iter().find(|topic| camera.service(*topic) == *service) else {
        return ipc_error(error);
    };
    // Without topics a reader opens the camera's event alone.
    if Reader::open(camera, &[], Duration::ZERO).is_err() {
        return ipc_error(error);
    }
    let hint = if topic == Topic::Rgb {
        "pictures come from the camera's own publisher: `nunetd feed`, or `nunet_py.publisher`".to_owned()
    } else {
        format!("start nunetd for this camera, with `{topic}` in its `--publish`, or do not ask for it")
    };
    PyTimeoutError::new_err(format!(
        "camera `{camera}` is there, but nobody published its `{topic}` in {} s\nhint: {hint}",
        timeout.as_secs_f64()
    ))
}

/// Names of topics as people give them: several, or one.
fn topics_of(given: &Bound<'_, PyAny>) -> PyResult<Vec<Topic>> {
    let words: Vec<String> = if given.is_instance_of::<PyString>() {
        vec![given.extract()?]
    } else {
        let words: PyResult<Vec<String>> =
            given.try_iter().and_then(|each| each.map(|word| word?.extract()).collect());
        words.map_err(|_| {
            let kind = given.get_type().name().map_or_else(|_| "?".to_owned(), |name| name.to_string());
            PyTypeError::new_err(format!(
                "topics is a `{kind}`, but expected names\nhint: for example topics=[\"depth\", \"cloud\"]"
            ))
        })?
    };
    let mut topics = Vec::with_capacity(words.len());
    for word in &words {
        let known = TOPICS.into_iter().find(|topic| topic.name() == word);
        let topic = known.ok_or_else(|| unknown_topic(word))?;
        if topics.contains(&topic) {
            return Err(PyValueError::new_err(format!(
                "topic `{topic}` is asked for twice\nhint: name it once"
            )));
        }
        topics.push(topic);
    }
    if topics.is_empty() {
        return Err(PyValueError::new_err("topics is empty\nhint: for example topics=[\"depth\"]"));
    }
    Ok(topics)
}

fn unknown_topic(word: &str) -> PyErr {
    let choices: Vec<_> = TOPICS.iter().map(|topic| format!("`{topic}`")).collect();
    PyValueError::new_err(format!("`{word}` is no topic\nhint: one of {}", choices.join(", ")))
}
