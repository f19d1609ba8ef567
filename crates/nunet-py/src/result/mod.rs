//! The results of one image.

mod memory;
mod pickle;
mod shared;

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use numpy::{PyArray2, PyArray3, PyArrayMethods as _};
use nunet_core::camera;
use nunet_core::cloud::{CloudOptions, CloudPoint, organized_cloud};
use nunet_core::filter::Appearance;
use nunet_engine::Inferred;
use nunet_files::{Results, write_results};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use self::memory::array;
pub(crate) use self::shared::Shared;
use crate::argument;
use crate::camera::{Camera, camera_argument};
use crate::cloud::{Cloud, METRE};
use crate::error::{NunetError, failure, of_camera};
use crate::player::Played;

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
///     float32 (H, W), rows from the top: distance along the optical axis, in `units`. NaN where there is no depth.
/// labels : numpy.ndarray or None
///     uint8 (H, W): indices into `class_names`; `None` if the network does not segment.
/// class_names : tuple of str
///     The name of each label.
/// rgb : numpy.ndarray
///     uint8 (H, W, 3): the image at the size of `depth`, as the network saw it.
/// units : str
///     `metre`, or `relative` for depth without a scale.
/// scale_source : str
///     `metric`: meters of the network. `focal_scaled`: meters scaled by the camera's focal length. `assumed_camera`:
///     meters that hold if the training camera took the image; pass a camera to scale them. `relative`: no scale.
/// timings : dict of str to float
///     Milliseconds of each stage in order, and `total`, which includes the memory of the result.
/// invalid_pixels : int
///     Number of NaN pixels of `depth`.
/// quality : str
///     `full`, or `reused_labels` if a stage was skipped.
/// camera : Camera or None
///     The camera at the size of `depth`; `None` if it is unknown.
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
    rgb: Py<PyArray3<u8>>,
    #[pyo3(get)]
    units: String,
    #[pyo3(get)]
    scale_source: String,
    #[pyo3(get)]
    timings: Py<PyDict>,
    #[pyo3(get)]
    invalid_pixels: u32,
    #[pyo3(get)]
    quality: String,
    #[pyo3(get)]
    camera: Option<Camera>,
    origin: Origin,
    points_camera: camera::Camera,
    image_size: (u32, u32),
    shared: Arc<Shared>,
}

impl Result {
    /// The results of an image of `image_size`.
    pub(crate) fn of_image(
        py: Python<'_>,
        inferred: Inferred,
        image_size: (u32, u32),
        shared: Arc<Shared>,
    ) -> PyResult<Self> {
        Self::new(py, inferred, image_size, Origin::default(), shared)
    }

    /// The results of an image of a recording.
    pub(crate) fn of_recording(
        py: Python<'_>,
        played: Played,
        topic: String,
        shared: Arc<Shared>,
    ) -> PyResult<Self> {
        let origin = Origin {
            topic: Some(topic),
            frame_id: Some(played.frame_id),
            sequence: Some(played.sequence),
            capture_nanos: Some(played.capture_unix_nanos),
        };
        Self::new(py, played.inferred, played.frame_size, origin, shared)
    }

    fn new(
        py: Python<'_>,
        inferred: Inferred,
        image_size: (u32, u32),
        origin: Origin,
        shared: Arc<Shared>,
    ) -> PyResult<Self> {
        let Inferred { depth, labels, rgb, report, points_camera, total_nanos } = inferred;
        let (width, height) = (points_camera.intrinsics.width, points_camera.intrinsics.height);
        let (rows, columns) = (height as usize, width as usize);
        let timings = PyDict::new(py);
        for (name, &micros) in shared.stage_names.iter().zip(report.stages.micros()) {
            timings.set_item(name, f64::from(micros) / 1e3)?;
        }
        timings.set_item("total", total_nanos as f64 / 1e6)?;
        let labels = labels.map(|labels| array(py, labels, [rows, columns])).transpose()?;
        Ok(Self {
            depth: array(py, depth, [rows, columns])?.cast_into()?.unbind(),
            labels: labels.map(|labels| labels.cast_into().map(Bound::unbind)).transpose()?,
            rgb: array(py, rgb, [rows, columns, 3])?.cast_into()?.unbind(),
            units: report.units.name().to_owned(),
            scale_source: report.scale_source.name().to_owned(),
            timings: timings.unbind(),
            invalid_pixels: report.invalid_pixels,
            quality: report.quality.name().to_owned(),
            camera: report.camera.map(Camera),
            origin,
            points_camera,
            image_size,
            shared,
        })
    }

