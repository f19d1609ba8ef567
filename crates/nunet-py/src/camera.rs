//! The camera as Python sees it.

use std::path::PathBuf;

use numpy::PyArray2;
use nunet_core::camera::{self, Distortion, Intrinsics};
use nunet_daemon::embed;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyType;

use crate::argument;
use crate::error::{failure, of_camera};

/// A camera: focal lengths and principal point in pixels at a stated size, and its lens.
///
/// The optical frame is x right, y down, z forward; pixel centres lie at whole numbers. Immutable.
///
/// Parameters
/// ----------
/// fx, fy : float
///     Focal lengths, pixels.
/// cx, cy : float
///     Column and row of the principal point, pixels; (0, 0) is the centre of the top left pixel.
/// size : tuple of int
///     Width and height of the pictures that these numbers are for, pixels. Pictures of another size and the same shape
///     are fine: the camera is scaled.
/// distortion : sequence of float, optional
///     The lens's coefficients in OpenCV's order: `k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tilt_x tilt_y]]]]`, or
///     `k1 k2 k3 k4` of a fisheye. Without it the pictures are straight (rectified).
/// distortion_model : str, optional
///     ROS's name of the lens model: `plumb_bob`, `rational_polynomial`, or `equidistant` (fisheye). Without it the count
///     of coefficients decides between the first two.
///
/// Raises
/// ------
/// CameraError
///     Numbers that no camera has.
/// TypeError
///     `size` is no pair of whole numbers.
///
/// Examples
/// --------
/// >>> import nunet_py as nunet
/// >>> nunet.Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))
/// Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))
#[pyclass(frozen, from_py_object, module = "nunet_py", name = "Camera")]
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct Camera(pub(crate) camera::Camera);

/// `fx, fy, cx, cy, size, distortion, distortion_model`: what a camera is made of again.
type Parts = (f64, f64, f64, f64, (u32, u32), Vec<f64>, Option<&'static str>);

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (fx, fy, cx, cy, size, distortion = None, *, distortion_model = None))]
    fn new(
        #[pyo3(from_py_with = argument::fx)] fx: f64,
        #[pyo3(from_py_with = argument::fy)] fy: f64,
        #[pyo3(from_py_with = argument::cx)] cx: f64,
        #[pyo3(from_py_with = argument::cy)] cy: f64,
        size: &Bound<'_, PyAny>,
        distortion: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = argument::distortion_model)] distortion_model: Option<&str>,
    ) -> PyResult<Self> {
        let (width, height) = whole_size(size)?;
        let intrinsics = Intrinsics::new(fx, fy, cx, cy, width, height).map_err(of_camera)?;
        let coefficients = distortion.map(coefficients).transpose()?.unwrap_or_default();
        Ok(Self(camera::Camera { intrinsics, distortion: lens(&coefficients, distortion_model)? }))
    }

    /// Read a calibration: the `camera_info` file in YAML that ROS's camera_calibration writes.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     The file, as of `nunetd --calibration`.
    ///
    /// Raises
    /// ------
    /// FileNotFoundError
    ///     There is no such file.
    /// CameraError
    ///     It is no calibration, or one that no camera has.
    #[classmethod]
    fn from_yaml(_class: &Bound<'_, PyType>, path: PathBuf) -> PyResult<Self> {
        embed::read_calibration(&path).map(|found| Self(found.camera())).map_err(|error| failure(&error))
    }

    /// The same camera for pictures resized to `width` x `height` pixels.
    ///
    /// Raises
    /// ------
    /// CameraError
    ///     A size of another shape: such pictures were cropped or stretched, and nobody said where.
    fn at_size(
        &self,
        #[pyo3(from_py_with = argument::width)] width: u32,
        #[pyo3(from_py_with = argument::height)] height: u32,
    ) -> PyResult<Self> {
        self.0.fitted_to(width, height).map(Self).map_err(of_camera)
    }

    /// Horizontal focal length, pixels.
    #[getter]
    fn fx(&self) -> f64 {
        self.0.intrinsics.fx_px
    }

    /// Vertical focal length, pixels.
    #[getter]
    fn fy(&self) -> f64 {
        self.0.intrinsics.fy_px
    }

    /// Column of the principal point, pixels.
    #[getter]
    fn cx(&self) -> f64 {
        self.0.intrinsics.cx_px
    }

    /// Row of the principal point, pixels.
    #[getter]
    fn cy(&self) -> f64 {
        self.0.intrinsics.cy_px
    }

    /// Width and height of the pictures that the numbers are for, pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        (self.0.intrinsics.width, self.0.intrinsics.height)
    }

    /// The lens's coefficients in OpenCV's order; empty for a camera without distortion.
    #[getter]
    fn distortion(&self) -> Vec<f64> {
        match self.0.distortion {
            Distortion::None => Vec::new(),
            lens => lens.to_ros().1,
        }
    }

    /// `plumb_bob`, `rational_polynomial` or `equidistant`; `None` for a camera without distortion.
    #[getter]
    fn distortion_model(&self) -> Option<&'static str> {
        match self.0.distortion {
            Distortion::None => None,
            lens => Some(lens.to_ros().0),
        }
    }

    /// The camera matrix, float64 (3, 3): `[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = [[self.fx(), 0.0, self.cx()], [0.0, self.fy(), self.cy()], [0.0, 0.0, 1.0]];
        Ok(PyArray2::from_vec2(py, &rows.map(Vec::from))?)
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.extract::<Self>().is_ok_and(|other| *self == other)
    }

    fn __hash__(&self) -> u64 {
        // Equal cameras have equal numbers; those of the lens may be left out.
        let Intrinsics { fx_px, fy_px, cx_px, cy_px, width, height, .. } = self.0.intrinsics;
        let bits = [fx_px, fy_px, cx_px, cy_px].map(|number| (number + 0.0).to_bits());
        bits.into_iter()
            .chain([width.into(), height.into()])
            .fold(0, |hash: u64, bits| hash.rotate_left(5) ^ bits)
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.size();
        let lens = match self.distortion_model() {
            Some(model) => format!(", distortion={:?}, distortion_model='{model}'", self.distortion()),
            None => String::new(),
        };
        let (fx, fy, cx, cy) = (self.fx(), self.fy(), self.cx(), self.cy());
        format!("Camera(fx={fx}, fy={fy}, cx={cx}, cy={cy}, size=({width}, {height}){lens})")
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Parts)> {
        let this = slf.get();
        let rebuild = slf.py().import("nunet_py._native")?.getattr("_camera")?;
        let lens = (this.distortion(), this.distortion_model());
        Ok((rebuild, (this.fx(), this.fy(), this.cx(), this.cy(), this.size(), lens.0, lens.1)))
    }
}

