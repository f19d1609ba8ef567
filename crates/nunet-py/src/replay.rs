//! Recordings through a model.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use nunet_source::Rotation;
use pyo3::prelude::*;

use crate::argument;
use crate::camera::{PyCamera, camera_argument};
use crate::error::{failure, warn};
use crate::image_replay::{ImageReplay, ReplayedStep};
use crate::model::{PyModel, model_argument};
use crate::result::Result;

/// An iterator over the results of a recording's images, returned by `replay`.
///
/// Images are read and processed on demand.
#[pyclass(frozen, name = "Replay", module = "nunet_py")]
pub(crate) struct PyReplay {
    model: Py<PyModel>,
    /// `None` after the end of the recording.
    player: Mutex<Option<ImageReplay>>,
    #[pyo3(get)]
    topic: String,
    #[pyo3(get)]
    images: Option<u64>,
    path: String,
}

/// The outcome of one step, without Python objects.
enum ReplayStep {
    Step(ReplayedStep),
    Failed(anyhow::Error),
}

impl PyReplay {
    /// Reads and processes one image. The recording is closed at its end and where it is cut off.
    fn step(&self, py: Python<'_>) -> PyResult<ReplayStep> {
        self.model.get().exclusive(py, |model| {
            let mut player = self.player.lock().unwrap_or_else(PoisonError::into_inner);
            let Some(open) = player.as_mut() else { return ReplayStep::Step(ReplayedStep::End) };
            let step = open.step(model);
            if !matches!(step, Ok(ReplayedStep::Image(_) | ReplayedStep::Lost { .. } | ReplayedStep::Nothing))
            {
                *player = None;
            }
            step.map_or_else(ReplayStep::Failed, ReplayStep::Step)
        })
    }
}

#[pymethods]
impl PyReplay {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Result>> {
        loop {
            match self.step(py)? {
                ReplayStep::Step(ReplayedStep::Image(played)) => {
                    let model = self.model.get();
                    model.warn_of_factor(py, played.uses_factor)?;
                    model.warn_of_guesses(py, &played.inferred)?;
                    return Result::of_recording(py, *played, self.topic.clone(), model.shared()).map(Some);
                }
                ReplayStep::Step(ReplayedStep::Lost { sequence, was_read, error }) => {
                    let action = if was_read { "process" } else { "read" };
                    warn(py, &format!("cannot {action} image {sequence} of `{}`: {error:#}", self.path))?;
                }
                // Between images, so that Ctrl-C ends the wait.
                ReplayStep::Step(ReplayedStep::Nothing) => py.check_signals()?,
                ReplayStep::Step(ReplayedStep::End) => return Ok(None),
                ReplayStep::Failed(error) => return Err(failure(&error)),
            }
        }
    }

    fn __repr__(&self) -> String {
        format!("Replay('{}', topic='{}')", self.path, self.topic)
    }
}

/// Run a recording through a model, like `nunetd replay`: an iterator over results.
///
/// Reads MCAP files with images of ROS 2 (`sensor_msgs/msg/Image`, `CompressedImage` and their `CameraInfo`)
/// or Foxglove. Results carry the image's time stamp, topic, coordinate frame and camera. A recurrent network
/// keeps its state from image to image, and resets it at discontinuities.
///
/// Parameters
/// ----------
/// path : str or os.PathLike
///     The recording.
/// model : Model
///     The model. If other images go through it meanwhile, a recurrent network resets its state.
/// topic : str, optional
///     The image topic, required if the recording has several.
/// camera : Camera, optional
///     The camera, used instead of the recording's own. It describes the images before they are rotated.
/// rotate : int, optional
///     Rotate the images clockwise before everything else, by 90, 180 or 270 degrees, because the camera was
///     mounted turned. Results have no `frame_id` then.
///
/// Returns
/// -------
/// Replay
///     Yields `Result`. `replay.topic` is the image topic; `replay.images` is the number of images, or `None`
///     if the recording has no index.
///
/// Raises
/// ------
/// FileNotFoundError
///     The file does not exist.
/// ValueError
///     The recording has several image topics and none was named, or does not have the named one. `rotate` is
///     another number.
/// CameraError
///     While iterating: the aspect ratio of `camera` is not that of the images.
/// NunetError
///     The file is not MCAP or has no images. While iterating: the file is damaged or cut off at this point,
///     after every complete image was yielded.
///
/// Warns
/// -----
/// UserWarning
///     An image cannot be read or processed and is skipped. Once for a model: see `Model.infer`.
#[pyfunction]
#[pyo3(signature = (path, model, *, topic = None, camera = None, rotate = None))]
fn replay(
    py: Python<'_>,
    #[pyo3(from_py_with = argument::path)] path: PathBuf,
    #[pyo3(from_py_with = model_argument)] model: Py<PyModel>,
    #[pyo3(from_py_with = argument::topic)] topic: Option<&str>,
    #[pyo3(from_py_with = camera_argument)] camera: Option<PyCamera>,
    #[pyo3(from_py_with = argument::rotation)] rotate: Option<Rotation>,
) -> PyResult<PyReplay> {
    let factor = model.get().factor_of(camera)?;
    let camera = camera.map(|camera| camera.0);
    let player = py
        .detach(|| ImageReplay::open(&path, topic, rotate, camera, factor))
        .map_err(|error| failure(&error))?;
    let (topic, images) = (player.topic().to_owned(), player.image_count());
    let path = path.display().to_string();
    Ok(PyReplay { model, player: Mutex::new(Some(player)), topic, images, path })
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyReplay>()?;
    module.add_function(wrap_pyfunction!(replay, module)?)
}
