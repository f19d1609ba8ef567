//! A model in this process.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use nunet_core::graph::Provider;
use nunet_daemon::embed::{self, ModelOptions};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::camera::Camera;
use crate::error::{NunetError, failure, of_camera, of_pipeline, warn};
use crate::picture::Picture;
use crate::result::{Result, Shared};

/// A network that runs in this process: the pipeline of `nunetd infer`.
///
/// A file that is new on this machine is first loaded in a child process with limits, and its self-test must give the
/// numbers of its export. One model may be used from several threads: pictures go through one after the other, without
/// the GIL. It does not survive `os.fork`.
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
    inner: Mutex<embed::Model>,
    /// The process that made it: ONNX Runtime's threads do not live on in a fork.
    process: u32,
    shared: Arc<Shared>,
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
        self.check_process()?;
        // A panic leaves buffers with some numbers of an older picture, which every run writes anew.
        Ok(py.detach(|| work(&mut self.inner.lock().unwrap_or_else(PoisonError::into_inner))))
    }

    pub(crate) fn shared(&self) -> Arc<Shared> {
        Arc::clone(&self.shared)
    }

    fn check_process(&self) -> PyResult<()> {
        let (made, here) = (self.process, std::process::id());
        if made == here {
            return Ok(());
        }
        Err(NunetError::new_err(format!(
            "this model was made in process `{made}`, and process `{here}` is a fork of it: the threads that compute did \
             not come along\nhint: make the model after the fork, or start processes with \
             `multiprocessing.get_context(\"spawn\")`"
        )))
    }
}

#[pymethods]
impl Model {
    #[new]
    #[pyo3(signature = (name_or_path, *, provider = "auto", threads = None))]
    fn new(py: Python<'_>, name_or_path: PathBuf, provider: &str, threads: Option<i64>) -> PyResult<Self> {
        let options = ModelOptions { provider: self::provider(provider)?, threads: self::threads(threads)? };
        let model = py.detach(|| embed::Model::open(&name_or_path, options));
        let model = model.map_err(|error| failure(&error))?;
        let about = model.pipeline().graph().description();
        let shown = model.path().display();
        if !about.trained {
            warn(py, &format!("`{shown}` carries untrained weights: its depth means nothing"))?;
        }
        if about.selftest.is_none() {
            warn(
                py,
                &format!("`{shown}` carries no self-test: nobody knows whether its numbers are right here"),
            )?;
        }
        let class_names = PyTuple::new(py, &about.classes)?.unbind();
        let shared = Arc::new(Shared::new(class_names, model.pipeline().stage_names().to_vec()));
        Ok(Self { inner: Mutex::new(model), process: std::process::id(), shared })
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
        camera: Option<&Bound<'_, Camera>>,
        follows: bool,
    ) -> PyResult<Result> {
        let picture = Picture::take("rgb", rgb)?;
        let frame = picture.view()?;
        let (width, height) = frame.size();
        let camera =
            camera.map(|camera| camera.get().0.fitted_to(width, height)).transpose().map_err(of_camera)?;
        let inferred = self.alone(py, |model| model.infer(&frame, camera, follows))?.map_err(of_pipeline)?;
        Result::of_picture(py, inferred, (width, height), self.shared())
    }

    /// Width and height of the network's picture and of its results, pixels.
    #[getter]
    fn size(&self, py: Python<'_>) -> PyResult<(u32, u32)> {
        self.alone(py, |model| model.size())
    }

    /// The name of each label, in order; empty where the network does not segment.
    #[getter]
    fn class_names(&self, py: Python<'_>) -> Py<PyTuple> {
        self.shared.class_names.clone_ref(py)
    }

    /// `unet`, `wnet`, `wnet_c`, ...; `foreign` for a network described by a sidecar.
    #[getter]
    fn architecture(&self, py: Python<'_>) -> PyResult<String> {
        self.alone(py, |model| model.pipeline().graph().description().architecture.clone())
    }

    /// Whether the weights were trained at all.
    #[getter]
    fn trained(&self, py: Python<'_>) -> PyResult<bool> {
        self.alone(py, |model| model.pipeline().graph().description().trained)
    }

    /// What computes: `cpu`, `openvino`, `cuda` or `tensorrt`.
    #[getter]
    fn provider(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.alone(py, |model| model.pipeline().graph().provider().name())
    }

    /// The model file.
    #[getter]
    fn path(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let path = self.alone(py, |model| model.path().to_owned())?;
        Ok(py.import("pathlib")?.getattr("Path")?.call1((path,))?.unbind())
    }

    /// Everything that the file says of itself, as `nunetd inspect --json` prints it: components, tensors, accuracy,
    /// training camera, licence, SHA-256.
    #[getter]
    fn metadata(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let about = self.alone(py, |model| model.about_json().to_owned())?;
        Ok(py.import("json")?.getattr("loads")?.call1((about,))?.unbind())
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        self.alone(py, |model| {
            let graph = model.pipeline().graph();
            let ((width, height), about) = (model.size(), graph.description());
            let trained = if about.trained { "" } else { ", untrained" };
            let (path, provider) = (model.path().display(), graph.provider());
            format!(
                "Model('{path}', {}, {width}x{height}, provider='{provider}'{trained})",
                about.architecture
            )
        })
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
