//! The whole journey of a frame, in one short function.

use std::num::NonZeroU32;

use crate::camera::{Camera, CameraError};
use crate::clock::Clock;
use crate::cloud::{CloudError, CloudPoint, cloud_size, organised_cloud};
use crate::depth::{Scale, ScaleSource, Units};
use crate::filter::{self, Chain, Decimation, DecimationOptions, FilterError, FilterOptions, Look};
use crate::frame::ImageView;
use crate::graph::{GraphError, GraphOutputs, Quality, SerialGraph, StageTimes};
use crate::model::{ModelDescription, SelfTestGrid, SelfTestMismatch, SelfTestReport, selftest};
use crate::preprocess::Preprocessor;

mod input;
mod lens;

use input::Input;
use lens::Lens;

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
    /// The camera; without one points and metres are those of an assumed camera ([`Pipeline::set_camera`]).
    pub camera: Option<Camera>,
    /// Whether depth is corrected for the focal length.
    pub focal: Focal,
    /// The cloud has each n-th column and row of the depth map.
    pub cloud_stride: NonZeroU32,
    /// What is done to depth between decoding and the cloud.
    pub filters: FilterOptions,
}

impl Default for PipelineOptions {
    fn default() -> Self {
        let filters = FilterOptions::default();
        Self { camera: None, focal: Focal::Auto, cloud_stride: NonZeroU32::MIN, filters }
    }
}

/// Where a frame's results go: memory of the caller.
#[derive(Debug)]
pub struct Outputs<'a> {
    /// `[H, W]` at [`Pipeline::size`]: metres (or no unit, see [`FrameReport::units`]), NaN where there is none.
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
    /// Pixels of the depth map without a depth, after the filters: those that are NaN.
    pub invalid_pixels: u32,
    /// The camera at [`Pipeline::size`], with its lens: depth lies in the picture as the lens drew it. `None` where the
    /// camera was assumed.
    pub camera: Option<Camera>,
}

/// A graph with everything around it.
///
/// # Example: depth and labels of one picture
/// ```no_run
/// use nunet_core::frame::{ImageView, PixelFormat};
/// use nunet_core::graph::{GraphOptions, Runtime, SerialGraph};
/// use nunet_core::pipeline::{Outputs, Pipeline, PipelineOptions};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let runtime = Runtime::load("libonnxruntime.so".as_ref())?;
/// let graph = SerialGraph::load("wnet_c.onnx".as_ref(), &runtime, &GraphOptions::default())?;
/// let mut pipeline = Pipeline::new(graph, PipelineOptions::default())?;
/// let clock = || 0; // a real one where the times matter
/// pipeline.selftest(&clock)?;
///
/// let (width, height) = pipeline.size();
/// let pixels = width as usize * height as usize;
/// let (mut depth_m, mut labels) = (vec![0.0; pixels], vec![0; pixels]);
/// let bytes = vec![0; 640 * 480 * 3];
/// let frame = ImageView::packed(&bytes, 640, 480, PixelFormat::Rgb8)?;
/// let outputs = Outputs { depth_m: &mut depth_m, labels: Some(&mut labels), cloud: None };
/// let report = pipeline.process(&frame, outputs, &clock)?;
/// println!("{} of {pixels} pixels without depth", report.invalid_pixels);
/// # Ok(())
/// # }
/// ```
pub struct Pipeline {
    preprocessor: Preprocessor,
    input: Input,
    graph: SerialGraph,
    focal: Focal,
    scale: Scale,
    lens: Lens,
    filters: FilterOptions,
    decimation: Option<Decimation>,
    chain: Chain,
    cloud_stride: NonZeroU32,
    stage_names: Vec<String>,
}

impl Pipeline {
    /// Builds the pipeline around a graph.
    ///
    /// # Errors
    /// A camera that cannot be scaled to the network's size, a network too small for the decimation.
    pub fn new(graph: SerialGraph, options: PipelineOptions) -> Result<Self, PipelineError> {
        let (width, height) = graph.size();
        let filters = options.filters;
        let lens = Lens::new(options.camera, graph.description(), graph.size(), filters.decimation())?;
        let decimation = filters.decimation().map(|options| Decimation::new(options, graph.size()));
        let mut pipeline = Self {
            preprocessor: Preprocessor::new(width, height),
            input: Input::new(&graph),
            focal: options.focal,
            scale: scale(graph.description(), options.focal, width, &lens),
            lens,
            filters,
            decimation: decimation.transpose()?,
            chain: Chain::default(),
            cloud_stride: options.cloud_stride,
            stage_names: Vec::new(),
            graph,
        };
        pipeline.chain = Chain::new(&filters, pipeline.size());
        pipeline.stage_names = pipeline.named_stages().map(str::to_owned).collect();
        Ok(pipeline)
    }

