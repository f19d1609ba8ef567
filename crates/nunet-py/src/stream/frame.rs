//! One frame: its topics, joined by sequence number.

use nunet_ipc::{CloudPoint, Encoding, ObstacleRecord, Topic, monotonic_nanos, unix_nanos};
use nunet_source::camera_in;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use super::header::{FrameHeader, VIOLATION, unknown};
use super::sample::{Grid, TopicMessage, element, plane};
use super::stats::PyStats;
use crate::camera::PyCamera;
use crate::cloud::Cloud;
use crate::error::{NunetError, failure, hinted};
use crate::memory::{ArrayLayout, array};
use crate::obstacles::PyObstacles;

/// One frame of a camera: the subscribed topics, all with the same sequence number and capture time.
///
/// Arrays are read-only numpy views of shared memory: nothing is copied. They stay valid after the loop has
/// moved on, the subscriber was closed or the daemon has ended. A subscriber can hold few messages at a time
/// (two by default), so copy what must live long: `frame.depth.copy()`.
///
/// torch takes the arrays without a copy (`torch.from_dlpack`, `torch.from_numpy`), but ignores that they are
/// read-only: writing to such a tensor crashes the process, so `clone()` it first. JAX takes the depth from
/// the frame itself without a copy: `jax.numpy.from_dlpack(frame)`.
///
/// Frames and their arrays can be passed to other threads. A forked process must not use them.
#[pyclass(frozen, name = "Frame", module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct PyFrame {
    samples: Vec<Py<TopicMessage>>,
    stats: Option<PyStats>,
    topics: Vec<Topic>,
}

impl PyFrame {
    pub(super) fn new(samples: Vec<Py<TopicMessage>>, stats: Option<PyStats>, topics: Vec<Topic>) -> Self {
        Self { samples, stats, topics }
    }

    fn find(&self, topic: Topic) -> Option<&Py<TopicMessage>> {
        self.samples.iter().find(|sample| sample.get().topic() == topic)
    }

    fn sample<'py>(&self, py: Python<'py>, topic: Topic) -> PyResult<&Bound<'py, TopicMessage>> {
        self.find(topic).map(|sample| sample.bind(py)).ok_or_else(|| self.missing(topic))
    }

    /// The message of a topic, which must have this encoding.
    fn encoded<'py>(
        &self,
        py: Python<'py>,
        topic: Topic,
        expected: Encoding,
    ) -> PyResult<&Bound<'py, TopicMessage>> {
        let sample = self.sample(py, topic)?;
        let found = sample.get().header().encoding().map_err(unknown)?;
        if found == expected {
            return Ok(sample);
        }
        let text = format!("topic `{topic}` has the encoding `{found}`; expected `{expected}`");
        Err(hinted::<NunetError>(text, VIOLATION))
    }

    fn missing(&self, topic: Topic) -> PyErr {
        let has: Vec<_> = self.topics.iter().map(|topic| format!("`{topic}`")).collect();
        hinted::<NunetError>(
            format!("this frame has no `{topic}`, only {}", has.join(", ")),
            format!("add `{topic}` to the topics of `subscribe`"),
        )
    }

    /// The header of depth, else of the first topic.
    fn lead(&self) -> PyResult<&nunet_ipc::FrameHeader> {
        let lead = self.find(Topic::Depth).or(self.samples.first());
        lead.map(|sample| sample.get().header()).ok_or_else(|| {
            hinted::<NunetError>(
                "this frame has only `stats`, which has no header",
                "subscribe to another topic too",
            )
        })
    }
}

