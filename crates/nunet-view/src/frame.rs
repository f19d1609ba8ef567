//! One frame's results in memory of their own.

use std::sync::{Arc, Mutex, PoisonError};

use bytes::Bytes;
use nunet_types::{ImageSize, ObstacleMap, PixelFormat, ScaleSource, Units};

use crate::obstacles::pack_obstacles;

/// A frame for viewers. Its buffers are reused, so that a steady stream allocates nothing.
#[derive(Debug, Default)]
pub struct ViewFrame {
    /// Counts the source's frames from 0.
    pub sequence: u64,
    /// Time of capture, nanoseconds since 1970.
    pub capture_unix_nanos: i64,
    /// From capture to publishing, microseconds.
    pub total_micros: u32,
    /// The directions that the pixels of the depth map see; `None` without a camera calibration.
    pub rays: Option<Arc<RayGrid>>,
    image: Option<ImageInfo>,
    image_bytes: Vec<u8>,
    depth: Option<DepthInfo>,
    depth_values: Vec<f32>,
    labels: Vec<u8>,
    confidence: Vec<u8>,
    /// The section `obstacles`; empty without obstacles.
    obstacles: Vec<u8>,
    encoded: Mutex<Vec<(Encoded, Bytes)>>,
}

/// The layout of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ImageInfo {
    pub(crate) size: ImageSize,
    pub(crate) row_stride: u32,
    pub(crate) format: PixelFormat,
}

/// What the numbers of a depth map mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthInfo {
    /// Width and height of the depth map, the labels and the confidence.
    pub size: ImageSize,
    /// The unit of depth.
    pub units: Units,
    /// Where the scale of depth comes from.
    pub scale_source: ScaleSource,
    /// The part of the image that depth covers: left, top, width, height, as shares of the image.
    pub view: [f32; 4],
}

/// Depth covers the whole image ([`DepthInfo::view`]).
pub const WHOLE_IMAGE: [f32; 4] = [0.0, 0.0, 1.0, 1.0];

/// The directions that a camera's pixels see, on a coarse grid: viewers interpolate between its nodes.
///
/// The grid is the depth map scaled down to `columns` x `rows` pixels: node `(i, j)` is the ray at the depth
/// map's `((i + 0.5) * width / columns - 0.5, (j + 0.5) * height / rows - 0.5)`. For a pinhole camera,
/// interpolation is exact.
#[derive(Debug, Clone, PartialEq)]
pub struct RayGrid {
    /// Nodes per row.
    pub columns: u32,
    /// Rows of nodes.
    pub rows: u32,
    /// `[rows][columns]` points `[x / z, y / z]` in the camera's optical frame (x right, y down, z forward);
    /// NaN where the lens model defines no ray.
    pub rays: Vec<[f32; 2]>,
}

/// What a frame may be encoded as; each is made once, however many clients receive it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoded {
    /// The image as JPEG, every n-th pixel.
    Jpeg(u32),
    /// The depth map, every n-th pixel.
    Depth(u32),
    /// The labels, every n-th pixel.
    Labels(u32),
    /// The confidence, every n-th pixel.
    Confidence(u32),
    /// The depth map as PNG.
    DepthPng,
}

impl ViewFrame {
    /// Copies the image: rows from the top, `row_stride` bytes apart. An image with fewer bytes than its size
    /// needs, or with a side of 0 or of more than [`nunet_types::MAX_SIDE_PX`], counts as no image.
    pub fn set_image(&mut self, bytes: &[u8], size: ImageSize, row_stride: u32, format: PixelFormat) {
        let needed = format.byte_len(size.width, size.height, row_stride);
        let is_image = size.check().is_ok() && row_stride >= format.min_stride(size.width);
        self.image = bytes.get(..needed).filter(|_| is_image).map(|bytes| {
            self.image_bytes.clear();
            self.image_bytes.extend_from_slice(bytes);
            ImageInfo { size, row_stride, format }
        });
    }

    /// Copies the depth map, `[height, width]`, NaN = no measurement. One with another number of values than
    /// its size has pixels counts as no depth.
    pub fn set_depth(&mut self, depth: &[f32], info: DepthInfo) {
        let is_map = info.size.check().is_ok() && depth.len() == info.size.pixel_count();
        self.depth = is_map.then(|| {
            self.depth_values.clear();
            self.depth_values.extend_from_slice(depth);
            info
        });
    }

    /// Copies the labels, `[height, width]` class indices at the size of depth; set depth first. Labels of
    /// another number count as none.
    pub fn set_labels(&mut self, labels: &[u8]) {
        copy_map(labels, self.depth, &mut self.labels);
    }

