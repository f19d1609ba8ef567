//! Organized point clouds.

use std::path::PathBuf;

use numpy::ndarray::{Array2, Array3, ArrayView3, Axis};
use numpy::{PyArray2, PyArray3, PyArrayMethods as _, PyUntypedArrayMethods as _};
use nunet_core::cloud::CloudPoint;
use nunet_files::write_cloud;
use nunet_types::ImageSize;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::argument;
use crate::error::{failure, hinted};

/// The unit of metric depth.
pub(crate) const METRE: &str = "metre";

/// The arrays of a pickled cloud, and its unit.
type PickledCloud<'py> =
    (Bound<'py, PyArray3<f32>>, Bound<'py, PyArray2<u8>>, Bound<'py, PyArray3<u8>>, String);

/// Points in the camera's optical frame (x right, y down, z forward), organized like the depth map: one point
/// per pixel.
///
/// Attributes
/// ----------
/// points : numpy.ndarray
///     float32 (H, W, 3): x, y, z in `units`. NaN where there is no depth, or no ray (the edge of a fisheye
///     image).
/// labels : numpy.ndarray
///     uint8 (H, W): class indices; 255 if the network does not segment.
/// colors : numpy.ndarray
///     uint8 (H, W, 3): RGB.
/// units : str
///     The unit of `points`: `metre`, or `relative` for depth without a scale.
#[pyclass(frozen, module = "nunet_py")]
pub(crate) struct Cloud {
    #[pyo3(get)]
    points: Py<PyArray3<f32>>,
    #[pyo3(get)]
    labels: Py<PyArray2<u8>>,
    #[pyo3(get)]
    colors: Py<PyArray3<u8>>,
    #[pyo3(get)]
    units: String,
}

impl Cloud {
    /// A cloud of existing arrays, which have the same height and width.
    pub(crate) fn of_arrays(
        points: Bound<'_, PyArray3<f32>>,
        labels: Bound<'_, PyArray2<u8>>,
        colors: Bound<'_, PyArray3<u8>>,
        units: &str,
    ) -> Self {
        let (points, labels, colors) = (points.unbind(), labels.unbind(), colors.unbind());
        Self { points, labels, colors, units: units.to_owned() }
    }

    /// A cloud of points in rows of `width`.
    pub(crate) fn of_points(
        py: Python<'_>,
        cells: &[CloudPoint],
        ImageSize { width, height }: ImageSize,
        units: &str,
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
            units,
        ))
    }

    /// The points as one list, rows from the top.
    fn cells(&self, py: Python<'_>) -> PyResult<Vec<CloudPoint>> {
        let points = self.points.bind(py).try_readonly()?;
        let colors = self.colors.bind(py).try_readonly()?;
        let labels = self.labels.bind(py).try_readonly()?;
        let (points, colors, labels) = (points.as_array(), colors.as_array(), labels.as_array());
        if points.shape() != colors.shape() || points.shape()[..2] != *labels.shape() {
            return Err(PyValueError::new_err("the arrays of this cloud have different sizes"));
        }
        let triples = triples(&points).zip(triples(&colors)).zip(&labels);
        let cells = triples.map(|(([x, y, z], [r, g, b]), &label)| CloudPoint { x, y, z, b, g, r, label });
        Ok(cells.collect())
    }
}

/// The last axis of an array, which has three elements, for each row and column.
fn triples<T: Copy>(array: &ArrayView3<'_, T>) -> impl Iterator<Item = [T; 3]> {
    array.lanes(Axis(2)).into_iter().map(|lane| [lane[0], lane[1], lane[2]])
}

#[pymethods]
impl Cloud {
    /// The points that have depth, as a list without rows and columns.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray
    ///     float32 (N, 3): x, y, z. The colors of the same points are `cloud.colors[mask]` with
    ///     `mask = np.isfinite(cloud.points[..., 2])`.
    fn valid<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let points = self.points.bind(py).try_readonly()?;
        let valid: Vec<f32> =
            triples(&points.as_array()).filter(|point| point[2].is_finite()).flatten().collect();
        let valid = Array2::from_shape_vec((valid.len() / 3, 3), valid);
        let valid = valid.map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(PyArray2::from_owned_array(py, valid))
    }

    /// Write the points that have depth as a PLY file, which MeshLab, CloudCompare and Open3D read.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     The file, whose name ends with `.ply`. An existing file is replaced.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     The name does not end with `.ply`.
    /// FileNotFoundError
    ///     The folder does not exist.
    /// NunetError
    ///     The file cannot be written.
    fn save(&self, py: Python<'_>, #[pyo3(from_py_with = argument::path)] path: PathBuf) -> PyResult<()> {
        if path.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("ply")) {
            return Err(hinted::<PyValueError>(
                format!("`path` is `{}`; expected a name that ends with `.ply`", path.display()),
                "PLY is the only format: convert it with Open3D or MeshLab",
            ));
        }
        let (cells, metric) = (self.cells(py)?, self.units == METRE);
        let written = py.detach(|| write_cloud(&path, &cells, metric));
        written.map_err(|error| failure(&error.into()))
    }

    /// The points that have depth, with their colors, for Open3D.
    ///
    /// Returns
    /// -------
    /// open3d.geometry.PointCloud
    ///     float64 points, colors from 0 to 1.
    ///
    /// Raises
    /// ------
    /// ImportError
    ///     The package open3d is not installed (the extra `open3d`).
    fn to_open3d(slf: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        let module = slf.py().import("nunet_py._export")?;
        Ok(module.getattr("to_open3d")?.call1((slf,))?.unbind())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, PickledCloud<'py>)> {
        let restore = py.import("nunet_py._native")?.getattr("_cloud")?;
        let arrays =
            (self.points.bind(py).clone(), self.labels.bind(py).clone(), self.colors.bind(py).clone());
        Ok((restore, (arrays.0, arrays.1, arrays.2, self.units.clone())))
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let points = self.points.bind(py);
        format!("Cloud({}x{} points)", points.shape()[1], points.shape()[0])
    }
}

/// Restores a pickled cloud.
#[pyfunction]
fn _cloud(
    points: Bound<'_, PyArray3<f32>>,
    labels: Bound<'_, PyArray2<u8>>,
    colors: Bound<'_, PyArray3<u8>>,
    units: &str,
) -> Cloud {
    Cloud::of_arrays(points, labels, colors, units)
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Cloud>()?;
    module.add_function(wrap_pyfunction!(_cloud, module)?)
}
