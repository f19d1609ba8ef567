//! A model in this process.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use nunet_core::graph::Provider;
use nunet_daemon::embed::{self, ModelOptions};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::argument;
use crate::camera::Camera;
use crate::error::{failure, of_camera, of_pipeline, warn};
use crate::own::Own;
use crate::picture::Picture;
use crate::result::{Result, Shared};

/// A network that runs in this process: the pipeline of `nunetd infer`.
///
/// A file that is new on this machine is first loaded in a child process with limits, and its self-test must give the
/// numbers of its export. One model may be used from several threads: pictures go through one after the other, without
/// the GIL. It does not survive `os.fork`: a child that uses it gets an error, and must end by `os._exit`, as those of
/// `multiprocessing` do, because ONNX Runtime waits at exit for threads that did not come along.
///
/// Parameters
/// ----------
/// name_or_path : str or os.PathLike
///     An existing .onnx file or a staged graph's .toml, else the name of a bundled model: `wnet_c.onnx`, `wnet_c`.
/// provider : str
///     What computes: `auto`, `cpu`, `openvino`, `cuda` or `tensorrt`.
/// threads : int, optional
///     Threads of one prediction; one a core by default.
///
/// Raises
/// ------
/// FileNotFoundError
///     Neither a path nor a bundled model.
/// ModelError
///     A file that cannot be used: damaged, without metadata, or whose numbers are wrong on this machine.
/// WiringError
///     The stages of a staged graph do not fit together.
/// ValueError
///     No such provider, threads below 1.
/// NunetError
///     ONNX Runtime's library is missing or does not start, or it does not have the provider.
///
/// Warns
/// -----
/// UserWarning
///     The weights are untrained, or the file carries no self-test.
///
/// Examples
/// --------
/// >>> import nunet_py as nunet
/// >>> model = nunet.Model("wnet_c.onnx")
/// >>> model.size
/// (640, 480)
#[pyclass(frozen, module = "nunet_py")]
pub(crate) struct Model {
    // ONNX Runtime's threads do not live on in a fork, and dropping it there would wait for them.
    inner: Own<Mutex<embed::Model>>,
    about: About,
    shared: Arc<Shared>,
}

/// What never changes: who asks for it need not wait for a picture to be done.
struct About {
    path: PathBuf,
    size: (u32, u32),
    architecture: String,
    trained: bool,
    provider: &'static str,
    json: String,
}

impl About {
    fn of(model: &embed::Model) -> Self {
        let graph = model.pipeline().graph();
        Self {
            path: model.path().to_owned(),
            size: model.size(),
            architecture: graph.description().architecture.clone(),
            trained: graph.description().trained,
            provider: graph.provider().name(),
            json: model.about_json().to_owned(),
        }
    }
}

impl Model {
    /// Runs `work` alone with the model and without the GIL.
    ///
    /// # Errors
    /// This process is a fork of the model's.
    pub(crate) fn alone<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut embed::Model) -> T + Send,
    ) -> PyResult<T> {
        let inner = self.inner.get("model")?;
        // A panic leaves buffers with some numbers of an older picture, which every run writes anew.
        Ok(py.detach(|| work(&mut inner.lock().unwrap_or_else(PoisonError::into_inner))))
    }

    pub(crate) fn shared(&self) -> Arc<Shared> {
        Arc::clone(&self.shared)
    }
}