    /// Copies the confidence, `[height, width]` at the size of depth, 255 = certain; set depth first. Values
    /// of another number count as none.
    pub fn set_confidence(&mut self, confidence: &[u8]) {
        copy_map(confidence, self.depth, &mut self.confidence);
    }

    /// Copies the obstacles; of many points, every n-th.
    pub fn set_obstacles(&mut self, map: &ObstacleMap<'_>) {
        self.obstacles.clear();
        pack_obstacles(map, &mut self.obstacles);
    }

    /// The image and its layout.
    pub(crate) fn image(&self) -> Option<(ImageInfo, &[u8])> {
        self.image.map(|image| (image, self.image_bytes.as_slice()))
    }

    /// The depth map and its meaning.
    pub(crate) fn depth(&self) -> Option<(DepthInfo, &[f32])> {
        self.depth.map(|depth| (depth, self.depth_values.as_slice()))
    }

    /// The labels at the size of depth, if there are some.
    pub(crate) fn labels(&self) -> Option<&[u8]> {
        (!self.labels.is_empty()).then_some(self.labels.as_slice())
    }

    /// The confidence at the size of depth, if there is one.
    pub(crate) fn confidence(&self) -> Option<&[u8]> {
        (!self.confidence.is_empty()).then_some(self.confidence.as_slice())
    }

    /// The section `obstacles`, if there are obstacles.
    pub(crate) fn obstacles(&self) -> Option<&[u8]> {
        (!self.obstacles.is_empty()).then_some(self.obstacles.as_slice())
    }

    /// Clears all content and keeps the memory.
    pub(crate) fn clear(&mut self) {
        (self.image, self.depth, self.rays) = (None, None, None);
        self.labels.clear();
        self.confidence.clear();
        self.obstacles.clear();
        self.encoded.get_mut().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// The result of `encode`, which is called for the first client only.
    pub(crate) fn encoded(&self, as_what: Encoded, encode: impl FnOnce() -> Vec<u8>) -> Bytes {
        let mut encoded = self.encoded.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, bytes)) = encoded.iter().find(|(key, _)| *key == as_what) {
            return bytes.clone();
        }
        let bytes = Bytes::from(encode());
        encoded.push((as_what, bytes.clone()));
        bytes
    }
}

/// Copies one byte per pixel, if there are as many as depth has pixels.
fn copy_map(bytes: &[u8], depth: Option<DepthInfo>, map: &mut Vec<u8>) {
    map.clear();
    if depth.is_some_and(|depth| bytes.len() == depth.size.pixel_count()) {
        map.extend_from_slice(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_with_too_few_bytes_counts_as_none() {
        let mut frame = ViewFrame::default();
        let size = ImageSize::new(4, 2);
        frame.set_image(&[0; 24], size, 12, PixelFormat::Rgb8);
        assert!(frame.image().is_some());
        for (bytes, size, stride) in [
            (23, size, 12),
            (24, size, 11),
            (24, ImageSize::new(0, 2), 12),
            (24, ImageSize::new(4, 40_000), 12),
        ] {
            frame.set_image(&vec![0; bytes], size, stride, PixelFormat::Rgb8);
            assert!(frame.image().is_none(), "{bytes} bytes, {size}, {stride}");
        }
    }

    #[test]
    fn maps_of_another_size_count_as_none() {
        let mut frame = ViewFrame::default();
        let info = DepthInfo {
            size: ImageSize::new(2, 1),
            units: Units::Metre,
            scale_source: ScaleSource::Metric,
            view: [0.0, 0.0, 1.0, 1.0],
        };
        frame.set_depth(&[1.0, 2.0], info);
        frame.set_labels(&[1, 2]);
        frame.set_confidence(&[255, 0]);
        assert_eq!((frame.depth(), frame.labels()), (Some((info, &[1.0, 2.0][..])), Some(&[1, 2][..])));
        assert_eq!(frame.confidence(), Some(&[255, 0][..]));
        frame.set_labels(&[1]);
        frame.set_confidence(&[1, 2, 3]);
        assert_eq!((frame.labels(), frame.confidence()), (None, None));
        frame.set_depth(&[1.0], info);
        assert_eq!(frame.depth(), None);
    }

    #[test]
    fn a_frame_is_encoded_once_and_again_after_it_is_refilled() {
        let mut frame = ViewFrame::default();
        assert_eq!(frame.encoded(Encoded::Jpeg(1), || vec![1]), &[1][..]);
        assert_eq!(frame.encoded(Encoded::Jpeg(1), || panic!("it is encoded already")), &[1][..]);
        assert_eq!(frame.encoded(Encoded::Jpeg(2), || vec![2]), &[2][..]);
        frame.clear();
        assert_eq!(frame.encoded(Encoded::Jpeg(1), || vec![3]), &[3][..]);
    }
}
