#![expect(
    clippy::needless_lifetimes,
    reason = "one macro makes functions that borrow from the argument, and others that do not"
)]
//! Arguments of another type than expected: what was given, and what to give.

use std::path::PathBuf;

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::camera::Camera;
use crate::model::Model;

/// Of a value that is shown in a message.
const MOST_CHARACTERS: usize = 60;

/// For each argument a function that takes it, since pyo3 says its name to nobody who makes a message.
macro_rules! arguments {
    ($($function:ident($name:literal): $kind:ident -> $type:ty;)*) => {
        $(pub(crate) fn $function<'a>(object: &'a Bound<'_, PyAny>) -> PyResult<$type> {
            $kind($name, object)
        })*
    };
}

arguments! {
    fx("fx"): number -> f64;
    fy("fy"): number -> f64;
    cx("cx"): number -> f64;
    cy("cy"): number -> f64;
    distortion_model("distortion_model"): optional_text -> Option<&'a str>;
    width("width"): whole -> u32;
    height("height"): whole -> u32;
    near("near"): optional_number -> Option<f32>;
    far("far"): optional_number -> Option<f32>;
    name_or_path("name_or_path"): file -> PathBuf;
    provider("provider"): text -> &'a str;
    threads("threads"): optional_whole -> Option<i64>;
    camera("camera"): optional_camera -> Option<Camera>;
    intrinsics("intrinsics"): optional_camera -> Option<Camera>;
    path("path"): file -> PathBuf;
    model("model"): loaded -> Py<Model>;
    topic("topic"): optional_text -> Option<&'a str>;
    camera_name("camera"): name -> &'a str;
    timeout("timeout"): seconds -> Option<f64>;
    encoding("encoding"): text -> &'a str;
    clock("clock"): text -> &'a str;
    frame_id("frame_id"): text -> &'a str;
    readers("readers"): whole -> u32;
}

fn taken<'a, 'py, T: FromPyObject<'a, 'py>>(
    argument: &str,
    object: &'a Bound<'py, PyAny>,
    expected: &str,
    hint: &str,
) -> PyResult<T> {
    object.extract().map_err(|_| {
        let mut shown = object.repr().map_or_else(|_| "?".to_owned(), |text| text.to_string());
        if let Some((end, _)) = shown.char_indices().nth(MOST_CHARACTERS) {
            shown.truncate(end);
            shown.push_str("...");
        }
        PyTypeError::new_err(format!("`{argument}` is `{shown}`; expected {expected}\nhint: {hint}"))
    })
}

fn number(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<f64> {
    taken(argument, object, "a number", "without quotes, such as 518.9")
}

fn optional_number(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<f32>> {
    taken(argument, object, "a number", "leave it away for the map's own")
}

/// `None` is for ever.
fn seconds(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<f64>> {
    taken(argument, object, "seconds, 0 or more", "`None` waits for ever")
}

fn whole(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<u32> {
    taken(argument, object, "a whole number, 0 or more", "`int(round(x))` is one")
}

fn optional_whole(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<i64>> {
    taken(argument, object, "a whole number", "leave it away for the default")
}

fn text<'a>(argument: &str, object: &'a Bound<'_, PyAny>) -> PyResult<&'a str> {
    taken(argument, object, "a str", "a word in quotes")
}

fn optional_text<'a>(argument: &str, object: &'a Bound<'_, PyAny>) -> PyResult<Option<&'a str>> {
    taken(argument, object, "a str", "a word in quotes, or leave it away")
}

fn name<'a>(argument: &str, object: &'a Bound<'_, PyAny>) -> PyResult<&'a str> {
    taken(argument, object, "a camera's name", "a str, as of `nunetd --camera`")
}

fn file(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    taken(argument, object, "a path", "a str or a `pathlib.Path`")
}

fn optional_camera(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<Camera>> {
    let hint = "`nunet_py.Camera(fx=..., fy=..., cx=..., cy=..., size=(width, height))`";
    taken(argument, object, "a Camera", hint)
}

fn loaded(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Py<Model>> {
    taken(argument, object, "a Model", "`nunet_py.Model(NAME)` makes one, for several recordings")
}
