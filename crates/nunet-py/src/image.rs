//! Images for the network: arrays, files and PIL images, and the errors for other arguments.

use std::fmt::Display;
use std::path::PathBuf;

use numpy::{Ix3, PyReadonlyArray3, PyUntypedArray, PyUntypedArrayMethods as _};
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_source::{ReadImage, read_image};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyBytes, PyMemoryView, PyString};

use crate::array::{check_type, holds, read, shape_text, type_name};
use crate::error::{failure, hinted};

/// The accepted types of images, for messages.
const EXPECTED: &str = "a numpy array of uint8 (H, W, 3), a path or a PIL image";

/// The order of the channels of an array.
#[derive(Debug, Clone, Copy)]
pub(crate) enum ColorOrder {
    Rgb,
    Bgr,
}

impl ColorOrder {
    /// The order by its name.
    ///
    /// # Errors
    /// `ValueError` for any other text.
    pub(crate) fn named(name: &str) -> PyResult<Self> {
        match name {
            "rgb" => Ok(Self::Rgb),
            "bgr" => Ok(Self::Bgr),
            _ => Err(hinted::<PyValueError>(
                format!("`color` is `{name}`; expected `rgb` or `bgr`"),
                "pass `color=\"bgr\"` for images of OpenCV",
            )),
        }
    }

    fn format(self) -> PixelFormat {
        match self {
            Self::Rgb => PixelFormat::Rgb8,
            Self::Bgr => PixelFormat::Bgr8,
        }
    }
}

/// An image of 8-bit RGB or BGR, rows from the top.
pub(crate) enum ImageArgument<'py> {
    /// An array of the caller, or a contiguous copy of it.
    Array { pixels: PyReadonlyArray3<'py, u8>, order: ColorOrder },
    /// A decoded file.
    File(ReadImage),
}

impl<'py> ImageArgument<'py> {
    /// Takes the argument called `name`. `order` is the channel order of an array; files and PIL images are
    /// always RGB.
    ///
    /// # Errors
    /// `TypeError` for anything that is not an image of 8 bits per channel, `ValueError` for another shape or
    /// size, `FileNotFoundError` and `NunetError` for a file that cannot be read.
    pub(crate) fn take(name: &str, object: &Bound<'py, PyAny>, order: ColorOrder) -> PyResult<Self> {
        let image = if let Some(path) = path(object)? {
            Self::open(object.py(), path)?
        } else if is_pil(object)? {
            Self::array(name, &from_pil(name, object)?, ColorOrder::Rgb)?
        } else {
            Self::array(name, object, order)?
        };
        image.view()?;
        Ok(image)
    }

    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let read = py.detach(move || read_image(&path));
        read.map(Self::File).map_err(|error| failure(&error.into()))
    }

    fn array(name: &str, object: &Bound<'py, PyAny>, order: ColorOrder) -> PyResult<Self> {
        let array = object.cast::<PyUntypedArray>().map_err(|_| not_an_image(name, object))?;
        check_channels_type(name, array)?;
        check_shape(name, array)?;
        if array.is_c_contiguous() {
            return Ok(Self::Array { pixels: read::<u8, Ix3>(name, object)?, order });
        }
        let copy = object.py().import("numpy")?.call_method1("ascontiguousarray", (object,))?;
        Ok(Self::Array { pixels: read::<u8, Ix3>(name, &copy)?, order })
    }

    /// The image as the pipeline reads it.
    ///
    /// # Errors
    /// `ValueError` for a side that is 0 or longer than the limit.
    pub(crate) fn view(&self) -> PyResult<ImageView<'_>> {
        let view = match self {
            Self::File(ReadImage { rgb, size, .. }) => {
                ImageView::packed(rgb, size.width, size.height, PixelFormat::Rgb8)
            }
            Self::Array { pixels, order } => {
                let side = |axis: usize| u32::try_from(pixels.shape()[axis]).unwrap_or(u32::MAX);
                ImageView::packed(pixels.as_slice()?, side(1), side(0), order.format())
            }
        };
        let hint = "pass an image with at least one row and one column, and resize one beyond the limit";
        view.map_err(|error| hinted::<PyValueError>(error, hint))
    }
}