#[pymethods]
impl PyFrame {
    /// float32 (H, W): depth in `header.units`, rows from the top; NaN where there is no depth. A read-only
    /// view of shared memory.
    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plane::<f32>(self.encoded(py, Topic::Depth, Encoding::DepthF32)?, size_of::<f32>(), 0)
    }

    /// `depth`, for `numpy.asarray(frame)`.
    #[pyo3(signature = (*arguments, **named))]
    fn __array__<'py>(
        &self,
        py: Python<'py>,
        arguments: &Bound<'py, PyTuple>,
        named: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.depth(py)?.call_method("__array__", arguments, named)
    }

    /// `depth` without a copy, for consumers of any DLPack version. numpy's own arrays refuse consumers of
    /// versions before 1.0, such as JAX, because those cannot learn that the memory is read-only.
    #[pyo3(signature = (**named))]
    fn __dlpack__<'py>(
        &self,
        py: Python<'py>,
        named: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let depth = self.depth(py)?;
        let version = named.map(|named| named.get_item("max_version")).transpose()?.flatten();
        let depth = if version.is_some_and(|version| !version.is_none()) { depth } else { unmarked(&depth)? };
        depth.call_method("__dlpack__", (), named)
    }

    /// The device of `depth`: CPU memory.
    fn __dlpack_device__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.depth(py)?.call_method0("__dlpack_device__")
    }

    /// uint8 (H, W): the class of each pixel. A read-only view of shared memory.
    #[getter]
    fn labels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plane::<u8>(self.encoded(py, Topic::Labels, Encoding::LabelsU8)?, 1, 0)
    }

    /// uint8 (H, W): the confidence of each pixel's depth, 255 = certain, 0 where there is no depth. A
    /// read-only view of shared memory.
    #[getter]
    fn confidence<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plane::<u8>(self.encoded(py, Topic::Confidence, Encoding::ConfidenceU8)?, 1, 0)
    }

    /// The organized point cloud. Its `points`, `labels` and `colors` are read-only views of shared memory
    /// with strides of 16 bytes. `colors` has a negative stride (the memory holds BGR), so torch needs a
    /// copy.
    #[getter]
    fn cloud(&self, py: Python<'_>) -> PyResult<Cloud> {
        const BYTES: usize = size_of::<CloudPoint>();
        let sample = self.encoded(py, Topic::Cloud, Encoding::Points)?;
        let grid = sample.get().grid(BYTES)?;
        let points = grid.triples(BYTES as isize, 0, size_of::<f32>() as isize);
        let colors = grid.triples(BYTES as isize, std::mem::offset_of!(CloudPoint, r), -1);
        Ok(Cloud::of_arrays(
            array(sample, element::<f32>(py), points)?.cast_into()?,
            plane::<u8>(sample, BYTES, std::mem::offset_of!(CloudPoint, label))?.cast_into()?,
            array(sample, element::<u8>(py), colors)?.cast_into()?,
            sample.get().header().units().map_err(unknown)?.name(),
        ))
    }

    /// The obstacles around the robot, copied from shared memory.
    #[getter]
    fn obstacles(&self, py: Python<'_>) -> PyResult<PyObstacles> {
        let sample = self.encoded(py, Topic::Obstacles, Encoding::ObstacleRecord)?.get();
        let record = ObstacleRecord::of_payload(sample.payload()).ok_or_else(|| {
            let (got, expected) = (sample.payload().len(), size_of::<ObstacleRecord>());
            let text = format!("a message of topic `obstacles` has {got} bytes, expected {expected}");
            hinted::<NunetError>(text, VIOLATION)
        })?;
        PyObstacles::of_record(py, record)
    }

    /// uint8 (H, W, 3): the camera's image as RGB. A read-only view of shared memory for the encodings
    /// `rgb8`, `bgr8` (with a negative stride) and `mono8` (with a stride of 0).
    ///
    /// Raises `NunetError` for `yuyv` and `nv12`, which must be converted: see `image`.
    #[getter]
    fn rgb<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let sample = self.sample(py, Topic::Rgb)?;
        let message = sample.get();
        let shape = match message.header().encoding().map_err(unknown)? {
            Encoding::Rgb8 => message.grid(3)?.triples(3, 0, 1),
            Encoding::Bgr8 => message.grid(3)?.triples(3, 2, -1),
            Encoding::Mono8 => message.grid(1)?.triples(1, 0, 0),
            other => {
                return Err(hinted::<NunetError>(
                    format!("the camera sends `{other}`, which must be converted to RGB"),
                    "convert `frame.image`, for example with `cv2.cvtColor`",
                ));
            }
        };
        array(sample, element::<u8>(py), shape)
    }

    /// uint8: the camera's image as it was sent, a read-only view of shared memory. (H, W, 3) for `rgb8` and
    /// `bgr8`, (H, W) for `mono8`, (H, W, 2) for `yuyv`, (H + H / 2, W) for `nv12`. For the last two, W is
    /// rounded up to an even number and H / 2 is rounded up.
    #[getter]
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let sample = self.sample(py, Topic::Rgb)?;
        let message = sample.get();
        let planar = |grid: Grid| grid.plane(1, 0);
        match message.header().encoding().map_err(unknown)? {
            Encoding::Rgb8 | Encoding::Bgr8 => {
                array(sample, element::<u8>(py), message.grid(3)?.triples(3, 0, 1))
            }
            Encoding::Mono8 => array(sample, element::<u8>(py), planar(message.grid(1)?)),
            Encoding::Nv12 => {
                let (rows, columns) = message.size();
                let grid = message.cells(rows + rows.div_ceil(2), columns.next_multiple_of(2), 1)?;
                array(sample, element::<u8>(py), planar(grid))
            }
            Encoding::Yuyv => {
                let (rows, columns) = message.size();
                let grid = message.cells(rows, columns.next_multiple_of(2), 2)?;
                let lengths = [grid.rows, grid.columns, 2];
                array(
                    sample,
                    element::<u8>(py),
                    ArrayLayout { lengths, strides: [grid.stride, 2, 1], offset: 0 },
                )
            }
            other => {
                let text = format!("topic `rgb` has the encoding `{other}`, which is not one of images");
                Err(hinted::<NunetError>(text, VIOLATION))
            }
        }
    }

    /// The daemon's statistics when the frame arrived. They may not include the frame itself.
    #[getter]
    fn stats(&self) -> PyResult<PyStats> {
        self.stats.clone().ok_or_else(|| self.missing(Topic::Stats))
    }

    /// The header of depth, or of the first topic if depth was not subscribed to.
    #[getter]
    fn header(&self) -> PyResult<FrameHeader> {
        FrameHeader::read(self.lead()?)
    }

    /// The header of each topic, by the topic's name.
    #[getter]
    fn headers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let headers = PyDict::new(py);
        for sample in &self.samples {
            let sample = sample.get();
            headers.set_item(sample.topic().name(), FrameHeader::read(sample.header())?)?;
        }
        Ok(headers)
    }

    /// The camera at the size of `header`; `None` if it is unknown.
    #[getter]
    fn camera(&self) -> PyResult<Option<PyCamera>> {
        let camera = camera_in(self.lead()?).map_err(|error| failure(&error.into()))?;
        Ok(camera.map(|camera| PyCamera(camera, None)))
    }

    /// The subscribed topics.
    #[getter]
    fn topics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.topics.iter().map(|topic| topic.name()))
    }

    /// Number of the frame: equal in all topics of a frame. It increases from an arbitrary start.
    #[getter]
    fn sequence(&self) -> PyResult<u64> {
        Ok(self.lead()?.sequence)
    }

    /// Seconds since the image was captured, by the monotonic clock if the camera uses it, else by the wall
    /// clock. If the capture time is unknown, seconds since the frame was sent.
    #[getter]
    fn age(&self) -> PyResult<f64> {
        let header = self.lead()?;
        let now = monotonic_nanos();
        let age = header.age_nanos(now, unix_nanos());
        Ok(age.unwrap_or_else(|| now.saturating_sub(header.publish_nanos)) as f64 / 1e9)
    }

    fn __repr__(&self) -> String {
        let topics: Vec<_> = self.topics.iter().map(|topic| topic.name()).collect();
        let (sequence, width, height) =
            self.lead().map_or((0, 0, 0), |header| (header.sequence, header.width, header.height));
        format!("Frame({sequence}: {}, {width}x{height})", topics.join(", "))
    }
}

/// The same array without the read-only flag, for a DLPack capsule alone: its memory stays read-only.
fn unmarked<'py>(array: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let py = array.py();
    let interface = array.getattr("__array_interface__")?;
    let (address, _): (usize, bool) = interface.get_item("data")?.extract()?;
    interface.set_item("data", (address, false))?;
    let named = PyDict::new(py);
    named.set_item("__array_interface__", interface)?;
    named.set_item("owner", array)?;
    let carrier = py.import("types")?.getattr("SimpleNamespace")?.call((), Some(&named))?;
    py.import("numpy")?.call_method1("asarray", (carrier,))
}
