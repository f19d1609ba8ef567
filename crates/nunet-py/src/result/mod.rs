//! The results of one image.

mod build;
mod memory;
mod pickle;
mod points;
mod shared;

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyArray2, PyArray3};
use nunet_core::camera;
use nunet_core::obstacle::ObstacleOptions;
use nunet_types::{ImageSize, PixelRect};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

pub(crate) use self::shared::ResultContext;
use crate::argument;
use crate::camera::{PyCamera, camera_argument};
use crate::cloud::Cloud;
use crate::obstacles::{self, PyObstacles};

/// The message of a recording that held the image.
#[derive(Clone, Default)]
struct Origin {
    topic: Option<String>,
    frame_id: Option<String>,
    sequence: Option<u64>,
    capture_nanos: Option<i64>,
}

/// Depth and labels of one image. The arrays belong to this result: later calls do not change them.
///
/// Results can be pickled.
///
/// Attributes
/// ----------
/// depth : numpy.ndarray
///     float32 (H, W), rows from the top: distance along the optical axis, in `units`. NaN where there is no
///     depth.
/// labels : numpy.ndarray or None
///     uint8 (H, W): indices into `class_names`; `None` if the network does not segment.
/// confidence : numpy.ndarray or None
///     uint8 (H, W): 255 = certain, 0 where there is no depth; `None` if the network has no confidence.
/// class_names : tuple of str
///     The name of each label.
/// rgb : numpy.ndarray
///     uint8 (H, W, 3): the image at the size of `depth`, as the network saw it.
/// units : str
///     `metre`, or `relative` for depth without a scale.
/// scale_source : str
///     `metric`: meters of the network. `focal_scaled`: meters scaled by the camera's focal length.
///     `assumed_camera`: meters that hold if the training camera took the image; pass a camera to scale them.
///     `calibrated`: meters times a measured factor. `floor`: meters scaled by the floor. `relative`: no
///     scale.
/// scale_factor : float or None
///     Factor by which the network's meters were multiplied; `None` if `units` is `relative`.
/// timings : dict of str to float
///     Milliseconds of each stage in order, and `total`, which includes the memory of the result.
/// invalid_pixels : int
///     Number of NaN pixels of `depth`.
/// quality : str
///     `full`, or `reused_labels` if a stage was skipped.
/// camera : Camera or None
///     The camera at the size of `depth`; `None` if it is unknown.
/// view : tuple of int
///     The part of the image that `depth` covers: first column, first row, width, height, pixels of the
///     image.
/// capture_nanos : int or None
///     For recordings: the image's time stamp, nanoseconds since 1970.
/// topic, frame_id : str or None
///     For recordings: the image's topic and coordinate frame.
/// sequence : int or None
///     For recordings: the image's index, from 0.
#[pyclass(frozen, module = "nunet_py")]
pub(crate) struct Result {
    #[pyo3(get)]
    depth: Py<PyArray2<f32>>,
    #[pyo3(get)]
    labels: Option<Py<PyArray2<u8>>>,
    #[pyo3(get)]
    confidence: Option<Py<PyArray2<u8>>>,
    #[pyo3(get)]
    rgb: Py<PyArray3<u8>>,
    #[pyo3(get)]
    units: String,
    #[pyo3(get)]
    scale_source: String,
    #[pyo3(get)]
    scale_factor: Option<f64>,
    #[pyo3(get)]
    timings: Py<PyDict>,
    #[pyo3(get)]
    invalid_pixels: u32,
    #[pyo3(get)]
    quality: String,
    #[pyo3(get)]
    camera: Option<PyCamera>,
    origin: Origin,
    points_camera: camera::Camera,
    image_size: ImageSize,
    view: PixelRect,
    shared: Arc<ResultContext>,
}

#[pymethods]
impl Result {
    #[getter]
    fn class_names(&self, py: Python<'_>) -> Py<PyTuple> {
        self.shared.class_names.clone_ref(py)
    }

    #[getter]
    fn view(&self) -> (u32, u32, u32, u32) {
        (self.view.x, self.view.y, self.view.width, self.view.height)
    }

    #[getter]
    fn topic(&self) -> Option<&str> {
        self.origin.topic.as_deref()
    }

    #[getter]
    fn frame_id(&self) -> Option<&str> {
        self.origin.frame_id.as_deref()
    }

    #[getter]
    fn sequence(&self) -> Option<u64> {
        self.origin.sequence
    }

    #[getter]
    fn capture_nanos(&self) -> Option<i64> {
        self.origin.capture_nanos
    }