#[pymethods]
impl Model {
    #[new]
    #[pyo3(signature = (name_or_path, *, provider = "auto", threads = None))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = argument::name_or_path)] name_or_path: PathBuf,
        #[pyo3(from_py_with = argument::provider)] provider: &str,
        #[pyo3(from_py_with = argument::threads)] threads: Option<i64>,
    ) -> PyResult<Self> {
        let (provider, threads) = (self::provider(provider)?, self::threads(threads)?);
        let options = ModelOptions { provider, threads, ..ModelOptions::default() };
        let model = py.detach(|| embed::Model::open(&name_or_path, options));
        let model = model.map_err(|error| failure(&error))?;
        let description = model.pipeline().graph().description();
        let shown = model.path().display();
        if !description.trained {
            warn(py, &format!("`{shown}` carries untrained weights: its depth means nothing"))?;
        }
        if description.selftest.is_none() {
            warn(
                py,
                &format!("`{shown}` carries no self-test: nobody knows whether its numbers are right here"),
            )?;
        }
        let class_names = PyTuple::new(py, &description.classes)?.unbind();
        let shared = Arc::new(Shared::new(class_names, model.pipeline().stage_names().to_vec()));
        let about = About::of(&model);
        Ok(Self { inner: Own::new(Mutex::new(model)), about, shared })
    }

    /// Depth and labels of one picture.
    ///
    /// Parameters
    /// ----------
    /// rgb : numpy.ndarray
    ///     uint8 (H, W, 3), red first, C-contiguous, of any size: one that differs from `Model.size` is resized, its whole
    ///     field of view is kept. Of OpenCV's pictures, blue first: `np.ascontiguousarray(bgr[..., ::-1])`. It is read
    ///     without the GIL: do not write into it meanwhile.
    /// camera : Camera, optional
    ///     The camera of the picture, or of pictures of the same shape. Metres are corrected for its focal length, and
    ///     points lie on its rays. Without it the training camera is assumed (`scale_source` says so).
    /// follows : bool
    ///     Whether the picture follows the last one of a stream. A network with a memory then remembers; others do not
    ///     care. Without it each picture stands for itself.
    ///
    /// Returns
    /// -------
    /// Result
    ///     `depth`: float32 (H, W) at `Model.size`, metres along the optical axis, NaN where there is none; `labels`,
    ///     `cloud()` and more.
    ///
    /// Raises
    /// ------
    /// TypeError
    ///     `rgb` is no array of uint8.
    /// ValueError
    ///     Another shape, no pixel, sides beyond 32768, not C-contiguous; the message says what to call.
    /// CameraError
    ///     The camera does not fit the picture's shape.
    /// ModelError
    ///     The network did not run.
    /// NunetError
    ///     The model was made before a fork.
    ///
    /// Examples
    /// --------
    /// >>> import numpy as np, nunet_py as nunet
    /// >>> result = nunet.Model("wnet_c.onnx").infer(np.zeros((480, 640, 3), np.uint8))
    /// >>> result.depth.shape, result.depth.dtype
    /// ((480, 640), dtype('float32'))
    #[pyo3(signature = (rgb, *, camera = None, follows = false))]
    fn infer(
        &self,
        py: Python<'_>,
        rgb: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = argument::camera)] camera: Option<Camera>,
        follows: bool,
    ) -> PyResult<Result> {
        let picture = Picture::take("rgb", rgb)?;
        let frame = picture.view()?;
        let (width, height) = frame.size();
        let camera = camera.map(|camera| camera.0.fitted_to(width, height)).transpose().map_err(of_camera)?;
        let inferred = self.alone(py, |model| model.infer(&frame, camera, follows))?.map_err(of_pipeline)?;
        Result::of_picture(py, inferred, (width, height), self.shared())
    }

    /// Width and height of the network's picture and of its results, pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        self.about.size
    }

    /// The name of each label, in order; empty where the network does not segment.
    #[getter]
    fn class_names(&self, py: Python<'_>) -> Py<PyTuple> {
        self.shared.class_names.clone_ref(py)
    }

    /// `unet`, `wnet`, `wnet_c`, ...; `foreign` for a network described by a sidecar.
    #[getter]
    fn architecture(&self) -> &str {
        &self.about.architecture
    }

    /// Whether the weights were trained at all.
    #[getter]
    fn trained(&self) -> bool {
        self.about.trained
    }

    /// What computes: `cpu`, `openvino`, `cuda` or `tensorrt`.
    #[getter]
    fn provider(&self) -> &'static str {
        self.about.provider
    }

    /// The model file.
    #[getter]
    fn path(&self) -> PathBuf {
        self.about.path.clone()
    }

    /// Everything that the file says of itself, as `nunetd inspect --json` prints it: components, tensors, accuracy,
    /// training camera, licence, SHA-256.
    #[getter]
    fn metadata(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        Ok(py.import("json")?.getattr("loads")?.call1((&self.about.json,))?.unbind())
    }

    fn __repr__(&self) -> String {
        let About { path, size: (width, height), architecture, trained, provider, .. } = &self.about;
        let trained = if *trained { "" } else { ", untrained" };
        format!(
            "Model('{}', {architecture}, {width}x{height}, provider='{provider}'{trained})",
            path.display()
        )
    }
}

fn provider(name: &str) -> PyResult<Provider> {
    let names: Vec<_> = Provider::ALL.iter().map(|provider| provider.name()).collect();
    Provider::ALL.into_iter().find(|provider| provider.name() == name).ok_or_else(|| {
        PyValueError::new_err(format!("`provider` is `{name}`\nhint: one of {}", names.join(", ")))
    })
}

fn threads(count: Option<i64>) -> PyResult<Option<NonZeroUsize>> {
    let Some(count) = count else { return Ok(None) };
    match usize::try_from(count).ok().and_then(NonZeroUsize::new) {
        Some(threads) => Ok(Some(threads)),
        None => Err(PyValueError::new_err(format!(
            "`threads` is `{count}`; expected 1 or more\nhint: leave it away for one a core"
        ))),
    }
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Model>()
}