    /// Width and height of `depth`.
    fn size(&self) -> (u32, u32) {
        (self.points_camera.intrinsics.width, self.points_camera.intrinsics.height)
    }

    /// The camera of the points, at the size of `depth`. A given camera may have the size of the image or any other of its
    /// aspect ratio.
    fn camera_for_points(&self, camera: Option<Camera>) -> PyResult<camera::Camera> {
        let Some(Camera(camera)) = camera else { return Ok(self.points_camera) };
        let ((width, height), own) = (self.image_size, self.size());
        let fitted = camera.fitted_to(width, height).and_then(|camera| camera.scaled_to(own.0, own.1));
        fitted.map_err(of_camera)
    }

    /// One point per pixel of `depth`.
    fn points(&self, py: Python<'_>, camera: Option<Camera>) -> PyResult<Vec<CloudPoint>> {
        let camera = self.camera_for_points(camera)?;
        let depth = self.depth.bind(py).try_readonly()?;
        let rgb = self.rgb.bind(py).try_readonly()?;
        let labels = self.labels.as_ref().map(|labels| labels.bind(py).try_readonly()).transpose()?;
        let (depth, rgb) = (depth.as_slice()?, rgb.as_slice()?);
        let labels = labels.as_ref().map(|labels| labels.as_slice()).transpose()?;
        let points = py.detach(|| {
            let mut points = vec![CloudPoint::NONE; depth.len()];
            let rays = self.shared.rays(camera);
            let options = CloudOptions { stride: NonZeroU32::MIN, max_range_m: f32::INFINITY };
            let appearance = Appearance { rgb, labels };
            organized_cloud(depth, &rays, &appearance, options, &mut points).map(|()| points)
        });
        points.map_err(|error| NunetError::new_err(error.to_string()))
    }

    /// Writes the files of [`Result::save`].
    fn write(&self, py: Python<'_>, folder: &Path, cloud: &[CloudPoint]) -> PyResult<Vec<PathBuf>> {
        let depth = self.depth.bind(py).try_readonly()?;
        let labels = self.labels.as_ref().map(|labels| labels.bind(py).try_readonly()).transpose()?;
        let results = Results {
            size: self.size().into(),
            depth: depth.as_slice()?,
            metric: self.units == METRE,
            labels: labels.as_ref().map(|labels| labels.as_slice()).transpose()?,
            cloud: Some(cloud),
        };
        py.detach(|| write_results(folder, &results)).map_err(|error| failure(&error.into()))
    }
}

#[pymethods]
impl Result {
    #[getter]
    fn class_names(&self, py: Python<'_>) -> Py<PyTuple> {
        self.shared.class_names.clone_ref(py)
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
    ///     The camera whose rays the points lie on. By default the one that was passed to `Model.infer`, else the training
    ///     camera. It does not scale the depth: `Model.infer` does that.
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
    #[pyo3(signature = (camera = None))]
    fn cloud(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = camera_argument)] camera: Option<Camera>,
    ) -> PyResult<Cloud> {
        Cloud::of_points(py, &self.points(py, camera)?, self.size(), &self.units)
    }

    /// Write the results as files, like `nunetd infer`.
    ///
    /// `depth.npy`: float32, NaN where there is no depth. `depth_mm.png`: 16-bit millimeters, 0 where there is no depth; only
    /// if `units` is `metre`. `depth.png`: colors with a scale. `labels.png`: class indices; only if there are labels.
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
        #[pyo3(from_py_with = camera_argument)] camera: Option<Camera>,
    ) -> PyResult<Vec<PathBuf>> {
        let cloud = self.points(py, camera)?;
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
        let cloud = slf.get().cloud(slf.py(), None)?;
        Ok(Bound::new(slf.py(), cloud)?.call_method0("to_open3d")?.unbind())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<pickle::Reduced<'py>> {
        pickle::reduce(py, self)
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.size();
        let pixels = f64::from(width) * f64::from(height);
        let valid = 100.0 * (1.0 - f64::from(self.invalid_pixels) / pixels);
        let (units, source) = (&self.units, &self.scale_source);
        format!("Result({width}x{height}, units='{units}', scale_source='{source}', {valid:.0} % valid)")
    }
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Result>()?;
    module.add_function(wrap_pyfunction!(pickle::_result, module)?)
}