    /// Compute the point cloud of the depth map.
    ///
    /// Parameters
    /// ----------
    /// camera : Camera, optional
    ///     The camera whose rays the points lie on. By default the one that was passed to `Model.infer`, else
    ///     the training camera. It does not scale the depth: `Model.infer` does that.
    /// max_range : float, optional
    ///     Points farther from the camera than this have no coordinates (NaN), as with `nunetd --max-range`.
    ///     The distance is along the ray, in the unit of the depth. By default there is no limit.
    ///
    /// Returns
    /// -------
    /// Cloud
    ///     One point per pixel, in the camera's optical frame.
    ///
    /// Raises
    /// ------
    /// CameraError
    ///     The camera's aspect ratio is not that of the image.
    /// ValueError
    ///     `max_range` is not more than 0.
    #[pyo3(signature = (camera = None, *, max_range = f32::INFINITY), text_signature = "($self, camera=None, *, max_range=None)")]
    fn cloud(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = camera_argument)] camera: Option<PyCamera>,
        #[pyo3(from_py_with = argument::cloud_range)] max_range: f32,
    ) -> PyResult<Cloud> {
        Cloud::of_points(py, &self.points(py, camera, max_range)?, self.size(), &self.units)
    }

    /// Find obstacles around a robot.
    ///
    /// Parameters
    /// ----------
    /// mount : sequence of float
    ///     The camera in the robot's leveled base frame, whose origin is on the floor: x, y, z in meters (z
    ///     is the height above the floor), then roll, pitch, yaw in radians. Positive pitch looks down.
    /// camera : Camera, optional
    ///     The camera, as for `cloud`.
    /// clearance : float, optional
    ///     Height above the ground that the robot can drive over, meters.
    /// robot_height : float, optional
    ///     Height above the ground that the robot can drive under, meters.
    /// sectors : int, optional
    ///     Number of directions over the camera's field of view, 1 to 360.
    /// max_range : float, optional
    ///     Obstacles farther from the base are ignored, meters.
    ///
    /// Returns
    /// -------
    /// Obstacles
    ///     What each direction holds, and points of obstacles.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     `units` is not `metre`, the camera is not above the floor or looks straight up, or an argument is
    ///     out of range.
    /// CameraError
    ///     The camera's aspect ratio is not that of the image.
    #[pyo3(signature = (mount, *, camera = None, clearance = 0.05, robot_height = 1.8, sectors = 72, max_range = 5.0))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn obstacles(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = obstacles::mount_argument)] mount: Vec<f64>,
        #[pyo3(from_py_with = camera_argument)] camera: Option<PyCamera>,
        #[pyo3(from_py_with = argument::clearance)] clearance: f32,
        #[pyo3(from_py_with = argument::robot_height)] robot_height: f32,
        #[pyo3(from_py_with = argument::sectors)] sectors: u32,
        #[pyo3(from_py_with = argument::max_range)] max_range: f32,
    ) -> PyResult<PyObstacles> {
        let options = ObstacleOptions {
            clearance_m: clearance,
            robot_height_m: robot_height,
            sectors: sectors as usize,
            max_range_m: max_range,
            ..ObstacleOptions::default()
        };
        self.find_obstacles(py, &mount, camera, options)
    }

    /// Write the results as files, like `nunetd infer`.
    ///
    /// `depth.npy`: float32, NaN where there is no depth. `depth_mm.png`: 16-bit millimeters, 0 where there
    /// is no depth; only if `units` is `metre`. `depth.png`: colors with a scale. `labels.png`: class
    /// indices; only if there are labels. `confidence.png`: 255 = certain; only if there is a confidence.
    /// `cloud.ply`: the points that have depth.
    ///
    /// Parameters
    /// ----------
    /// folder : str or os.PathLike
    ///     The folder of the files. It is created if it does not exist; existing files are replaced.
    /// camera : Camera, optional
    ///     The camera of `cloud.ply`, as for `cloud`.
    ///
    /// Returns
    /// -------
    /// list of pathlib.Path
    ///     The files.
    ///
    /// Raises
    /// ------
    /// CameraError
    ///     The camera's aspect ratio is not that of the image.
    /// NunetError
    ///     A file cannot be written.
    #[pyo3(signature = (folder, *, camera = None))]
    fn save(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = argument::folder)] folder: PathBuf,
        #[pyo3(from_py_with = camera_argument)] camera: Option<PyCamera>,
    ) -> PyResult<Vec<PathBuf>> {
        let cloud = self.points(py, camera, f32::INFINITY)?;
        self.write(py, &folder, &cloud)
    }

    /// Plot the image, its depth with a scale, and its labels with their names.
    ///
    /// Returns
    /// -------
    /// matplotlib.figure.Figure
    ///     A figure without a window: a notebook shows it, `figure.savefig(path)` writes it.
    ///
    /// Raises
    /// ------
    /// ImportError
    ///     The package matplotlib is not installed (the extra `plot`).
    fn plot(slf: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        let module = slf.py().import("nunet_py._export")?;
        Ok(module.getattr("plot")?.call1((slf,))?.unbind())
    }

    /// The points that have depth, with their colors, for Open3D: `cloud().to_open3d()`.
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
        let cloud = slf.get().cloud(slf.py(), None, f32::INFINITY)?;
        Ok(Bound::new(slf.py(), cloud)?.call_method0("to_open3d")?.unbind())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<pickle::Reduced<'py>> {
        pickle::reduce(py, self)
    }

    fn __repr__(&self) -> String {
        let size = self.size();
        let pixels = size.pixel_count() as f64;
        let valid = 100.0 * (1.0 - f64::from(self.invalid_pixels) / pixels);
        let (units, source) = (&self.units, &self.scale_source);
        format!("Result({size}, units='{units}', scale_source='{source}', {valid:.0} % valid)")
    }
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Result>()?;
    module.add_function(wrap_pyfunction!(pickle::_result, module)?)
}
