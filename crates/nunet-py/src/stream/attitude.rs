//! `AttitudePublisher`: roll and pitch of a robot, for a daemon.

use std::sync::{Mutex, MutexGuard, PoisonError};

use nunet_ipc::{AttitudePublisher, CameraName, Clock, IpcError, monotonic_nanos, unix_nanos};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::errors::{camera_name, ipc_error};
use super::publisher::clock_of;
use crate::argument;
use crate::error::{NunetError, hinted};
use crate::fork_guard::ForkGuard;

/// Publish the attitude of the robot's base for a camera, for `nunetd --attitude shm`.
///
/// A context manager that stops publishing at the end of its block. Several threads may share it. A forked
/// process must make its own.
///
/// Parameters
/// ----------
/// camera : str
///     The camera's name: 1 to 64 of `a-z A-Z 0-9 _ - .`.
/// clock : str, optional
///     The clock of the samples' times: `monotonic` (`time.monotonic_ns()`) or `unix` (`time.time_ns()`).
///
/// Raises
/// ------
/// NunetError
///     Another process publishes it, or `/dev/shm` is too small.
/// ValueError
///     An invalid name or clock.
///
/// Examples
/// --------
/// >>> import nunet_py as nunet
/// >>> with nunet.AttitudePublisher("front") as attitude:
/// ...     attitude.publish(roll=0.02, pitch=-0.1)  # about 50 to 200 times per second
#[pyclass(frozen, name = "AttitudePublisher", module = "nunet_py")]
#[derive(Debug)]
pub(crate) struct PyAttitudePublisher {
    camera: CameraName,
    clock: Clock,
    open: ForkGuard<Mutex<Option<AttitudePublisher>>>,
}

impl PyAttitudePublisher {
    fn open(&self) -> PyResult<MutexGuard<'_, Option<AttitudePublisher>>> {
        Ok(self.open.get("publisher")?.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn closed(&self) -> PyErr {
        let message = format!("this publisher of the attitude for camera `{}` is closed", self.camera);
        hinted::<NunetError>(message, "use it inside its `with` block, or make a new one")
    }
}

#[pymethods]
impl PyAttitudePublisher {
    #[new]
    #[pyo3(signature = (camera, *, clock = "monotonic"))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = argument::camera_name)] camera: &str,
        #[pyo3(from_py_with = argument::clock)] clock: &str,
    ) -> PyResult<Self> {
        let (camera, clock) = (camera_name(camera)?, clock_of(clock)?);
        if clock == Clock::Media {
            let message = "`clock` is `media`; a sensor has no position in a recording";
            return Err(hinted::<PyValueError>(message, "pass `monotonic` or `unix`"));
        }
        let opened = py.detach(|| AttitudePublisher::create(&camera, clock)).map_err(ipc_error)?;
        Ok(Self { camera, clock, open: ForkGuard::new(Mutex::new(Some(opened))) })
    }

    /// Publish a sample. Call it for each measurement of the sensor.
    ///
    /// Parameters
    /// ----------
    /// roll : float
    ///     Rotation of the base about x (forward), radians. A positive roll lowers the right side.
    /// pitch : float
    ///     Rotation of the base about y (left), radians. A positive pitch lowers the front.
    /// capture_nanos : int, optional
    ///     When it was measured, nanoseconds of the publisher's clock. By default the current time.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     An angle that is not a number or is beyond a turn, or a negative `capture_nanos`.
    /// NunetError
    ///     This publisher is closed.
    #[pyo3(signature = (roll, pitch, *, capture_nanos = None))]
    fn publish(
        &self,
        #[pyo3(from_py_with = argument::roll)] roll: f32,
        #[pyo3(from_py_with = argument::pitch)] pitch: f32,
        #[pyo3(from_py_with = argument::capture_nanos)] capture_nanos: Option<i64>,
    ) -> PyResult<()> {
        let now = || if self.clock == Clock::Unix { unix_nanos() } else { monotonic_nanos() };
        let mut open = self.open()?;
        let publisher = open.as_mut().ok_or_else(|| self.closed())?;
        let published = publisher.publish(capture_nanos.unwrap_or_else(now), roll, pitch);
        published.map_err(|error| match error {
            IpcError::Attitude { .. } => hinted::<PyValueError>(error.to_string(), "give angles in radians"),
            error => ipc_error(error),
        })
    }

    /// Stop publishing. Closing twice is not an error.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let publisher = self.open()?.take();
        py.detach(|| drop(publisher));
        Ok(())
    }

    /// The camera's name.
    #[getter]
    fn camera(&self) -> &str {
        self.camera.as_str()
    }

    fn __enter__(slf: Py<Self>) -> PyResult<Py<Self>> {
        let this = slf.get();
        if this.open()?.is_none() {
            return Err(this.closed());
        }
        Ok(slf)
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) -> PyResult<()> {
        self.close(py)
    }

    fn __repr__(&self) -> String {
        format!("AttitudePublisher({:?})", self.camera.as_str())
    }
}
