//! The scale mode of a model.

use nunet_core::camera::{Mount, check_scale_factor};
use nunet_core::scale::ScaleMode;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::argument::shown;
use crate::error::{hinted, of_camera};
use crate::obstacles;

const HINT: &str = "pass \"auto\", \"off\", \"floor\" or a number, as in `nunetd --scale`";

/// The arguments `scale` and `mount` of a model: the mode, and a factor that is given as a number.
pub(super) fn of_arguments(
    scale: Option<&Bound<'_, PyAny>>,
    mount: Option<Vec<f64>>,
) -> PyResult<(ScaleMode, Option<f32>)> {
    let mount = mount.map(|numbers| obstacles::mount(&numbers)).transpose()?;
    if scale.is_some_and(|scale| scale.extract::<&str>().is_ok_and(|word| word == "floor")) {
        return Ok((ScaleMode::Floor(mount.ok_or_else(without_mount)?), None));
    }
    if mount.is_some() {
        let message = "`mount` is given, but the model does not take its scale from the floor";
        let hint = "pass `scale=\"floor\"`; for obstacles, pass the mount to `Result.obstacles`";
        return Err(hinted::<PyValueError>(message, hint));
    }
    let Some(scale) = scale else { return Ok((ScaleMode::Auto, None)) };
    if let Ok(factor) = scale.extract::<f64>() {
        return Ok((ScaleMode::Auto, Some(check_scale_factor(factor).map_err(of_camera)?)));
    }
    match scale.extract::<&str>() {
        Ok("auto") => Ok((ScaleMode::Auto, None)),
        Ok("off") => Ok((ScaleMode::Off, None)),
        Ok(word) => Err(hinted::<PyValueError>(format!("`scale` is `{word}`; expected a known word"), HINT)),
        Err(_) => {
            let message = format!("`scale` is `{}`; expected a word or a number", shown(scale));
            Err(hinted::<PyTypeError>(message, HINT))
        }
    }
}

fn without_mount() -> PyErr {
    let message = "`scale` is `floor`, but `mount` is missing";
    hinted::<PyValueError>(message, "pass `mount=(x, y, z, roll, pitch, yaw)`, meters and radians")
}

/// The argument `attitude`: roll and pitch of the camera, radians.
pub(super) fn with_attitude(mount: Option<Mount>, attitude: (f64, f64)) -> PyResult<Mount> {
    let Some(mount) = mount else {
        let message = "`attitude` is given, but the model does not take its scale from the floor";
        return Err(hinted::<PyValueError>(message, "make the model with `scale=\"floor\"` and a `mount`"));
    };
    mount.with_attitude(attitude.0, attitude.1).map_err(|error| obstacles::refused(&error))
}
