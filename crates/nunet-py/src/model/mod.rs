//! A model in this process.

mod about;
mod batch;
mod options;
mod run;
mod scale;
mod warnings;

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use nunet_core::camera::Mount;
use nunet_core::scale::ScaleMode;
use nunet_engine::ModelOptions;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use self::about::About;
use self::run::Setting;
use self::warnings::Warnings;
use crate::argument;
use crate::array::import_numpy;
use crate::camera::{PyCamera, camera_argument};
use crate::error::{failure, warn};
use crate::fork_guard::ForkGuard;
use crate::image::{ColorOrder, ImageArgument};
use crate::obstacles::optional_mount_argument;
use crate::result::{Result, ResultContext};

/// A network that runs in this process, like `nunetd infer`.
///
/// A model file that is new on this machine is first loaded in a child process with limits on memory and
/// time. Then its self-test must reproduce the outputs that were recorded at export.
///
/// Several threads may share a model: it takes one image at a time and releases the GIL meanwhile. It cannot
/// be used after `os.fork`: the child process gets an error and must end with `os._exit`, as processes of
/// `multiprocessing` do.
///
/// Parameters
/// ----------
/// name_or_path : str or os.PathLike
///     A model file (.onnx), a staged graph (.toml), or the name of a bundled model: `wnet_c.onnx`,
///     `unet.onnx`. The ending of a name may be omitted.
/// provider : str
///     The execution provider: `auto`, `cpu`, `openvino`, `cuda` or `tensorrt`.
/// threads : int, optional
///     Number of threads; by default one per core.
/// aspect : str
///     What is done with images whose aspect ratio differs from that of `Model.size` by more than 5 %: `crop`
///     (the largest centered part of the model's aspect ratio is used; `Result.view` says which), `stretch`,
///     or `letterbox` (padded).
/// filters : str or sequence of str, optional
///     Filters for depth, written as in `nunetd --filter`: `"spatial"`,
///     `["decimation=2", "temporal=alpha:0.4"]`. Each may be given once. The temporal filter needs
///     `keep_state=True` in `infer`.
/// scale : str or float, optional
///     The factor by which the network's meters are multiplied: `auto` (the default: the camera's `scale`,
///     otherwise the ratio of its focal length to the training camera's), `off` (1), a number, or `floor`
///     (measured on the floor). With `floor` and `keep_state=True`, the factor changes smoothly from image to
///     image; by default each image is independent.
/// mount : sequence of float, optional
///     The pose of the camera on the robot, `(x, y, z, roll, pitch, yaw)`, meters and radians, for
///     `scale="floor"`. z is the height above the floor. Positive pitch looks down.
///
/// Raises
/// ------
/// FileNotFoundError
///     Neither a file nor a bundled model has this name.
/// ModelError
///     The file is damaged or has no metadata, or its self-test failed.
/// WiringError
///     The stages of a staged graph do not fit together.
/// ValueError
///     An unknown provider or filter, fewer than 1 thread, or a `mount` without `scale="floor"`.
/// NunetError
///     The ONNX Runtime library is missing, or does not have the provider.
///
/// Warns
/// -----
/// UserWarning
///     The weights are untrained, or the file has no self-test.
///
/// Examples
/// --------
/// >>> import nunet_py as nunet
/// >>> model = nunet.Model("wnet_c.onnx")
/// >>> model.size
/// (640, 480)
#[pyclass(frozen, name = "Model", module = "nunet_py")]
pub(crate) struct PyModel {
    // The threads of ONNX Runtime do not exist in a fork, and dropping it there would wait for them.
    inner: ForkGuard<Mutex<nunet_engine::Model>>,
    about: About,
    shared: Arc<ResultContext>,
    warnings: Warnings,
    /// The pose of the camera, if the scale comes from the floor.
    mount: Option<Mount>,
    has_factor: bool,
}

