//! Depth in colours, for people's eyes.

use numpy::ndarray::Array3;
use numpy::{Ix2, PyArray3, PyUntypedArrayMethods as _};
use nunet_daemon::embed;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::argument;
use crate::picture::{check_order, check_type, read, shown, untyped};

/// Depth in the colours of nunetd's `depth.png`: near is red, far is blue, no depth is grey.
///
/// Parameters
/// ----------
/// depth : numpy.ndarray
///     float32 (H, W), metres or any unit; NaN where there is none. C-contiguous.
/// near, far : float, optional
///     The depths of the reddest and the bluest colour, in the unit of `depth`. Without them the map's own first and
///     last percentile: fine for one picture; a video flickers less with fixed ones.
///
/// Returns
/// -------
/// numpy.ndarray
///     uint8 (H, W, 3), RGB.
///
/// Raises
/// ------
/// TypeError
///     `depth` is no array of float32.
/// ValueError
///     Another shape, no element, not C-contiguous; `far` not beyond `near`, also where one of them is the map's own.
#[pyfunction]
#[pyo3(signature = (depth, *, near = None, far = None))]
fn colorize<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = argument::near)] near: Option<f32>,
    #[pyo3(from_py_with = argument::far)] far: Option<f32>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let array = untyped("depth", depth, "a numpy array of float32 (H, W)")?;
    check_type::<f32>(
        "depth",
        array,
        "{name}.astype(np.float32)`, and metres of millimetres: `{name} / 1000`",
    )?;
    let &[height, width] = array.shape() else {
        return Err(PyValueError::new_err(format!(
            "`depth` has shape `{}`; expected (H, W)\nhint: `depth.squeeze()` drops axes of one element",
            shown(array)
        )));
    };
    check_order("depth", array)?;
    let (Ok(columns), Ok(rows), 1..) = (u32::try_from(width), u32::try_from(height), width * height) else {
        return Err(PyValueError::new_err(format!(
            "`depth` has shape `{}`: there is nothing to colour\nhint: at least one row and one column",
            shown(array)
        )));
    };
    check_range(near, far)?;
    let depth = read::<f32, Ix2>("depth", depth)?;
    let metres = depth.as_slice().map_err(|error| PyValueError::new_err(error.to_string()))?;
    let range = py.detach(|| embed::colour_range(metres, near, far));
    check_own_range((near, far), range)?;
    let colours = py.detach(|| embed::colours(metres, (columns, rows), range));
    let colours = Array3::from_shape_vec((height, width, 3), colours);
    let colours = colours.map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok(PyArray3::from_owned_array(py, colours))
}

fn check_range(near: Option<f32>, far: Option<f32>) -> PyResult<()> {
    for (name, value) in [("near", near), ("far", far)] {
        if let Some(value) = value.filter(|value| !value.is_finite()) {
            return Err(PyValueError::new_err(format!(
                "`{name}` is `{value}`; expected a finite number\nhint: leave it away for the map's own"
            )));
        }
    }
    match (near, far) {
        (Some(near), Some(far)) if far <= near => Err(PyValueError::new_err(format!(
            "`far` is `{far}` and `near` is `{near}`; expected `far` beyond `near`\n\
             hint: in the unit of `depth`; leave one away for the map's own"
        ))),
        _ => Ok(()),
    }
}

/// Refuses one end that lies beyond the map's own other end: all of it would have one colour.
fn check_own_range(given: (Option<f32>, Option<f32>), (near, far): (f32, f32)) -> PyResult<()> {
    let (name, value, other, own) = match given {
        (Some(_), None) => ("near", near, "far", far),
        (None, Some(_)) => ("far", far, "near", near),
        _ => return Ok(()),
    };
    if near <= far {
        return Ok(());
    }
    Err(PyValueError::new_err(format!(
        "`{name}` is `{value}`, but the map's own `{other}` is `{own}`; expected `far` beyond `near`\n\
         hint: give both ends, in the unit of `depth`"
    )))
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(colorize, module)?)
}