/// What a pickled camera is made by: keyword-only arguments do not travel.
#[pyfunction]
fn _camera(
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    size: (u32, u32),
    distortion: Vec<f64>,
    distortion_model: Option<String>,
) -> PyResult<Camera> {
    let intrinsics = Intrinsics::new(fx, fy, cx, cy, size.0, size.1).map_err(of_camera)?;
    Ok(Camera(camera::Camera { intrinsics, distortion: lens(&distortion, distortion_model.as_deref())? }))
}

pub(crate) fn whole_size(size: &Bound<'_, PyAny>) -> PyResult<(u32, u32)> {
    size.extract::<(u32, u32)>().map_err(|_| {
        PyTypeError::new_err(format!(
            "`size` is `{size}`; expected (width, height) in whole pixels\nhint: of an array it is \
             `(rgb.shape[1], rgb.shape[0])`"
        ))
    })
}

/// The numbers of a sequence or an array of any shape: OpenCV's calibration gives (1, 5).
fn coefficients(object: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let flat = if object.hasattr("ravel")? { object.call_method0("ravel")? } else { object.clone() };
    flat.extract().map_err(|_| {
        PyTypeError::new_err(format!(
            "`distortion` is `{object}`; expected a sequence of numbers\nhint: OpenCV's order, `[k1, k2, p1, p2, k3]`"
        ))
    })
}

/// The lens of these coefficients, by ROS's name of its model or by their count.
fn lens(coefficients: &[f64], model: Option<&str>) -> PyResult<Distortion> {
    let model = match (coefficients.len(), model) {
        (0, None) => return Ok(Distortion::None),
        (0, Some(model)) => {
            return Err(PyValueError::new_err(format!(
                "`distortion_model` is `{model}` without `distortion`\nhint: give its coefficients, or neither"
            )));
        }
        (_, Some(model)) => model,
        (0..=5, None) => "plumb_bob",
        (_, None) => "rational_polynomial",
    };
    Distortion::from_ros(model, coefficients).map_err(|error| failure(&error.into()))
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Camera>()?;
    module.add_function(wrap_pyfunction!(_camera, module)?)
}
