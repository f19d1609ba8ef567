//! Recordings through a model.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use nunet_daemon::embed::{Player, Step};
use pyo3::prelude::*;

use crate::argument;
use crate::camera::Camera;
use crate::error::{failure, warn};
use crate::model::Model;
use crate::result::Result;

/// The results of a recording's pictures, one after the other: an iterator that `replay` makes.
///
/// Nothing is read or computed before it is asked for.
#[pyclass(frozen, module = "nunet_py")]
pub(crate) struct Replay {
    model: Py<Model>,
    /// `None` once the recording is over.
    player: Mutex<Option<Player>>,
    #[pyo3(get)]
    topic: String,
    #[pyo3(get)]
    pictures: Option<u64>,
    shown: String,
}

/// What one step gave, without the interpreter.
enum Next {
    Step(Step),
    Failed(anyhow::Error),
}

impl Replay {
    /// One step, alone with the model; the recording is closed at its end and where it is cut off.
    fn step(&self, py: Python<'_>) -> PyResult<Next> {
        self.model.get().alone(py, |model| {
            let mut player = self.player.lock().unwrap_or_else(PoisonError::into_inner);
            let Some(open) = player.as_mut() else { return Next::Step(Step::End) };
            let step = open.step(model);
            if !matches!(step, Ok(Step::Played(_) | Step::Lost { .. } | Step::Nothing)) {
                *player = None;
            }
            step.map_or_else(Next::Failed, Next::Step)
        })
    }
}

#[pymethods]
impl Replay {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Result>> {
        loop {
            match self.step(py)? {
                Next::Step(Step::Played(played)) => {
                    let shared = self.model.get().shared();
                    return Result::of_recording(py, *played, self.topic.clone(), shared).map(Some);
                }
                Next::Step(Step::Lost { sequence, error }) => {
                    warn(py, &format!("picture {sequence} of `{}` is lost: {error:#}", self.shown))?;
                }
                // A long stretch without pictures: Ctrl-C must be heard.
                Next::Step(Step::Nothing) => py.check_signals()?,
                Next::Step(Step::End) => return Ok(None),
                Next::Failed(error) => return Err(failure(&error)),
            }
        }
    }

    fn __repr__(&self) -> String {
        format!("Replay('{}', topic='{}')", self.shown, self.topic)
    }
}

/// Take a recording through a model, as `nunetd replay` does: an iterator over results.
///
/// MCAP files with ROS 2's `sensor_msgs/msg/Image` and `CompressedImage` (and their `CameraInfo`) or Foxglove's messages.
/// Results carry the picture's stamp, topic, coordinate frame and camera. Networks with a memory see a stream, and begin
/// anew where it jumps.
///
/// Parameters
/// ----------
/// path : str or os.PathLike
///     The recording.
/// model : Model
///     What the pictures go through. Pictures of others that go through it in between make a network with a memory begin
///     anew.
/// topic : str, optional
///     The topic with pictures, where there are several.
/// camera : Camera, optional
///     The camera, in place of the recording's own.
///
/// Returns
/// -------
/// Replay
///     Yields `Result`; `replay.topic` says which topic is read, `replay.pictures` how many pictures there are where the
///     file's index knows.
///
/// Raises
/// ------
/// FileNotFoundError
///     There is no such file.
/// ValueError
///     Several topics with pictures and none named, no such topic.
/// NunetError
///     It is no MCAP file or has no pictures; while iterating: the file is damaged or cut off here, after every
///     picture before was yielded.
///
/// Warns
/// -----
/// UserWarning
///     A picture is unreadable and left out.
#[pyfunction]
#[pyo3(signature = (path, model, *, topic = None, camera = None))]
fn replay(
    py: Python<'_>,
    #[pyo3(from_py_with = argument::path)] path: PathBuf,
    #[pyo3(from_py_with = argument::model)] model: Py<Model>,
    #[pyo3(from_py_with = argument::topic)] topic: Option<&str>,
    #[pyo3(from_py_with = argument::camera)] camera: Option<Camera>,
) -> PyResult<Replay> {
    let camera = camera.map(|camera| camera.0);
    let player = py.detach(|| Player::open(&path, topic, camera)).map_err(|error| failure(&error))?;
    let (topic, pictures) = (player.topic().to_owned(), player.pictures());
    let shown = path.display().to_string();
    Ok(Replay { model, player: Mutex::new(Some(player)), topic, pictures, shown })
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Replay>()?;
    module.add_function(wrap_pyfunction!(replay, module)?)
}
