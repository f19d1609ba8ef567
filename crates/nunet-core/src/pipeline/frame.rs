//! The output buffers and the report of a frame.

use nunet_types::{ImageSize, PixelRect};

use crate::camera::Camera;
use crate::cloud::CloudPoint;
use crate::depth::{DepthImage, Scale, ScaleSource, Units};
use crate::filter::Decimation;
use crate::graph::{GraphError, GraphOutputs, Quality, SerialGraph, StageTimes};
use crate::stability::StabilityChange;

/// Buffers of the caller for the results of a frame.
#[derive(Debug)]
pub struct Outputs<'a> {
    /// `[H, W]` at [`super::Pipeline::size`]: meters (or no unit, see [`FrameReport::units`]), NaN where
    /// nothing was measured.
    pub depth_m: &'a mut [f32],
    /// `[H, W]`: class indices; `None` if they are not needed.
    pub labels: Option<&'a mut [u8]>,
    /// `[H, W]`: confidence of depth, 255 = certain, 0 where depth is invalid or was filled in by a filter.
    /// Without memory of the caller it stays inside ([`super::Pipeline::confidence`]).
    pub confidence: Option<&'a mut [u8]>,
    /// [`super::Pipeline::cloud_size`] points; `None` if they are not needed.
    pub cloud: Option<&'a mut [CloudPoint]>,
}

impl Outputs<'_> {
    /// The same memory, borrowed for a shorter time.
    #[must_use]
    pub fn reborrow(&mut self) -> Outputs<'_> {
        Outputs {
            depth_m: &mut *self.depth_m,
            labels: self.labels.as_deref_mut(),
            confidence: self.confidence.as_deref_mut(),
            cloud: self.cloud.as_deref_mut(),
        }
    }

    /// Depth with the labels and the confidence that belong to it, after a pipeline filled these buffers.
    /// `kept` is the confidence that stayed inside ([`super::Pipeline::confidence`]), for buffers without
    /// memory for it.
    #[must_use]
    pub fn depth_image<'a>(&'a self, kept: Option<&'a [u8]>) -> DepthImage<'a> {
        let confidence = self.confidence.as_deref().or(kept);
        DepthImage { depth_m: self.depth_m, labels: self.labels.as_deref(), confidence }
    }

    /// Refuses memory for results that `graph` does not have, and memory of another length than results of
    /// `size` and `cloud_size` have. Called first: a network with a state must not take a frame that fails
    /// afterwards.
    pub(super) fn check(
        &self,
        graph: &SerialGraph,
        size: ImageSize,
        cloud_size: ImageSize,
    ) -> Result<(), GraphError> {
        if self.labels.is_some() && !graph.has_labels() {
            return Err(GraphError::NoLabels);
        }
        if self.confidence.is_some() && !graph.has_confidence() {
            return Err(GraphError::NoConfidence);
        }
        let given = [
            ("depth", Some(self.depth_m.len()), size),
            ("labels", self.labels.as_ref().map(|labels| labels.len()), size),
            ("confidence", self.confidence.as_ref().map(|confidence| confidence.len()), size),
            ("cloud", self.cloud.as_ref().map(|cloud| cloud.len()), cloud_size),
        ];
        for (tensor, got, size) in given {
            let expected = size.pixel_count();
            if let Some(got) = got.filter(|got| *got != expected) {
                return Err(GraphError::Buffer { tensor, got, expected });
            }
        }
        Ok(())
    }

    /// The memory into which the network writes. With decimation it is inside.
    pub(super) fn of_network<'a>(&'a mut self, decimation: Option<&'a mut Decimation>) -> GraphOutputs<'a> {
        match decimation {
            None => GraphOutputs {
                depth: &mut *self.depth_m,
                labels: self.labels.as_deref_mut(),
                confidence: self.confidence.as_deref_mut(),
            },
            Some(decimation) => {
                GraphOutputs { depth: decimation.network_depth(), labels: None, confidence: None }
            }
        }
    }
}

/// The report of a processed frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameReport {
    /// The time of each stage, in the order of [`super::Pipeline::stage_names`]; 0 for one that did not run.
    pub stages: StageTimes,
    /// Whether a stage was skipped.
    pub quality: Quality,
    /// The unit of the depth map.
    pub units: Units,
    /// The source of its scale.
    pub scale_source: ScaleSource,
    /// Factor by which the network's meters were multiplied; 0 for depth without a unit.
    pub scale_factor: f32,
    /// Nanoseconds since the factor was measured; 0 for one that does not change.
    pub scale_age_nanos: i64,
    /// Bytes copied or resized: the network's input, labels of a stage that does not run for each frame,
    /// depth of another size than the network's image, and results taken out of padding. 0 if the camera's
    /// images have the network's size and format and every stage runs for each frame.
    pub bytes_copied: u64,
    /// Pixels of the depth map that are NaN, after the filters.
    pub invalid_pixels: u32,
    /// How depth changed since the last frame, if the image did not; see [`crate::stability`].
    pub stability: Option<StabilityChange>,
    /// The camera at [`super::Pipeline::size`], with its lens distortion: depth maps are not rectified.
    /// `None` if the camera is not known.
    pub camera: Option<Camera>,
    /// The part of the image that the results cover, pixels of the image.
    pub view: PixelRect,
}

impl FrameReport {
    /// The unit of the depth map and its scale; the factor is 0 for depth without a unit.
    #[must_use]
    pub fn scale(&self) -> Scale {
        let Self { units, scale_source: source, scale_factor: factor, scale_age_nanos: age_nanos, .. } =
            *self;
        Scale { units, source, factor, age_nanos }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_depth_image_has_the_labels_and_the_confidence_of_the_same_frame() {
        let (mut depth_m, mut labels, mut own) = ([1.0, 2.0], [3, 4], [5, 6]);
        let kept = [7, 8];
        for has_own in [false, true] {
            let confidence = has_own.then_some(&mut own[..]);
            let labels = Some(&mut labels[..]);
            let mut outputs = Outputs { depth_m: &mut depth_m, labels, confidence, cloud: None };
            let filled = outputs.reborrow();
            filled.depth_m[0] = 9.0;
            if let Some(labels) = filled.labels {
                labels[0] = 9;
            }
            let image = outputs.depth_image(Some(&kept));
            assert_eq!((image.depth_m, image.labels), (&[9.0, 2.0][..], Some(&[9, 4][..])));
            assert_eq!(image.confidence, Some(if has_own { &[5, 6][..] } else { &kept[..] }));
        }
        let outputs = Outputs { depth_m: &mut depth_m, labels: None, confidence: None, cloud: None };
        let image = outputs.depth_image(None);
        assert_eq!((image.labels, image.confidence), (None, None));
    }
}
