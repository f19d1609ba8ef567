#![expect(
    clippy::needless_lifetimes,
    reason = "one macro makes functions that borrow from the argument, and others that do not"
)]
//! Checks of argument types: an error says what was given, what is expected and how to write it.

use std::path::PathBuf;

use nunet_ipc::FrameHeader;
use nunet_source::Rotation;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::error::hinted;

/// Longest value shown in a message, characters.
const MAX_SHOWN_CHARS: usize = 60;

/// Defines a converter for each argument. pyo3 does not pass the name of an argument to its converter, so
/// each name needs a function of its own.
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
    scale("scale"): optional_scale -> Option<f64>;
    width("width"): whole -> u32;
    height("height"): whole -> u32;
    near("near"): optional_number -> Option<f32>;
    far("far"): optional_number -> Option<f32>;
    cloud_range("max_range"): distance -> f32;
    name_or_path("name_or_path"): file -> PathBuf;
    provider("provider"): text -> &'a str;
    threads("threads"): optional_whole -> Option<i64>;
    aspect("aspect"): text -> &'a str;
    color("color"): text -> &'a str;
    attitude("attitude"): angles -> Option<(f64, f64)>;
    roll("roll"): radians -> f32;
    pitch("pitch"): radians -> f32;
    path("path"): file -> PathBuf;
    folder("folder"): file -> PathBuf;
    topic("topic"): optional_text -> Option<&'a str>;
    camera_name("camera"): name -> &'a str;
    timeout("timeout"): seconds -> Option<f64>;
    encoding("encoding"): text -> &'a str;
    clock("clock"): text -> &'a str;
    frame_id("frame_id"): coordinate_frame -> &'a str;
    capture_nanos("capture_nanos"): nanos -> Option<i64>;
    sequence("sequence"): number_of_image -> Option<u64>;
    readers("readers"): whole -> u32;
    clearance("clearance"): meters -> f32;
    robot_height("robot_height"): meters -> f32;
    max_range("max_range"): meters -> f32;
    sectors("sectors"): whole -> u32;
    rotation("rotate"): degrees -> Option<Rotation>;
}

/// Converts an argument.
///
/// # Errors
/// `TypeError` if it is of another type than expected.
pub(crate) fn taken<'a, 'py, T: FromPyObject<'a, 'py>>(
    argument: &str,
    object: &'a Bound<'py, PyAny>,
    expected: &str,
    hint: &str,
) -> PyResult<T> {
    object.extract().map_err(|_| {
        hinted::<PyTypeError>(format!("`{argument}` is `{}`; expected {expected}", shown(object)), hint)
    })
}

/// The value as Python writes it, cut to a length that fits in a message.
pub(crate) fn shown(object: &Bound<'_, PyAny>) -> String {
    let mut text = object.repr().map_or_else(|_| "?".to_owned(), |text| text.to_string());
    if let Some((end, _)) = text.char_indices().nth(MAX_SHOWN_CHARS) {
        text.truncate(end);
        text.push_str("...");
    }
    text
}

fn number(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<f64> {
    taken(argument, object, "a number", "write it without quotes, such as 518.9")
}

fn meters(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<f32> {
    taken(argument, object, "a number of meters", "write it without quotes, such as 0.05")
}

fn radians(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<f32> {
    taken(argument, object, "a number of radians", "write it without quotes, such as -0.1")
}

/// Roll and pitch; `None` leaves the mount unchanged.
fn angles(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<(f64, f64)>> {
    taken(argument, object, "a tuple (roll, pitch) of radians", "write it as `(0.02, -0.1)`, or omit it")
}

fn optional_number(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<f32>> {
    taken(argument, object, "a number", "omit it to use the range of the depth map")
}

fn optional_scale(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<f64>> {
    taken(argument, object, "a number", "omit it if the factor was not measured")
}

/// `None` is no limit.
fn distance(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<f32> {
    let expected = "a distance of more than 0";
    let given: Option<f32> = taken(argument, object, expected, "omit it for no limit")?;
    let range = given.unwrap_or(f32::INFINITY);
    if range > 0.0 {
        return Ok(range);
    }
    let message = format!("`{argument}` is `{}`; expected {expected}", shown(object));
    Err(hinted::<PyValueError>(message, "omit it for no limit"))
}

/// `None` waits without limit.
fn seconds(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<f64>> {
    taken(argument, object, "seconds, 0 or more", "pass `None` to wait without limit")
}

fn whole(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<u32> {
    taken(argument, object, "a whole number, 0 or more", "round it, `int(round(x))`")
}

fn optional_whole(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<i64>> {
    taken(argument, object, "a whole number", "omit it to use the default")
}

/// `None` is the current time.
fn nanos(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<i64>> {
    taken(argument, object, "whole nanoseconds, 0 or more", "omit it for the current time")
}

/// `None` is the next number.
fn number_of_image(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<u64>> {
    taken(argument, object, "a whole number, 0 or more", "omit it for the next number")
}

/// The name of a coordinate frame, which a header has room for.
fn coordinate_frame<'a>(argument: &str, object: &'a Bound<'_, PyAny>) -> PyResult<&'a str> {
    let name = text(argument, object)?;
    let (bytes, most) = (name.len(), FrameHeader::default().frame_id.len());
    if bytes <= most {
        return Ok(name);
    }
    let message = format!("`{argument}` has {bytes} bytes; expected at most {most}");
    Err(hinted::<PyValueError>(message, "give the coordinate frame a shorter name"))
}

/// `None` leaves images unchanged.
fn degrees(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Option<Rotation>> {
    let hint = "omit it for images that are upright";
    let given: Option<i64> = taken(argument, object, "90, 180 or 270", hint)?;
    let parsed = given.map(|degrees| degrees.to_string().parse::<Rotation>()).transpose();
    parsed.map_err(|error| hinted::<PyValueError>(format!("`{argument}`: {error}"), hint))
}

fn text<'a>(argument: &str, object: &'a Bound<'_, PyAny>) -> PyResult<&'a str> {
    taken(argument, object, "a str", "write the word in quotes")
}

fn optional_text<'a>(argument: &str, object: &'a Bound<'_, PyAny>) -> PyResult<Option<&'a str>> {
    taken(argument, object, "a str", "write the word in quotes, or omit it")
}

fn name<'a>(argument: &str, object: &'a Bound<'_, PyAny>) -> PyResult<&'a str> {
    taken(argument, object, "the name of a camera", "pass a str, as in `nunetd --camera`")
}

fn file(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    taken(argument, object, "a path", "pass a str or a `pathlib.Path`")
}