    fn named_stages(&self) -> impl Iterator<Item = &str> {
        let graph = self.graph.stages().iter().map(|stage| stage.name.as_str());
        let decimation = self.decimation.iter().map(|_| Decimation::NAME);
        let after = ["decode"].into_iter().chain(decimation).chain(self.chain.names()).chain(["cloud"]);
        ["preprocess"].into_iter().chain(graph).chain(after)
    }

    /// Another camera takes the frames from now on, or one of which nothing is known.
    ///
    /// Without a camera, points and metres are those of an assumed one: the training camera, else a webcam's 60
    /// degrees from left to right. Computes the table of rays anew.
    ///
    /// # Errors
    /// A camera that cannot be scaled to the network's size.
    pub fn set_camera(&mut self, camera: Option<Camera>) -> Result<(), PipelineError> {
        let description = self.graph.description();
        let network_size = self.graph.size();
        self.lens = Lens::new(camera, description, network_size, self.filters.decimation())?;
        self.scale = scale(description, self.focal, network_size.0, &self.lens);
        Ok(())
    }

    /// The graph inside.
    #[must_use]
    pub fn graph(&self) -> &SerialGraph {
        &self.graph
    }

    /// Width and height of the depth map and the labels, pixels: the network's, or less with a decimation.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        let size = self.graph.size();
        self.filters.decimation().map_or(size, |decimation| decimation.reduced(size))
    }

    /// The camera that the cloud's rays are of, at [`Pipeline::size`]: the known one, else the one that is assumed.
    #[must_use]
    pub fn points_camera(&self) -> &Camera {
        &self.lens.camera
    }

    /// What the network saw of `frame`, the last one that was processed: `[H, W, 3]`, RGB, at the network's size. It is
    /// the frame itself where that fitted.
    #[must_use]
    pub fn picture_of<'a>(&'a self, frame: &ImageView<'a>) -> &'a [u8] {
        self.preprocessor.last(frame)
    }

    /// Pixels of the network on each side of a pixel of the depth map: 1 without a decimation.
    #[must_use]
    pub fn decimation(&self) -> NonZeroU32 {
        self.filters.decimation().map_or(NonZeroU32::MIN, DecimationOptions::factor)
    }

    /// The filters that depth goes through.
    #[must_use]
    pub fn filters(&self) -> &FilterOptions {
        &self.filters
    }

    /// Width and height of the cloud, points.
    #[must_use]
    pub fn cloud_size(&self) -> (u32, u32) {
        let (width, height) = self.size();
        cloud_size(width, height, self.cloud_stride)
    }

    /// The cloud has each n-th column and row of the depth map.
    #[must_use]
    pub fn cloud_stride(&self) -> NonZeroU32 {
        self.cloud_stride
    }

    /// The unit of the depth map and where its scale comes from, the same until the camera changes.
    #[must_use]
    pub fn scale(&self) -> Scale {
        self.scale
    }

    /// `preprocess`, the graph's stages, `decode`, the filters that are on, `cloud`.
    #[must_use]
    pub fn stage_names(&self) -> &[String] {
        &self.stage_names
    }

    /// Whether a frame's results depend on it alone. Then one may be processed again, and nobody after it will know.
    #[must_use]
    pub fn is_memoryless(&self) -> bool {
        self.graph.is_memoryless() && self.filters.temporal.is_none()
    }

    /// The next frame does not follow those before it: nothing of them is used again. A network with a memory begins
    /// with zeros, every stage runs, and filters over time begin anew.
    ///
    /// When a stream breaks is for the caller to say; here a frame is a frame.
    pub fn reset(&mut self) {
        self.graph.reset();
        self.chain.reset();
    }

    /// Takes one frame from camera bytes to depth, labels and cloud. A network with a memory takes it as the
    /// successor of the last frame ([`Self::reset`]); a frame that fails in the network is none to it.
    ///
    /// Nothing is allocated on the Rust side once the frame's size and each buffer's address have been seen.
    ///
    /// # Errors
    /// Buffers of another length than [`Self::size`] asks for, and what ONNX Runtime reports.
    pub fn process(
        &mut self,
        frame: &ImageView<'_>,
        outputs: Outputs<'_>,
        clock: &dyn Clock,
    ) -> Result<FrameReport, PipelineError> {
        let Outputs { depth_m, mut labels, cloud } = outputs;
        let mut stages = StageTimes::default();

        let start = clock.nanos();
        let picture = self.preprocessor.prepare(frame);
        let (input, bytes_filled) = self.input.of(picture.rgb);
        stages.push(start, clock.nanos());

        if labels.is_some() && !self.graph.has_labels() {
            return Err(GraphError::NoLabels.into());
        }
        // What is to be made smaller stays inside.
        let (decoded_m, network_labels) = match &mut self.decimation {
            None => (&mut *depth_m, labels.as_deref_mut()),
            Some(decimation) => (decimation.network_depth(), None),
        };
        let results = GraphOutputs { depth: decoded_m, labels: network_labels };
        let run = self.graph.run(input, results, clock)?;
        stages.extend(&run.stages);

        let start = clock.nanos();
        let mut invalid_pixels = decode(self.graph.description(), decoded_m, self.scale.focal_factor);
        stages.push(start, clock.nanos());

        let look = match &mut self.decimation {
            None => Look { rgb: picture.rgb, labels: labels.as_deref().or_else(|| self.graph.labels()) },
            Some(decimation) => {
                let start = clock.nanos();
                let full = Look { rgb: picture.rgb, labels: self.graph.labels() };
                let look = decimation.reduce(full, depth_m, labels, cloud.is_some())?;
                stages.push(start, clock.nanos());
                look
            }
        };
        self.chain.apply(depth_m, clock, &mut stages)?;
        if self.filters != FilterOptions::default() {
            invalid_pixels = filter::count_invalid(depth_m);
        }

        let start = clock.nanos();
        if let Some(points) = cloud {
            organised_cloud(depth_m, &self.lens.rays, look.rgb, look.labels, self.cloud_stride, points)?;
        }
        stages.push(start, clock.nanos());

        Ok(FrameReport {
            stages,
            quality: run.quality,
            units: self.scale.units,
            scale_source: self.scale.source,
            bytes_copied: picture.bytes_copied + bytes_filled + run.bytes_copied,
            invalid_pixels,
            camera: self.lens.known,
        })
    }

    /// Runs the self-test picture and compares the answer with the one that the model carries. Doubles as warm-up. Nothing
    /// is remembered before it or after it. It asks the network alone: filters have no part in it.
    ///
    /// # Errors
    /// An answer that differs by more than the tolerance, and what ONNX Runtime reports.
    pub fn selftest(&mut self, clock: &dyn Clock) -> Result<SelfTestReport, PipelineError> {
        let (width, height) = self.graph.size();
        let pixels = width as usize * height as usize;
        let (mut depth, mut labels) = (vec![0.0; pixels], self.graph.has_labels().then(|| vec![0; pixels]));
        let picture = selftest::picture(width, height);

        self.graph.reset();
        let (input, _) = self.input.of(&picture);
        self.graph.run(input, GraphOutputs { depth: &mut depth, labels: labels.as_deref_mut() }, clock)?;
        self.graph.reset();

        decode(self.graph.description(), &mut depth, 1.0);
        match &self.graph.description().selftest {
            Some(expected) => {
                Ok(expected.compare(&SelfTestGrid::of(&depth, labels.as_deref(), width, height))?)
            }
            None => Ok(SelfTestReport::UNCHECKED),
        }
    }
}

/// The network's numbers to depth, in place; how many pixels are no measurement.
fn decode(description: &ModelDescription, depth: &mut [f32], focal_factor: f32) -> u32 {
    description.encoding.decode(depth, description.range, focal_factor)
}

/// The scale of all frames. Both focal lengths are compared at the network's width.
fn scale(description: &ModelDescription, focal: Focal, width: u32, lens: &Lens) -> Scale {
    let training_fx_px =
        description.camera.map(|camera| camera.fx * f64::from(width) / f64::from(camera.width));
    match focal {
        Focal::Off => Scale::unscaled(description.encoding),
        Focal::Auto => Scale::from_focal_lengths(description.encoding, training_fx_px, lens.network_fx_px),
    }
}

/// What can go wrong with a frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The graph did not run.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// The camera does not go with the network's size.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A filter does not go with the network's size, or its buffers do not fit.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// The cloud's buffers do not fit.
    #[error(transparent)]
    Cloud(#[from] CloudError),
    /// The model computes something else here than where it was exported.
    #[error("the model gives other numbers on this machine than when it was exported")]
    SelfTest(#[from] SelfTestMismatch),
}
