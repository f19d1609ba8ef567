//! The memory layout of a camera's images.

use numpy::{IxDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods as _};
use nunet_ipc::{Encoding, ImageSize, PixelFormat};
use nunet_types::MAX_SIDE_PX;
use pyo3::PyClass;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::sample::element;
use crate::array::{check_order, check_type, read, shape_text, untyped};
use crate::error::hinted;
use crate::memory::{ArrayLayout, Memory, array};

/// The memory layout of a camera's images.
#[derive(Debug, Clone)]
pub(super) struct ImageLayout {
    pub(super) encoding: Encoding,
    pub(super) size: ImageSize,
    pub(super) row_bytes: u32,
    /// The shape of the array.
    pub(super) lengths: Vec<usize>,
}

impl ImageLayout {
    pub(super) fn new(size: ImageSize, encoding: &str) -> PyResult<Self> {
        let format: PixelFormat = encoding.parse().map_err(|_| {
            let choices: Vec<_> = PixelFormat::ALL.iter().map(|known| format!("`{known}`")).collect();
            hinted::<PyValueError>(
                format!("`encoding` is `{encoding}`; expected an encoding of images"),
                format!("pass one of {}", choices.join(", ")),
            )
        })?;
        let ImageSize { width, height } = size.check().map_err(|_| {
            hinted::<PyValueError>(
                format!("`size` is `{size}`; expected sides of 1 to {MAX_SIDE_PX} pixels"),
                "pass (width, height), `size=(640, 480)`",
            )
        })?;
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

    /// The array of an image in this memory.
    pub(super) fn array<'py, M>(&self, owner: &Bound<'py, M>) -> PyResult<Bound<'py, PyAny>>
    where
        M: Memory + PyClass<Frozen = pyo3::pyclass::boolean_struct::True> + Sync,
    {
        let bytes = element::<u8>(owner.py());
        match self.lengths[..] {
            [rows, columns, channels] => {
                array(owner, bytes, ArrayLayout::packed([rows, columns, channels], 1))
            }
            _ => array(owner, bytes, ArrayLayout::packed([self.lengths[0], self.lengths[1]], 1)),
        }
    }

    /// An image that can be sent as it is.
    pub(super) fn check<'py>(&self, image: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArrayDyn<'py, u8>> {
        const NAME: &str = "image";
        let expected = PyTuple::new(image.py(), &self.lengths)?;
        let found = untyped(NAME, image, &format!("a numpy array of uint8 {expected}"))?;
        check_type::<u8>(
            NAME,
            found,
            "convert it, `{name}.astype(np.uint8)` for values from 0 to 255, or \
             `(255 * {name}).round().astype(np.uint8)` for values from 0 to 1",
        )?;
        if found.shape() != self.lengths {
            return Err(hinted::<PyValueError>(
                format!(
                    "`{NAME}` has shape `{}`; expected `{expected}`, as this publisher sends `{}`",
                    shape_text(found),
                    self.encoding
                ),
                "resize it, or make a publisher of its size",
            ));
        }
        check_order(NAME, found)?;
        read::<u8, IxDyn>(NAME, image)
    }
}
