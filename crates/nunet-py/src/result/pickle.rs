//! Results that are pickled: their arrays, and everything else as a dictionary.

use std::sync::Arc;

use numpy::{PyArray2, PyArray3};
use nunet_types::PixelRect;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use super::{Origin, Result, ResultContext};
use crate::camera::PyCamera;

/// A result without its depth, labels and colors.
#[derive(FromPyObject, IntoPyObject)]
#[pyo3(from_item_all)]
pub(super) struct PickledResult {
    confidence: Option<Py<PyArray2<u8>>>,
    class_names: Py<PyTuple>,
    units: String,
    scale_source: String,
    scale_factor: Option<f64>,
    quality: String,
    timings: Py<PyDict>,
    invalid_pixels: u32,
    camera: Option<PyCamera>,
    points_camera: PyCamera,
    image_size: (u32, u32),
    view: (u32, u32, u32, u32),
    topic: Option<String>,
    frame_id: Option<String>,
    sequence: Option<u64>,
    capture_nanos: Option<i64>,
}

/// The function that restores a result, and its arguments.
pub(super) type Reduced<'py> =
    (Bound<'py, PyAny>, (Py<PyArray2<f32>>, Option<Py<PyArray2<u8>>>, Py<PyArray3<u8>>, PickledResult));

/// What pickle stores of a result.
pub(super) fn reduce<'py>(py: Python<'py>, result: &Result) -> PyResult<Reduced<'py>> {
    let Origin { topic, frame_id, sequence, capture_nanos } = result.origin.clone();
    let state = PickledResult {
        confidence: result.confidence.as_ref().map(|values| values.clone_ref(py)),
        class_names: result.shared.class_names.clone_ref(py),
        units: result.units.clone(),
        scale_source: result.scale_source.clone(),
        scale_factor: result.scale_factor,
        quality: result.quality.clone(),
        timings: result.timings.clone_ref(py),
        invalid_pixels: result.invalid_pixels,
        camera: result.camera,
        points_camera: PyCamera(result.points_camera, None),
        image_size: (result.image_size.width, result.image_size.height),
        view: (result.view.x, result.view.y, result.view.width, result.view.height),
        topic,
        frame_id,
        sequence,
        capture_nanos,
    };
    let labels = result.labels.as_ref().map(|labels| labels.clone_ref(py));
    let restore = py.import("nunet_py._native")?.getattr("_result")?;
    Ok((restore, (result.depth.clone_ref(py), labels, result.rgb.clone_ref(py), state)))
}

/// Restores a pickled result.
#[pyfunction]
pub(super) fn _result(
    depth: Py<PyArray2<f32>>,
    labels: Option<Py<PyArray2<u8>>>,
    rgb: Py<PyArray3<u8>>,
    state: PickledResult,
) -> Result {
    let PickledResult { topic, frame_id, sequence, capture_nanos, view: (x, y, width, height), .. } = state;
    Result {
        depth,
        labels,
        confidence: state.confidence,
        rgb,
        units: state.units,
        scale_source: state.scale_source,
        scale_factor: state.scale_factor,
        timings: state.timings,
        invalid_pixels: state.invalid_pixels,
        quality: state.quality,
        camera: state.camera,
        origin: Origin { topic, frame_id, sequence, capture_nanos },
        points_camera: state.points_camera.0,
        image_size: state.image_size.into(),
        view: PixelRect { x, y, width, height },
        shared: Arc::new(ResultContext::new(state.class_names, Vec::new())),
    }
}
