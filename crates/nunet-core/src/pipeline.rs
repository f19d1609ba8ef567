//! The whole journey of a frame, in one short function.

use std::num::NonZeroU32;

use crate::camera::{Camera, Intrinsics};
use crate::clock::Clock;
use crate::cloud::CloudPoint;
use crate::depth::{ScaleSource, Units};
use crate::frame::ImageView;
use crate::graph::{GraphError, Quality, SerialGraph, StageTimes};
use crate::model::{SelfTestMismatch, SelfTestReport};

/// What to do about the focal length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Focal {
    /// Correct metres by the ratio of this camera's focal length to the training camera's, where both are known.
    #[default]
    Auto,
    /// Take the network's metres as they are.
    Off,
}

/// How a pipeline is to be built.
#[derive(Debug, Clone, Copy)]
pub struct PipelineOptions {
    /// The camera; without one there is no cloud and no focal scaling.
    pub camera: Option<Camera>,
    /// Whether depth is corrected for the focal length.
    pub focal: Focal,
    /// The cloud has each n-th column and row.
    pub cloud_stride: NonZeroU32,
}

impl Default for PipelineOptions {
    fn default() -> Self {
        Self {
            camera: None,
            focal: Focal::Auto,
            cloud_stride: NonZeroU32::MIN,
        }
    }
}

/// Where a frame's results go: memory of the caller.
#[derive(Debug)]
pub struct Outputs<'a> {
    /// `[H, W]` at the network's size: metres (or no unit, see [`FrameReport::units`]), NaN where there is none.
    pub depth_m: &'a mut [f32],
    /// `[H, W]`: class indices; `None` where nobody wants them.
    pub labels: Option<&'a mut [u8]>,
    /// [`Pipeline::cloud_size`] points; `None` where nobody wants them.
    pub cloud: Option<&'a mut [CloudPoint]>,
}

/// What happened to a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameReport {
    /// The time of each stage, in the order of [`Pipeline::stage_names`]; 0 for one that did not run.
    pub stages: StageTimes,
    /// Whether a stage was skipped.
    pub quality: Quality,
    /// The unit of the depth map.
    pub units: Units,
    /// Where its scale comes from.
    pub scale_source: ScaleSource,
    /// Bytes written to move data that existed already; 0 where camera and network fit.
    pub bytes_copied: u64,
    /// Pixels without a measurement.
    pub invalid_pixels: u32,
    /// The camera at the network's size.
    pub intrinsics: Option<Intrinsics>,
}

/// A graph with everything around it.
pub struct Pipeline {
    graph: SerialGraph,
}

impl Pipeline {
    /// Builds the pipeline around a graph.
    ///
    /// # Errors
    /// A camera that cannot be scaled to the network's size.
    pub fn new(graph: SerialGraph, options: PipelineOptions) -> Result<Self, PipelineError> {
        let _ = (&graph, options);
        todo!()
    }

    /// The graph inside.
    #[must_use]
    pub fn graph(&self) -> &SerialGraph {
        &self.graph
    }

    /// Width and height of the depth map and the labels, pixels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        self.graph.size()
    }

    /// Width and height of the cloud; `None` without a camera.
    #[must_use]
    pub fn cloud_size(&self) -> Option<(u32, u32)> {
        todo!()
    }

    /// `preprocess`, the graph's stages, `decode`, `cloud`.
    #[must_use]
    pub fn stage_names(&self) -> &[String] {
        todo!()
    }

    /// Takes one frame from camera bytes to depth, labels and cloud.
    ///
    /// # Errors
    /// Buffers of another length than the network's size asks for, and what ONNX Runtime reports.
    pub fn process(
        &mut self,
        frame: &ImageView<'_>,
        outputs: Outputs<'_>,
        clock: &dyn Clock,
    ) -> Result<FrameReport, PipelineError> {
        todo!("{frame:?} {outputs:?} {}", clock.nanos())
    }

    /// Runs the self-test picture and compares the answer with the one that the model carries. Doubles as warm-up.
    ///
    /// # Errors
    /// An answer that differs by more than the tolerance, and what ONNX Runtime reports.
    pub fn selftest(&mut self, clock: &dyn Clock) -> Result<SelfTestReport, PipelineError> {
        todo!("{}", clock.nanos())
    }
}

/// What can go wrong with a frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The graph did not run.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// The model computes something else here than where it was exported.
    #[error("the model gives other numbers on this machine than when it was exported")]
    SelfTest(#[from] SelfTestMismatch),
}
