//! The point cloud of a frame.

use numpy::{PyArray2, PyArrayDescr};
use nunet_ipc::{Encoding, Point};
use pyo3::prelude::*;

use super::sample::{Sample, element, plane};
use super::view::array;

/// Where a point's numbers lie in its 16 bytes: three `f32`, then blue, green, red and the label.
const RED: usize = std::mem::offset_of!(Point, r);
const LABEL: usize = std::mem::offset_of!(Point, label);
const POINT_BYTES: usize = size_of::<Point>();

/// The point cloud of a frame: organised, a point for each pixel, in the camera's optical frame (x right, y down, z
/// forward), metres; NaN where there is no depth. Every array is a read-only view of shared memory.
#[pyclass(frozen, module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct CloudView {
    sample: Py<Sample>,
}

impl CloudView {
    pub(super) const ENCODING: Encoding = Encoding::Points;

    pub(super) fn new(sample: Py<Sample>) -> Self {
        Self { sample }
    }
}

#[pymethods]
impl CloudView {
    /// float32 (H, W, 3): x, y, z in metres; NaN where there is no depth. A view with strides of 16 bytes: no copy.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let sample = self.sample.bind(py);
        let shape =
            sample.get().grid(POINT_BYTES)?.triples(POINT_BYTES as isize, 0, size_of::<f32>() as isize);
        array(sample, element::<f32>(py), shape)
    }

    /// uint8 (H, W): the class of each point, 255 where no network has seen it. A view.
    #[getter]
    fn labels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plane::<u8>(self.sample.bind(py), POINT_BYTES, LABEL)
    }

    /// uint8 (H, W, 3): red, green, blue. A view that runs backwards over blue, green, red.
    #[getter]
    fn colors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let sample = self.sample.bind(py);
        let shape = sample.get().grid(POINT_BYTES)?.triples(POINT_BYTES as isize, RED, -1);
        array(sample, element::<u8>(py), shape)
    }

    /// (H, W) of the fields `x y z` (float32) and `b g r label` (uint8), 16 bytes a point, as ROS and PCL lay them
    /// out. A view.
    #[getter]
    fn array<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let fields = [
            ("x", "<f4"),
            ("y", "<f4"),
            ("z", "<f4"),
            ("b", "u1"),
            ("g", "u1"),
            ("r", "u1"),
            ("label", "u1"),
        ];
        let point = PyArrayDescr::new(py, fields.to_vec())?;
        let sample = self.sample.bind(py);
        array(sample, point, sample.get().grid(POINT_BYTES)?.plane(POINT_BYTES as isize, 0))
    }

    /// float32 (N, 3): the points that have a depth, row by row. A copy.
    fn valid<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let points = self.points(py)?;
        let finite = points.get_item((pyo3::types::PyEllipsis::get(py), 2))?;
        let finite = py.import("numpy")?.call_method1("isfinite", (finite,))?;
        Ok(points.get_item(finite)?.cast_into()?)
    }

    fn __repr__(&self) -> String {
        let header = self.sample.get().header();
        format!("CloudView({}x{} points)", header.width, header.height)
    }
}