/// The path of a file, if the object is one.
fn path(object: &Bound<'_, PyAny>) -> PyResult<Option<PathBuf>> {
    // `bytes` are more likely an encoded image than a path.
    let is_path =
        object.is_instance_of::<PyString>() || object.hasattr(intern!(object.py(), "__fspath__"))?;
    is_path.then(|| object.extract()).transpose()
}

/// Whether the object is a PIL image. PIL is not imported for it: a caller with an image has imported PIL.
fn is_pil(object: &Bound<'_, PyAny>) -> PyResult<bool> {
    let modules = object.py().import("sys")?.getattr("modules")?;
    let module = modules.call_method1("get", ("PIL.Image",))?;
    if module.is_none() {
        return Ok(false);
    }
    object.is_instance(&module.getattr("Image")?)
}

/// The RGB array of a PIL image.
fn from_pil<'py>(name: &str, image: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let mode: String = image.getattr("mode")?.extract()?;
    // Integers and floats: PIL would clip their values to 255.
    if mode.starts_with(['I', 'F']) {
        return Err(hinted::<PyTypeError>(
            format!("`{name}` is a PIL image of mode `{mode}`; expected 8 bits per channel"),
            "scale its values to 0 to 255 and convert it to mode `RGB`",
        ));
    }
    let rgb = if mode == "RGB" { image.clone() } else { image.call_method1("convert", ("RGB",))? };
    image.py().import("numpy")?.call_method1("asarray", (rgb,))
}

/// The error for an object of a type that is not an image.
fn not_an_image(name: &str, object: &Bound<'_, PyAny>) -> PyErr {
    let encoded = object.is_instance_of::<PyBytes>()
        || object.is_instance_of::<PyByteArray>()
        || object.is_instance_of::<PyMemoryView>();
    let refused = |found: &dyn Display, hint: String| {
        hinted::<PyTypeError>(format!("`{name}` is {found}; expected {EXPECTED}"), hint)
    };
    let found = format!("of type `{}`", type_name(object));
    if object.is_none() {
        refused(&"`None`", "pass the path: `cv2.imread` returns `None` for a file that it cannot read".into())
    } else if encoded {
        refused(&found, format!("decode it first, `PIL.Image.open(io.BytesIO({name}))`"))
    } else {
        refused(&found, format!("convert it, `np.asarray({name})`"))
    }
}

fn check_channels_type(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyResult<()> {
    let hint = if holds::<u16>(array) {
        "convert it, `({name} >> 8).astype(np.uint8)` for values up to 65535, or `{name}.astype(np.uint8)` for \
         values up to 255"
    } else {
        "convert it, `(255 * {name}).round().astype(np.uint8)` for values from 0 to 1, or \
         `{name}.astype(np.uint8)` for values from 0 to 255"
    };
    check_type::<u8>(name, array, hint)
}

fn check_shape(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyResult<()> {
    let hint = match array.shape() {
        [_, _, 3] => return Ok(()),
        [_, _] => format!("repeat the gray channel, `np.repeat({name}[..., None], 3, axis=2)`"),
        [_, _, 1] => format!("repeat the gray channel, `np.repeat({name}, 3, axis=2)`"),
        [_, _, 4] => format!("drop the fourth channel, `{name}[..., :3]`"),
        [3, _, _] => format!("move the channels to the end, `{name}.transpose(1, 2, 0)`"),
        [_, _, _, 3] => format!("pass one image, `{name}[0]`, or all of them to `infer_batch`"),
        _ => "pass rows from the top, then columns, then red, green and blue".to_owned(),
    };
    let found = format!("`{name}` has shape `{}`; expected (H, W, 3)", shape_text(array));
    Err(hinted::<PyValueError>(found, hint))
}
