//! The topics of one frame that belong together.

use nunet_daemon::embed;
use nunet_ipc::{CloudPoint, Encoding, Topic, monotonic_nanos, unix_nanos};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use super::figures::Stats;
use super::header::{FrameHeader, unknown};
use super::sample::{Sample, element, plane};
use super::view::{Shape, array};
use crate::camera::Camera;
use crate::cloud::Cloud;
use crate::error::{NunetError, failure};

/// One frame of a camera: the topics that were asked for, all of one sequence number and one time of capture.
///
/// Arrays are read-only numpy views of shared memory: nothing is copied. They keep their message alive after the
/// loop has moved on, the subscriber was closed and the daemon has ended. One reader may hold few messages (two,
/// unless the daemon says otherwise), so copy what must live long: `frame.depth.copy()`. torch takes them without a
/// copy (`torch.from_dlpack`, `torch.from_numpy`), but knows no read-only tensors: writing to one in place ends
/// this process, so `clone()` it first. JAX, whose arrays never change, takes the depth of the frame itself:
/// `jax.numpy.from_dlpack(frame)`, without a copy too. Frames and their arrays may be handed to other threads, but a fork must not
/// rely on them.
#[pyclass(frozen, module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct Frame {
    samples: Vec<Py<Sample>>,
    stats: Option<Stats>,
    topics: Vec<Topic>,
}

impl Frame {
    pub(super) fn new(samples: Vec<Py<Sample>>, stats: Option<Stats>, topics: Vec<Topic>) -> Self {
        Self { samples, stats, topics }
    }

    fn find(&self, topic: Topic) -> Option<&Py<Sample>> {
        self.samples.iter().find(|sample| sample.get().topic() == topic)
    }

    fn sample<'py>(&self, py: Python<'py>, topic: Topic) -> PyResult<&Bound<'py, Sample>> {
        self.find(topic).map(|sample| sample.bind(py)).ok_or_else(|| self.missing(topic))
    }

    /// The sample of a topic whose payload must be laid out in this way.
    fn encoded<'py>(
        &self,
        py: Python<'py>,
        topic: Topic,
        expected: Encoding,
    ) -> PyResult<&Bound<'py, Sample>> {
        let sample = self.sample(py, topic)?;
        let found = sample.get().header().encoding().map_err(unknown)?;
        if found == expected {
            return Ok(sample);
        }
        Err(NunetError::new_err(format!(
            "topic `{topic}` carries `{found}`, but expected `{expected}`\n\
             hint: the sender does not keep to the contract"
        )))
    }

    fn missing(&self, topic: Topic) -> PyErr {
        let has: Vec<_> = self.topics.iter().map(|topic| format!("`{topic}`")).collect();
        NunetError::new_err(format!(
            "this frame has no `{topic}`, only {}\nhint: subscribe with `{topic}` among the topics",
            has.join(", ")
        ))
    }

    /// The message that speaks for the frame: depth's, else the first.
    fn lead(&self) -> PyResult<&nunet_ipc::FrameHeader> {
        let lead = self.find(Topic::Depth).or(self.samples.first());
        lead.map(|sample| sample.get().header()).ok_or_else(|| {
            NunetError::new_err(
                "this frame has figures and no message\nhint: subscribe to another topic beside `stats`",
            )
        })
    }
}

