//! Rotates the images of a camera that is mounted turned, so that they are upright in all later steps.

use std::fmt;
use std::str::FromStr;

use image::metadata::Orientation;
use nunet_core::camera::{Camera, CameraError};
use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::preprocess::Preprocessor;
use nunet_types::ImageSize;
use tracing::warn;

use crate::error::SourceError;
use crate::frame::{Frame, Pixels};
use crate::orientation::oriented_camera;

/// The side of the square that is rotated at a time: its rows and columns fit into the first cache.
const TILE_PX: usize = 32;

/// How far images are rotated clockwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rotation {
    /// 90 degrees: the left edge becomes the top.
    Quarter,
    /// 180 degrees.
    Half,
    /// 270 degrees: the right edge becomes the top.
    ThreeQuarters,
}

impl Rotation {
    const ALL: [Self; 3] = [Self::Quarter, Self::Half, Self::ThreeQuarters];

    /// Clockwise, degrees.
    #[must_use]
    pub fn degrees(self) -> u32 {
        match self {
            Self::Quarter => 90,
            Self::Half => 180,
            Self::ThreeQuarters => 270,
        }
    }

    /// The rotation that undoes this one.
    #[must_use]
    pub fn inverse(self) -> Self {
        match self {
            Self::Quarter => Self::ThreeQuarters,
            Self::Half => Self::Half,
            Self::ThreeQuarters => Self::Quarter,
        }
    }

    /// The size of an image of `size` after the rotation, which is also the size before it.
    #[must_use]
    pub fn size(self, ImageSize { width, height }: ImageSize) -> ImageSize {
        if self == Self::Half { ImageSize::new(width, height) } else { ImageSize::new(height, width) }
    }

    /// The camera of the rotated images of `camera`.
    ///
    /// # Errors
    /// [`CameraError::TiltedSensor`].
    pub fn camera(self, camera: &Camera) -> Result<Camera, CameraError> {
        let orientation = match self {
            Self::Quarter => Orientation::Rotate90,
            Self::Half => Orientation::Rotate180,
            Self::ThreeQuarters => Orientation::Rotate270,
        };
        oriented_camera(camera, orientation)
    }

    /// Writes rows of pixels rotated into `out`, which holds exactly as many. `row` gives the pixels of a
    /// row.
    fn write<'a, T: Copy + 'a>(self, size: ImageSize, row: impl Fn(usize) -> &'a [T], out: &mut [T]) {
        let (width, height) = (size.width as usize, size.height as usize);
        let place = |x: usize, y: usize| match self {
            Self::Quarter => x * height + (height - 1 - y),
            Self::Half => (height - 1 - y) * width + (width - 1 - x),
            Self::ThreeQuarters => (width - 1 - x) * height + y,
        };
        for top in (0..height).step_by(TILE_PX) {
            for left in (0..width).step_by(TILE_PX) {
                for y in top..(top + TILE_PX).min(height) {
                    let right = (left + TILE_PX).min(width);
                    for (x, pixel) in (left..).zip(&row(y)[left..right]) {
                        out[place(x, y)] = *pixel;
                    }
                }
            }
        }
    }

    /// The values of an image of `size` without padding, rotated. There must be one for each pixel.
    #[must_use]
    pub fn values<T: Copy + Default>(self, size: ImageSize, values: &[T]) -> Vec<T> {
        let mut rotated = vec![T::default(); size.pixel_count()];
        let width = size.width as usize;
        self.write(size, |y| &values[y * width..][..width], &mut rotated);
        rotated
    }

    /// As [`Self::write`], of an image whose pixels have `N` bytes.
    fn write_image<const N: usize>(self, image: &ImageView<'_>, out: &mut Vec<u8>) {
        let (stride, row_bytes) = (image.row_stride() as usize, N * image.width() as usize);
        out.resize(N * image.size().pixel_count(), 0);
        let row = |y: usize| image.bytes()[y * stride..][..row_bytes].as_chunks::<N>().0;
        self.write(image.size(), row, out.as_chunks_mut::<N>().0);
    }
}

impl fmt::Display for Rotation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.degrees())
    }
}

impl FromStr for Rotation {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let rotation = Self::ALL.into_iter().find(|rotation| rotation.to_string() == text);
        rotation.ok_or_else(|| format!("expected 90, 180 or 270 (degrees clockwise), got `{text}`"))
    }
}

/// Rotates frames, with their cameras.
pub struct Rotator {
    rotation: Rotation,
    /// Memory for the next image: that of the last one before it was rotated.
    spare: Vec<u8>,
    to_rgb: Option<(ImageSize, Preprocessor)>,
    has_warned: bool,
}

impl Rotator {
    /// A rotator whose memory is reused for every frame.
    #[must_use]
    pub fn new(rotation: Rotation) -> Self {
        Self { rotation, spare: Vec::new(), to_rgb: None, has_warned: false }
    }

    /// Uses this memory for the next image.
    pub(crate) fn reuse(&mut self, memory: Vec<u8>) {
        self.spare = memory;
    }

    /// Rotates the image of a frame and its camera. An image that shares color between pixels becomes RGB. A
    /// file does not stay in the frame, because readers would not rotate it. A camera that cannot be rotated
    /// is reported once and removed.
    ///
    /// # Errors
    /// The frame's size, stride and bytes contradict each other.
    pub fn rotate(&mut self, frame: &mut Frame) -> Result<(), SourceError> {
        let image = frame.view().map_err(|error| {
            SourceError::bad_frame("the image cannot be rotated".to_owned()).with_cause(error)
        })?;
        let mut rotated = std::mem::take(&mut self.spare);
        let format = self.write(&image, &mut rotated);
        frame.size = self.rotation.size(frame.size);
        frame.row_stride = format.min_stride(frame.size.width);
        frame.format = Some(format);
        frame.bytes_copied = rotated.len() as u64;
        if let Pixels::Owned(before) = std::mem::replace(&mut frame.pixels, Pixels::Owned(rotated)) {
            self.spare = before;
        }
        frame.is_turned |= !frame.file.is_empty();
        frame.file.clear();
        frame.camera = frame.camera.and_then(|camera| self.camera(&camera));
        Ok(())
    }

    /// Writes the rotated image, and returns its format.
    fn write(&mut self, image: &ImageView<'_>, out: &mut Vec<u8>) -> PixelFormat {
        match image.format() {
            format @ (PixelFormat::Rgb8 | PixelFormat::Bgr8) => {
                self.rotation.write_image::<3>(image, out);
                format
            }
            PixelFormat::Mono8 => {
                self.rotation.write_image::<1>(image, out);
                PixelFormat::Mono8
            }
            PixelFormat::Yuyv | PixelFormat::Nv12 => {
                let size = image.size();
                let converter = self.to_rgb.take().filter(|(known, _)| *known == size);
                let new = || (size, Preprocessor::new(size.width, size.height));
                let (_, converter) = self.to_rgb.insert(converter.unwrap_or_else(new));
                let width = 3 * size.width as usize;
                let rgb = converter.prepare(image).rgb;
                out.resize(rgb.len(), 0);
                let row = |y: usize| rgb[y * width..][..width].as_chunks::<3>().0;
                self.rotation.write(size, row, out.as_chunks_mut::<3>().0);
                PixelFormat::Rgb8
            }
        }
    }

    fn camera(&mut self, camera: &Camera) -> Option<Camera> {
        self.rotation
            .camera(camera)
            .inspect_err(|error| {
                if !std::mem::replace(&mut self.has_warned, true) {
                    warn!("the camera of the source is not used: {error}");
                }
            })
            .ok()
    }
}

#[cfg(test)]
mod tests;
