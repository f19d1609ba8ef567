//! How a camera's pictures lie in memory.

use numpy::{IxDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods as _};
use nunet_ipc::{Encoding, ImageSize, PixelFormat, UnknownWord};
use pyo3::PyClass;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::sample::element;
use super::view::{Memory, Shape, array};
use crate::picture::{check_order, check_type, read, shown, untyped};

/// How a camera's pictures lie in memory.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    pub(super) encoding: Encoding,
    /// Width and height in pixels.
    pub(super) size: (u32, u32),
    pub(super) row_bytes: u32,
    /// The array's shape.
    pub(super) lengths: Vec<usize>,
}

impl Layout {
    pub(super) fn new(size: (u32, u32), encoding: &str) -> PyResult<Self> {
        let unknown = |error: UnknownWord| {
            PyValueError::new_err(format!("{error}\nhint: for example encoding=\"rgb8\""))
        };
        let format: PixelFormat = encoding.parse().map_err(unknown)?;
        let ImageSize { width, height } = ImageSize::from(size)
            .check()
            .map_err(|error| PyValueError::new_err(format!("{error}\nhint: for example size=(640, 480)")))?;
        let row_bytes = format.min_stride(width);
        let (lines, bytes) = (format.row_count(height) as usize, row_bytes as usize);
        let lengths = match format {
            PixelFormat::Mono8 | PixelFormat::Nv12 => vec![lines, bytes],
            PixelFormat::Yuyv => vec![lines, bytes / 2, 2],
            PixelFormat::Rgb8 | PixelFormat::Bgr8 => vec![lines, bytes / 3, 3],
        };
        Ok(Self { encoding: format.into(), size, row_bytes, lengths })
    }

    pub(super) fn bytes(&self) -> usize {
        self.lengths.iter().product()
    }

    /// The array of a picture in this memory.
    pub(super) fn array<'py, M>(&self, owner: &Bound<'py, M>) -> PyResult<Bound<'py, PyAny>>
    where
        M: Memory + PyClass<Frozen = pyo3::pyclass::boolean_struct::True> + Sync,
    {
        let bytes = element::<u8>(owner.py());
        if let [rows, columns, channels] = self.lengths[..] {
            let strides = [(columns * channels) as isize, channels as isize, 1];
            return array(owner, bytes, Shape { lengths: [rows, columns, channels], strides, offset: 0 });
        }
        let lengths = [self.lengths[0], self.lengths[1]];
        array(owner, bytes, Shape { lengths, strides: [lengths[1] as isize, 1], offset: 0 })
    }

    /// A picture that may be sent as it lies.
    pub(super) fn check<'py>(&self, picture: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArrayDyn<'py, u8>> {
        const NAME: &str = "picture";
        let expected = PyTuple::new(picture.py(), &self.lengths)?;
        let found = untyped(NAME, picture, &format!("a numpy array of uint8 {expected}"))?;
        check_type::<u8>(
            NAME,
            found,
            "{name}.astype(np.uint8)` for 0 to 255, `(255 * {name}).round().astype(np.uint8)` for 0 to 1",
        )?;
        if found.shape() != self.lengths {
            return Err(PyValueError::new_err(format!(
                "`{NAME}` has shape `{}`, but this publisher sends `{}` of shape `{expected}`\n\
                 hint: resize it, or make a publisher of its size",
                shown(found),
                self.encoding
            )));
        }
        check_order(NAME, found)?;
        read::<u8, IxDyn>(NAME, picture)
    }
}
