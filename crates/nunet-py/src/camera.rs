//! The Python class `Camera`.

use std::path::PathBuf;

use numpy::PyArray2;
use nunet_core::camera::{self, CalibratedScale, Distortion, Intrinsics, check_scale_factor};
use nunet_core::framing::AspectMode;
use nunet_source::read_calibration;
use nunet_types::{ImageSize, shortest};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyType;

use crate::argument::{self, shown, taken};
use crate::array::import_numpy;
use crate::error::{PyCameraError, failure, hinted, of_camera};

/// The hint for a missing or wrong camera.
const EXAMPLE: &str = "pass `nunet_py.Camera(fx=..., fy=..., cx=..., cy=..., size=(width, height))`";

/// A camera: focal lengths and principal point in pixels, the image size that they are for, and the lens
/// distortion.
///
/// The optical frame is x right, y down, z forward. Pixel centers have whole coordinates. Cameras are
/// immutable.
///
/// Parameters
/// ----------
/// fx, fy : float
///     Focal lengths, pixels.
/// cx, cy : float
///     Column and row of the principal point, pixels. (0, 0) is the center of the top left pixel.
/// size : tuple of int
///     Width and height of the images that these numbers are for, pixels. For images of another size and the
///     same aspect ratio the camera is scaled.
/// distortion : sequence of float, optional
///     Distortion coefficients in OpenCV's order:
///     `k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tilt_x tilt_y]]]]`, or `k1 k2 k3 k4` of a fisheye lens. Omit
///     it for rectified images.
/// distortion_model : str, optional
///     The ROS name of the distortion model: `plumb_bob`, `rational_polynomial`, or `equidistant` (fisheye).
///     By default the number of coefficients selects one of the first two.
/// scale : float, optional
///     The factor by which the network's meters are multiplied, as `nunetd calibrate` measures it. It
///     replaces the ratio of the focal lengths.
///
/// Raises
/// ------
/// CameraError
///     Invalid intrinsics or coefficients, or an unknown distortion model.
/// TypeError
///     An argument of another type, such as a list for `size`.
///
/// Examples
/// --------
/// >>> import nunet_py as nunet
/// >>> nunet.Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))
/// Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))
#[pyclass(frozen, from_py_object, module = "nunet_py", name = "Camera")]
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct PyCamera(pub(crate) camera::Camera, pub(crate) Option<CalibratedScale>);

/// The arguments that restore a pickled camera: `fx, fy, cx, cy, size, distortion, distortion_model, scale`.
type PickledCamera = (f64, f64, f64, f64, (u32, u32), Vec<f64>, Option<&'static str>, Option<ScaleArguments>);

/// A factor, the SHA-256 of the model that it is for, and the name of the aspect mode of its measurement.
type ScaleArguments = (f32, Option<[u8; 32]>, Option<String>);

#[pymethods]
impl PyCamera {
    #[new]
    #[pyo3(signature = (fx, fy, cx, cy, size, distortion = None, *, distortion_model = None, scale = None))]
    #[expect(clippy::too_many_arguments, reason = "the arguments of the Python class")]
    fn new(
        #[pyo3(from_py_with = argument::fx)] fx: f64,
        #[pyo3(from_py_with = argument::fy)] fy: f64,
        #[pyo3(from_py_with = argument::cx)] cx: f64,
        #[pyo3(from_py_with = argument::cy)] cy: f64,
        size: &Bound<'_, PyAny>,
        distortion: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = argument::distortion_model)] distortion_model: Option<&str>,
        #[pyo3(from_py_with = argument::scale)] scale: Option<f64>,
    ) -> PyResult<Self> {
        let ImageSize { width, height } = whole_size(size)?;
        let intrinsics = Intrinsics::new(fx, fy, cx, cy, width, height).map_err(of_camera)?;
        let coefficients = distortion.map(coefficients).transpose()?.unwrap_or_default();
        let factor = scale.map(check_scale_factor).transpose().map_err(of_camera)?;
        let scale = factor.map(|factor| CalibratedScale { factor, model_hash: None, aspect: None });
        Ok(Self(camera::Camera { intrinsics, distortion: lens(&coefficients, distortion_model)? }, scale))
    }

    /// Read a calibration file: the `camera_info` YAML that the ROS package camera_calibration writes, with
    /// the scale that `nunetd calibrate` adds.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     The file, as for `nunetd --calibration`.
    ///
    /// Raises
    /// ------
    /// FileNotFoundError
    ///     The file does not exist.
    /// CameraError
    ///     The file is not a calibration, or its numbers are invalid.
    #[classmethod]
    fn from_yaml(
        _class: &Bound<'_, PyType>,
        #[pyo3(from_py_with = argument::path)] path: PathBuf,
    ) -> PyResult<Self> {
        let found = read_calibration(&path).map_err(|error| failure(&error.into()))?;
        Ok(Self(found.camera(), found.scale()))
    }

    /// The same camera for images that were resized to `width` x `height` pixels.
    ///
    /// Raises
    /// ------
    /// CameraError
    ///     The size has another aspect ratio, so the images were cropped or stretched.
    fn at_size(
        &self,
        #[pyo3(from_py_with = argument::width)] width: u32,
        #[pyo3(from_py_with = argument::height)] height: u32,
    ) -> PyResult<Self> {
        self.0.fitted_to(width, height).map(|camera| Self(camera, self.1)).map_err(of_camera)
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

    /// Width and height of the images that the numbers are for, pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        (self.0.intrinsics.width, self.0.intrinsics.height)
    }

    /// Distortion coefficients in OpenCV's order; empty for a camera without distortion.
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

    /// The factor by which the network's meters are multiplied; `None` if it was not measured.
    #[getter]
    fn scale(&self) -> Option<f64> {
        self.1.map(|scale| shortest(scale.factor))
    }

    /// The camera matrix, float64 (3, 3): `[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        import_numpy(py)?;
        let rows = [[self.fx(), 0.0, self.cx()], [0.0, self.fy(), self.cy()], [0.0, 0.0, 1.0]];
        Ok(PyArray2::from_vec2(py, &rows.map(Vec::from))?)
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.extract::<Self>().is_ok_and(|other| *self == other)
    }

    fn __hash__(&self) -> u64 {
        // Equal cameras have equal intrinsics, so the hash may ignore the distortion.
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
        let scale = self.scale().map(|scale| format!(", scale={scale}")).unwrap_or_default();
        format!("Camera(fx={fx}, fy={fy}, cx={cx}, cy={cy}, size=({width}, {height}){lens}{scale})")
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, PickledCamera)> {
        let this = slf.get();
        let rebuild = slf.py().import("nunet_py._native")?.getattr("_camera")?;
        let lens = (this.distortion(), this.distortion_model());
        let scale = this.1.map(|CalibratedScale { factor, model_hash, aspect }| {
            (factor, model_hash, aspect.map(|mode| mode.name().to_owned()))
        });
        let parts = (this.fx(), this.fy(), this.cx(), this.cy(), this.size(), lens.0, lens.1, scale);
        Ok((rebuild, parts))
    }
}

