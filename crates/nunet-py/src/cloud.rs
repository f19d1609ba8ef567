//! Organised points.

use numpy::ndarray::{Array2, Array3};
use numpy::{PyArray2, PyArray3, PyArrayMethods as _, PyUntypedArrayMethods as _};
use nunet_core::cloud::CloudPoint;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Points in the camera's optical frame (x right, y down, z forward), organised as the depth map: one point a pixel.
///
/// Attributes
/// ----------
/// points : numpy.ndarray
///     float32 (H, W, 3): x, y, z in the unit of the depth map. NaN where there is no depth, or no ray (the edge of a
///     fisheye).
/// labels : numpy.ndarray
///     uint8 (H, W): class indices; 255 where the network does not segment.
/// colors : numpy.ndarray
///     uint8 (H, W, 3): RGB.
#[pyclass(frozen, module = "nunet_py")]
pub(crate) struct Cloud {
    #[pyo3(get)]
    points: Py<PyArray3<f32>>,
    #[pyo3(get)]
    labels: Py<PyArray2<u8>>,
    #[pyo3(get)]
    colors: Py<PyArray3<u8>>,
}

impl Cloud {
    /// A cloud of arrays that exist: of one height and width.
    pub(crate) fn of_arrays(
        points: Bound<'_, PyArray3<f32>>,
        labels: Bound<'_, PyArray2<u8>>,
        colors: Bound<'_, PyArray3<u8>>,
    ) -> Self {
        Self { points: points.unbind(), labels: labels.unbind(), colors: colors.unbind() }
    }

    /// A cloud of points in rows of `width`.
    pub(crate) fn of_points(
        py: Python<'_>,
        cells: &[CloudPoint],
        (width, height): (u32, u32),
    ) -> PyResult<Self> {
        let (rows, columns) = (height as usize, width as usize);
        let points = cells.iter().flat_map(|cell| [cell.x, cell.y, cell.z]).collect();
        let colors = cells.iter().flat_map(|cell| [cell.r, cell.g, cell.b]).collect();
        let labels = cells.iter().map(|cell| cell.label).collect();
        let wrong = |error: numpy::ndarray::ShapeError| PyValueError::new_err(error.to_string());
        let points = Array3::from_shape_vec((rows, columns, 3), points).map_err(wrong)?;
        let colors = Array3::from_shape_vec((rows, columns, 3), colors).map_err(wrong)?;
        let labels = Array2::from_shape_vec((rows, columns), labels).map_err(wrong)?;
        Ok(Self::of_arrays(
            PyArray3::from_owned_array(py, points),
            PyArray2::from_owned_array(py, labels),
            PyArray3::from_owned_array(py, colors),
        ))
    }
}

#[pymethods]
impl Cloud {
    /// The points that are measurements, without their places in the picture.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray
    ///     float32 (N, 3): x, y, z. The colours of the same points are `cloud.colors[mask]` with
    ///     `mask = np.isfinite(cloud.points[..., 2])`.
    fn valid<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let points = self.points.bind(py).try_readonly()?;
        let view = points.as_array();
        let lanes = view.lanes(numpy::ndarray::Axis(2));
        let valid: Vec<f32> =
            lanes.into_iter().filter(|lane| lane[2].is_finite()).flatten().copied().collect();
        let valid = Array2::from_shape_vec((valid.len() / 3, 3), valid);
        let valid = valid.map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(PyArray2::from_owned_array(py, valid))
    }

    /// The valid points with their colours, for Open3D.
    ///
    /// Returns
    /// -------
    /// open3d.geometry.PointCloud
    ///     float64 points, colours from 0 to 1.
    ///
    /// Raises
    /// ------
    /// ImportError
    ///     The package open3d is not installed (the extra `open3d`).
    fn to_open3d(slf: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        let module = slf.py().import("nunet_py._pictures")?;
        Ok(module.getattr("to_open3d")?.call1((slf,))?.unbind())
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let points = self.points.bind(py);
        format!("Cloud({}x{} points)", points.shape()[1], points.shape()[0])
    }
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Cloud>()
}
