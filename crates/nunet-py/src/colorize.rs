//! Depth maps in colors.

use numpy::ndarray::Array3;
use numpy::{Ix2, PyArray3, PyUntypedArrayMethods as _};
use nunet_files::{color_range, colorize as colors};
use nunet_types::ImageSize;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::argument;
use crate::array::{check_order, check_type, import_numpy, read, shape_text, untyped};
use crate::error::hinted;

/// Color a depth map like nunetd's `depth.png`: near is red, far is blue, no depth is gray.
///
/// Parameters
/// ----------
/// depth : numpy.ndarray
///     float32 (H, W), C-contiguous, in meters or any other unit. NaN where there is no depth.
/// near, far : float, optional
///     Depth that is shown in red and depth that is shown in blue, in the unit of `depth`. By default the
///     first and the last percentile of the map. Pass both for a video, so that the colors do not flicker.
///
/// Returns
/// -------
/// numpy.ndarray
///     uint8 (H, W, 3), RGB.
///
/// Raises
/// ------
/// TypeError
///     `depth` is not an array of float32.
/// ValueError
///     `depth` has another shape, is empty or is not C-contiguous, or `far` is not beyond `near`.
#[pyfunction]
#[pyo3(signature = (depth, *, near = None, far = None))]
fn colorize<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = argument::near)] near: Option<f32>,
    #[pyo3(from_py_with = argument::far)] far: Option<f32>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    import_numpy(py)?;
    let size = check_depth(depth)?;
    check_range(near, far)?;
    let depth = read::<f32, Ix2>("depth", depth)?;
    let values = depth.as_slice().map_err(|error| PyValueError::new_err(error.to_string()))?;
    let range = py.detach(|| color_range(values, near, far));
    check_own_range((near, far), range)?;
    let colors = py.detach(|| colors(values, size, range).into_raw());
    let colors = Array3::from_shape_vec((size.height as usize, size.width as usize, 3), colors);
    let colors = colors.map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok(PyArray3::from_owned_array(py, colors))
}

/// Width and height of a depth map that can be colored.
fn check_depth(depth: &Bound<'_, PyAny>) -> PyResult<ImageSize> {
    let array = untyped("depth", depth, "a numpy array of float32 (H, W)")?;
    let hint = "convert it, `{name}.astype(np.float32)`, and from millimeters to meters, `{name} / 1000`";
    check_type::<f32>("depth", array, hint)?;
    let &[height, width] = array.shape() else {
        return Err(hinted::<PyValueError>(
            format!("`depth` has shape `{}`; expected (H, W)", shape_text(array)),
            "drop the axes of one element, `depth.squeeze()`",
        ));
    };
    check_order("depth", array)?;
    match (u32::try_from(width), u32::try_from(height)) {
        (Ok(width @ 1..), Ok(height @ 1..)) => Ok(ImageSize { width, height }),
        _ => Err(hinted::<PyValueError>(
            format!("`depth` has shape `{}`, which is empty", shape_text(array)),
            "pass at least one row and one column",
        )),
    }
}

fn check_range(near: Option<f32>, far: Option<f32>) -> PyResult<()> {
    for (name, value) in [("near", near), ("far", far)] {
        if let Some(value) = value.filter(|value| !value.is_finite()) {
            return Err(hinted::<PyValueError>(
                format!("`{name}` is `{value}`; expected a finite number"),
                "omit it to use the range of the depth map",
            ));
        }
    }
    match (near, far) {
        (Some(near), Some(far)) if far <= near => Err(hinted::<PyValueError>(
            format!("`far` is `{far}` and `near` is `{near}`; expected `far` beyond `near`"),
            "pass both in the unit of `depth`, or omit one to use the range of the depth map",
        )),
        _ => Ok(()),
    }
}

/// Refuses one end that lies beyond the map's own other end: the whole map would have one color.
fn check_own_range(given: (Option<f32>, Option<f32>), (near, far): (f32, f32)) -> PyResult<()> {
    let (name, value, other, own) = match given {
        (Some(_), None) => ("near", near, "far", far),
        (None, Some(_)) => ("far", far, "near", near),
        _ => return Ok(()),
    };
    if near <= far {
        return Ok(());
    }
    Err(hinted::<PyValueError>(
        format!("`{name}` is `{value}`, but `{other}` of the map is `{own}`; expected `far` beyond `near`"),
        "pass both ends, in the unit of `depth`",
    ))
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(colorize, module)?)
}
