//! Buffers for results outside of shared memory, for subcommands without readers.

use nunet_core::cloud::CloudPoint;
use nunet_core::depth::DepthImage;
use nunet_core::pipeline::{Outputs, Pipeline};

/// Buffers for the results of one frame.
#[derive(Debug)]
pub struct Buffers {
    depth: Vec<f32>,
    labels: Option<Vec<u8>>,
    cloud: Vec<CloudPoint>,
}

impl Buffers {
    /// Buffers for all results of `pipeline`.
    #[must_use]
    pub fn new(pipeline: &Pipeline) -> Self {
        let pixels = pipeline.size().pixel_count();
        Self {
            depth: vec![0.0; pixels],
            labels: pipeline.graph().has_labels().then(|| vec![0; pixels]),
            cloud: vec![CloudPoint::NONE; pipeline.cloud_size().pixel_count()],
        }
    }

    /// The buffers, to be filled. The confidence stays in the pipeline.
    pub fn outputs(&mut self) -> Outputs<'_> {
        Outputs {
            depth_m: &mut self.depth,
            labels: self.labels.as_deref_mut(),
            confidence: None,
            cloud: Some(&mut self.cloud),
        }
    }

    /// `[H, W]`, of the last frame.
    #[must_use]
    pub fn depth(&self) -> &[f32] {
        &self.depth
    }

    /// `[H, W]`, of the last frame; `None` if the network does not segment.
    #[must_use]
    pub fn labels(&self) -> Option<&[u8]> {
        self.labels.as_deref()
    }

    /// Depth, labels and confidence of the last frame, which `pipeline` processed, for the detector of
    /// obstacles.
    #[must_use]
    pub fn depth_image<'a>(&'a self, pipeline: &'a Pipeline) -> DepthImage<'a> {
        DepthImage { depth_m: &self.depth, labels: self.labels(), confidence: pipeline.confidence() }
    }

    /// The organized cloud of the last frame.
    #[must_use]
    pub fn cloud(&self) -> &[CloudPoint] {
        &self.cloud
    }
}