/// Restores a pickled camera: pickle passes no keyword-only arguments.
#[pyfunction]
#[pyo3(signature = (fx, fy, cx, cy, size, distortion, distortion_model, scale = None))]
#[expect(clippy::too_many_arguments, reason = "the arguments of the Python class")]
fn _camera(
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    size: (u32, u32),
    distortion: Vec<f64>,
    distortion_model: Option<String>,
    scale: Option<ScaleArguments>,
) -> PyResult<PyCamera> {
    let intrinsics = Intrinsics::new(fx, fy, cx, cy, size.0, size.1).map_err(of_camera)?;
    let scale = scale.map(|(factor, model_hash, aspect)| {
        let aspect = aspect.and_then(|name| AspectMode::named(&name));
        CalibratedScale { factor, model_hash, aspect }
    });
    Ok(PyCamera(
        camera::Camera { intrinsics, distortion: lens(&distortion, distortion_model.as_deref())? },
        scale,
    ))
}

/// The optional argument `camera`.
pub(crate) fn camera_argument(object: &Bound<'_, PyAny>) -> PyResult<Option<PyCamera>> {
    taken("camera", object, "a Camera", EXAMPLE)
}

/// The optional argument `intrinsics`.
pub(crate) fn intrinsics_argument(object: &Bound<'_, PyAny>) -> PyResult<Option<PyCamera>> {
    taken("intrinsics", object, "a Camera", EXAMPLE)
}

/// The argument `size`: width and height, pixels.
pub(crate) fn whole_size(size: &Bound<'_, PyAny>) -> PyResult<ImageSize> {
    size.extract::<(u32, u32)>().map(ImageSize::from).map_err(|_| {
        let hint = match size.extract::<[u32; 2]>() {
            Ok([width, height]) => format!("pass a tuple, `size=({width}, {height})`"),
            Err(_) => "for an array, pass `size=(rgb.shape[1], rgb.shape[0])`".to_owned(),
        };
        let found = shown(size);
        hinted::<PyTypeError>(
            format!("`size` is `{found}`; expected a tuple (width, height) of whole pixels"),
            hint,
        )
    })
}

/// The numbers of a sequence or of an array of any shape: OpenCV's calibration returns (1, 5).
fn coefficients(object: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let flat = if object.hasattr("ravel")? { object.call_method0("ravel")? } else { object.clone() };
    flat.extract().map_err(|_| {
        hinted::<PyTypeError>(
            format!("`distortion` is `{}`; expected a sequence of numbers", shown(object)),
            "pass the coefficients in OpenCV's order, `[k1, k2, p1, p2, k3]`",
        )
    })
}

/// The distortion with these coefficients, by the ROS name of its model or by the number of coefficients.
fn lens(coefficients: &[f64], model: Option<&str>) -> PyResult<Distortion> {
    let model = match (coefficients.len(), model) {
        (_, Some("fisheye")) => return Err(fisheye()),
        (0, None) => return Ok(Distortion::None),
        (0, Some(model)) => {
            return Err(hinted::<PyValueError>(
                format!("`distortion_model` is `{model}`, but `distortion` is missing"),
                "pass the coefficients too, or neither",
            ));
        }
        (_, Some(model)) => model,
        (0..=5, None) => "plumb_bob",
        (_, None) => "rational_polynomial",
    };
    Distortion::from_ros(model, coefficients).map_err(|error| failure(&error.into()))
}

/// The name that OpenCV uses for the model that ROS calls equidistant.
fn fisheye() -> PyErr {
    hinted::<PyCameraError>(
        "`distortion_model` is `fisheye`; expected `plumb_bob`, `rational_polynomial` or `equidistant`",
        "pass `distortion_model=\"equidistant\"`, the ROS name of OpenCV's fisheye model",
    )
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyCamera>()?;
    module.add_function(wrap_pyfunction!(_camera, module)?)
}