#[pymethods]
impl PyModel {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "the arguments of the Python class")]
    #[pyo3(signature = (
        name_or_path, *, provider = "auto", threads = None, aspect = "crop", filters = None, scale = None,
        mount = None
    ))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = argument::name_or_path)] name_or_path: PathBuf,
        #[pyo3(from_py_with = argument::provider)] provider: &str,
        #[pyo3(from_py_with = argument::threads)] threads: Option<i64>,
        #[pyo3(from_py_with = argument::aspect)] aspect: &str,
        filters: Option<&Bound<'_, PyAny>>,
        scale: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = optional_mount_argument)] mount: Option<Vec<f64>>,
    ) -> PyResult<Self> {
        import_numpy(py)?;
        let (provider, threads) = (options::provider(provider)?, options::threads(threads)?);
        let filters = filters.map(options::filters).transpose()?.unwrap_or_default();
        let (scale, factor) = scale::of_arguments(scale, mount)?;
        let aspect = options::aspect(aspect)?;
        let options = ModelOptions { provider, threads, aspect, filters, scale, factor };
        let model = py.detach(|| nunet_engine::Model::open(&name_or_path, options));
        let model = model.map_err(|error| failure(&error.into()))?;
        let description = model.pipeline().graph().description();
        let path = model.path().display();
        if !description.trained {
            warn(py, &format!("`{path}` has untrained weights: its depth is meaningless"))?;
        }
        if description.selftest.is_none() {
            warn(py, &format!("`{path}` has no self-test: its outputs on this machine are unverified"))?;
        }
        let class_names = PyTuple::new(py, &description.classes)?.unbind();
        let shared = Arc::new(ResultContext::new(class_names, model.pipeline().stage_names().to_vec()));
        let (about, warnings) = (About::of(&model), Warnings::default());
        let mount = if let ScaleMode::Floor(mount) = scale { Some(mount) } else { None };
        let inner = ForkGuard::new(Mutex::new(model));
        Ok(Self { inner, about, shared, warnings, mount, has_factor: factor.is_some() })
    }

    /// Estimate depth and labels of one image. `model(rgb)` is the same.
    ///
    /// Parameters
    /// ----------
    /// rgb : numpy.ndarray, str, os.PathLike or PIL.Image.Image
    ///     An array is uint8 (H, W, 3), rows from the top, with any strides. A path names a JPEG or PNG file,
    ///     which is rotated as its EXIF orientation says. A PIL image of 8 bits per channel is converted to
    ///     RGB and not rotated. Images of any size are resized to `Model.size`, after cropping or padding
    ///     (`aspect`). An array is read without the GIL: do not write to it meanwhile.
    /// camera : Camera, optional
    ///     The camera of the image. Meters are scaled by its focal length, and points lie on its rays. By
    ///     default the training camera is assumed (`scale_source` is `assumed_camera`).
    /// color : str
    ///     The channel order of an array: `rgb`, or `bgr` for images of OpenCV.
    /// keep_state : bool
    ///     Whether the image is the next frame of the same video. Recurrent networks and the temporal filter
    ///     then keep their state; others ignore it. By default each image is independent.
    /// attitude : tuple of float, optional
    ///     Roll and pitch of the camera, radians, as an inertial sensor measures them, for `scale="floor"`.
    ///     They replace those of `mount` for this image only.
    ///
    /// Returns
    /// -------
    /// Result
    ///     `depth`: float32 (H, W) at `Model.size`, meters along the optical axis, NaN where there is no
    ///     depth. `labels`, `cloud()` and more.
    ///
    /// Raises
    /// ------
    /// TypeError
    ///     `rgb` is not an image, or is not of 8 bits per channel.
    /// ValueError
    ///     The image has another shape, is empty, or has a side beyond 32768.
    /// FileNotFoundError
    ///     The file does not exist.
    /// CameraError
    ///     The camera's aspect ratio is not that of the image.
    /// ModelError
    ///     The network failed to run.
    /// NunetError
    ///     The file is damaged or is neither JPEG nor PNG, or the model was made before a fork.
    ///
    /// Warns
    /// -----
    /// UserWarning
    ///     Once for a model: no camera was given, the image was cropped or stretched to the model's aspect
    ///     ratio, or the camera's scale was measured with another `aspect`.
    ///
    /// Examples
    /// --------
    /// >>> import numpy as np, nunet_py as nunet
    /// >>> result = nunet.Model("wnet_c.onnx").infer(np.zeros((480, 640, 3), np.uint8))
    /// >>> result.depth.shape, result.depth.dtype
    /// ((480, 640), dtype('float32'))
    #[pyo3(signature = (rgb, *, camera = None, color = "rgb", keep_state = false, attitude = None))]
    fn infer(
        &self,
        py: Python<'_>,
        rgb: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = camera_argument)] camera: Option<PyCamera>,
        #[pyo3(from_py_with = argument::color)] color: &str,
        keep_state: bool,
        #[pyo3(from_py_with = argument::attitude)] attitude: Option<(f64, f64)>,
    ) -> PyResult<Result> {
        let image = ImageArgument::take("rgb", rgb, ColorOrder::named(color)?)?;
        self.infer_one(py, &image, Setting { camera, keep_state, attitude })
    }

    /// Estimate depth and labels of one image: the same as `infer`.
    #[pyo3(signature = (rgb, *, camera = None, color = "rgb", keep_state = false, attitude = None))]
    fn __call__(
        &self,
        py: Python<'_>,
        rgb: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = camera_argument)] camera: Option<PyCamera>,
        #[pyo3(from_py_with = argument::color)] color: &str,
        keep_state: bool,
        #[pyo3(from_py_with = argument::attitude)] attitude: Option<(f64, f64)>,
    ) -> PyResult<Result> {
        self.infer(py, rgb, camera, color, keep_state, attitude)
    }

    /// Estimate depth and labels of several images, one after the other.
    ///
    /// Parameters
    /// ----------
    /// images : iterable
    ///     Images as for `infer`, or one array (N, H, W, 3).
    /// camera : Camera, optional
    ///     The camera of all images, as for `infer`.
    /// color : str
    ///     The channel order of arrays: `rgb` or `bgr`.
    /// keep_state : bool
    ///     Whether the images are the frames of one video, which starts with the first of them. By default
    ///     each image is independent.
    ///
    /// Returns
    /// -------
    /// list of Result
    ///     The result of each image, in order.
    ///
    /// Raises
    /// ------
    /// TypeError
    ///     `images` is not iterable or is a single image.
    ///
    /// The exceptions of `infer`, with the index of the image as a note.
    #[pyo3(signature = (images, *, camera = None, color = "rgb", keep_state = false))]
    fn infer_batch(
        &self,
        py: Python<'_>,
        images: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = camera_argument)] camera: Option<PyCamera>,
        #[pyo3(from_py_with = argument::color)] color: &str,
        keep_state: bool,
    ) -> PyResult<Vec<Result>> {
        let order = ColorOrder::named(color)?;
        let mut results = Vec::new();
        for (index, image) in batch::images(images)?.enumerate() {
            let result = ImageArgument::take("rgb", &image?, order).and_then(|image| {
                self.infer_one(
                    py,
                    &image,
                    Setting { camera, keep_state: keep_state && index > 0, attitude: None },
                )
            });
            results.push(result.map_err(|error| batch::with_note(py, error, index))?);
            py.check_signals()?;
        }
        Ok(results)
    }

    /// Width and height of the results, pixels: those of the network, divided by the decimation filter.
    #[getter]
    fn size(&self) -> (u32, u32) {
        (self.about.size.width, self.about.size.height)
    }

    /// The name of each label, in order; empty if the network does not segment.
    #[getter]
    fn class_names(&self, py: Python<'_>) -> Py<PyTuple> {
        self.shared.class_names.clone_ref(py)
    }

    /// `unet`, `wnet`, `wnet_c` and so on; `foreign` for a network described by a sidecar file.
    #[getter]
    fn architecture(&self) -> &str {
        &self.about.architecture
    }

    /// Whether the weights are trained.
    #[getter]
    fn trained(&self) -> bool {
        self.about.trained
    }

    /// The execution provider: `cpu`, `openvino`, `cuda` or `tensorrt`.
    #[getter]
    fn provider(&self) -> &'static str {
        self.about.provider
    }

    /// The filters in the order in which they run, with all their settings.
    #[getter]
    fn filters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.about.filters)
    }

    /// The model file.
    #[getter]
    fn path(&self) -> PathBuf {
        self.about.path.clone()
    }

    /// The metadata of the file as `nunetd inspect --json` prints it: components, tensors, accuracy, training
    /// camera, license, SHA-256.
    #[getter]
    fn metadata(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        Ok(py.import("json")?.getattr("loads")?.call1((&self.about.json,))?.unbind())
    }

    fn __repr__(&self) -> String {
        let About { path, size, architecture, trained, provider, .. } = &self.about;
        let trained = if *trained { "" } else { ", untrained" };
        format!("Model('{}', {architecture}, {size}, provider='{provider}'{trained})", path.display())
    }
}

/// The argument `model`.
pub(crate) fn model_argument(object: &Bound<'_, PyAny>) -> PyResult<Py<PyModel>> {
    argument::taken(
        "model",
        object,
        "a Model",
        "make one, `nunet_py.Model(NAME)`, and use it for all recordings",
    )
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyModel>()
}