#[pymethods]
impl Frame {
    /// float32 (H, W): depth in `header.units` (metres, unless the network knows no scale), rows from the top; NaN
    /// where there is none. A read-only view of shared memory.
    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plane::<f32>(self.encoded(py, Topic::Depth, Encoding::DepthF32)?, size_of::<f32>(), 0)
    }

    /// `depth`, as `numpy.asarray(frame)` gives it.
    #[pyo3(signature = (*arguments, **named))]
    fn __array__<'py>(
        &self,
        py: Python<'py>,
        arguments: &Bound<'py, PyTuple>,
        named: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.depth(py)?.call_method("__array__", arguments, named)
    }

    /// `depth` without a copy, for consumers of any version of DLPack. numpy's own arrays refuse those that cannot be
    /// told of read-only memory, as JAX, which writes to none.
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

    /// The device of `depth`: the processor's memory.
    fn __dlpack_device__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.depth(py)?.call_method0("__dlpack_device__")
    }

    /// uint8 (H, W): the class of each pixel. A read-only view of shared memory.
    #[getter]
    fn labels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plane::<u8>(self.encoded(py, Topic::Labels, Encoding::LabelsU8)?, 1, 0)
    }

    /// The organised point cloud: its `points`, `labels` and `colors` are read-only views of shared memory, with strides
    /// of 16 bytes. `colors` runs backwards over blue, green, red, which torch takes only as a copy.
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
        ))
    }

    /// uint8 (H, W, 3): the camera's picture, red, green, blue. A read-only view of shared memory, whether the camera
    /// sends `rgb8`, `bgr8` (a view that runs backwards) or `mono8` (one byte seen three times).
    ///
    /// Raises `NunetError` for `yuyv` and `nv12`, which no view makes RGB: see `picture`.
    #[getter]
    fn rgb<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let sample = self.sample(py, Topic::Rgb)?;
        let message = sample.get();
        let shape = match message.header().encoding().map_err(unknown)? {
            Encoding::Rgb8 => message.grid(3)?.triples(3, 0, 1),
            Encoding::Bgr8 => message.grid(3)?.triples(3, 2, -1),
            Encoding::Mono8 => message.grid(1)?.triples(1, 0, 0),
            other => {
                return Err(NunetError::new_err(format!(
                    "the camera sends `{other}`, which must be converted to be RGB\n\
                     hint: take `frame.picture` and convert it, for example with cv2.cvtColor"
                )));
            }
        };
        array(sample, element::<u8>(py), shape)
    }

    /// uint8: the camera's picture as it is sent, a read-only view of shared memory. (H, W, 3) for `rgb8` and `bgr8`,
    /// (H, W) for `mono8`, (H, W, 2) for `yuyv`, (H + H / 2, W) for `nv12`; of the last two W is rounded up to an even
    /// number, and so is H / 2.
    #[getter]
    fn picture<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let sample = self.sample(py, Topic::Rgb)?;
        let message = sample.get();
        let planar = |grid: super::sample::Grid| grid.plane(1, 0);
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
                array(sample, element::<u8>(py), Shape { lengths, strides: [grid.stride, 2, 1], offset: 0 })
            }
            other => Err(NunetError::new_err(format!(
                "topic `rgb` carries `{other}`, which is no picture\nhint: the sender does not keep to the contract"
            ))),
        }
    }

    /// The daemon's figures when the frame came; they count the frame before it, or this one.
    #[getter]
    fn stats(&self) -> PyResult<Stats> {
        self.stats.clone().ok_or_else(|| self.missing(Topic::Stats))
    }

    /// What the frame says about itself: the header of depth, or of the first topic when depth was not asked for.
    #[getter]
    fn header(&self) -> PyResult<FrameHeader> {
        FrameHeader::read(self.lead()?)
    }

    /// The header of each topic by its name.
    #[getter]
    fn headers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let headers = PyDict::new(py);
        for sample in &self.samples {
            let sample = sample.get();
            headers.set_item(sample.topic().name(), FrameHeader::read(sample.header())?)?;
        }
        Ok(headers)
    }

    /// The camera, at the size of this frame's depth; `None` where its publisher does not know it.
    #[getter]
    fn camera(&self) -> PyResult<Option<Camera>> {
        Ok(embed::camera_of(self.lead()?).map_err(|error| failure(&error))?.map(Camera))
    }

    /// The topics that were asked for.
    #[getter]
    fn topics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.topics.iter().map(|topic| topic.name()))
    }

    /// The frame's number: the same in every topic of one frame, rising, starting anywhere.
    #[getter]
    fn sequence(&self) -> PyResult<u64> {
        Ok(self.lead()?.sequence)
    }

    /// Seconds since the picture was taken: by the monotonic clock where the camera uses it, else by the time of day.
    /// Where neither is known, seconds since the frame was sent.
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

/// The same array without the mark that it is read-only, for nobody but a capsule: its memory is read-only all the same.
fn unmarked<'py>(array: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let py = array.py();
    let interface = array.getattr("__array_interface__")?;
    let (address, _): (usize, bool) = interface.get_item("data")?.extract()?;
    interface.set_item("data", (address, false))?;
    let named = PyDict::new(py);
    named.set_item("__array_interface__", interface)?;
    named.set_item("owner", array)?;
    let bearer = py.import("types")?.getattr("SimpleNamespace")?.call((), Some(&named))?;
    py.import("numpy")?.call_method1("asarray", (bearer,))
}
