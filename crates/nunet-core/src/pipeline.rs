//! The whole journey of a frame, in one short function.

use std::num::NonZeroU32;

use crate::camera::{Camera, CameraError, Intrinsics, RayTable};
use crate::clock::Clock;
use crate::cloud::{CloudError, CloudPoint, cloud_size, organised_cloud};
use crate::depth::{Scale, ScaleSource, Units};
use crate::frame::ImageView;
use crate::graph::{GraphError, GraphInput, GraphOutputs, Quality, SerialGraph, StageTimes};
use crate::model::{ModelDescription, SelfTestGrid, SelfTestMismatch, SelfTestReport, selftest};
use crate::preprocess::{Preprocessor, TensorFormat};

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
    /// The cloud has each n-th column and row.
    pub cloud_stride: NonZeroU32,
}

impl Default for PipelineOptions {
    fn default() -> Self {
        Self { camera: None, focal: Focal::Auto, cloud_stride: NonZeroU32::MIN }
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
    /// The camera at the network's size, with its lens: depth lies in the picture as the lens drew it. `None` where the
    /// camera was assumed.
    pub camera: Option<Camera>,
}

/// Horizontal field of view of a camera of which nothing is known, not even by the model: that of a common webcam.
const ASSUMED_HFOV_RAD: f64 = std::f64::consts::FRAC_PI_3;

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
    cloud_stride: NonZeroU32,
    stage_names: Vec<String>,
}

impl Pipeline {
    /// Builds the pipeline around a graph.
    ///
    /// # Errors
    /// A camera that cannot be scaled to the network's size.
    pub fn new(graph: SerialGraph, options: PipelineOptions) -> Result<Self, PipelineError> {
        let (width, height) = graph.size();
        let lens = Lens::new(options.camera, graph.description(), graph.size())?;
        let inner = graph.stages().iter().map(|stage| stage.name.as_str());
        let names = ["preprocess"].into_iter().chain(inner).chain(["decode", "cloud"]);
        Ok(Self {
            preprocessor: Preprocessor::new(width, height),
            input: Input::new(&graph),
            focal: options.focal,
            scale: scale(graph.description(), options.focal, width, &lens),
            lens,
            cloud_stride: options.cloud_stride,
            stage_names: names.map(str::to_owned).collect(),
            graph,
        })
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
        self.lens = Lens::new(camera, description, self.size())?;
        self.scale = scale(description, self.focal, self.size().0, &self.lens);
        Ok(())
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

    /// `preprocess`, the graph's stages, `decode`, `cloud`.
    #[must_use]
    pub fn stage_names(&self) -> &[String] {
        &self.stage_names
    }

    /// The next frame does not follow those before it: nothing of them is used again. A network with a memory begins
    /// with zeros, and every stage runs.
    ///
    /// When a stream breaks is for the caller to say; here a frame is a frame.
    pub fn reset(&mut self) {
        self.graph.reset();
    }

    /// Takes one frame from camera bytes to depth, labels and cloud. A network with a memory takes it as the
    /// successor of the last frame ([`Self::reset`]); a frame that fails in the network is none to it.
    ///
    /// Nothing is allocated on the Rust side once the frame's size and each buffer's address have been seen.
    ///
    /// # Errors
    /// Buffers of another length than the network's size asks for, and what ONNX Runtime reports.
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

        let results = GraphOutputs { depth: depth_m, labels: labels.as_deref_mut() };
        let run = self.graph.run(input, results, clock)?;
        stages.extend(&run.stages);

        let start = clock.nanos();
        let invalid_pixels = decode(self.graph.description(), depth_m, self.scale.focal_factor);
        let decoded = clock.nanos();
        stages.push(start, decoded);

        if let Some(points) = cloud {
            let rays = &self.lens.rays;
            let labels = labels.as_deref().or_else(|| self.graph.labels());
            organised_cloud(depth_m, rays, picture.rgb, labels, self.cloud_stride, points)?;
        }
        stages.push(decoded, clock.nanos());

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
    /// is remembered before it or after it.
    ///
    /// # Errors
    /// An answer that differs by more than the tolerance, and what ONNX Runtime reports.
    pub fn selftest(&mut self, clock: &dyn Clock) -> Result<SelfTestReport, PipelineError> {
        let (width, height) = self.size();
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
        Focal::Auto => Scale::from_focal_lengths(
            description.encoding,
            training_fx_px,
            lens.known.map(|camera| camera.intrinsics.fx_px),
        ),
    }
}

/// The camera at the network's size.
struct Lens {
    /// `None` where the rays are those of an assumed camera.
    known: Option<Camera>,
    rays: RayTable,
}

impl Lens {
    fn new(
        camera: Option<Camera>,
        description: &ModelDescription,
        (width, height): (u32, u32),
    ) -> Result<Self, CameraError> {
        let known = camera.map(|camera| camera.scaled_to(width, height)).transpose()?;
        let camera = match known {
            Some(camera) => camera,
            None => assumed_camera(description, width, height)?,
        };
        Ok(Self { known, rays: RayTable::new(&camera) })
    }
}

/// The training camera, else one of [`ASSUMED_HFOV_RAD`], looking through the middle of the picture.
fn assumed_camera(description: &ModelDescription, width: u32, height: u32) -> Result<Camera, CameraError> {
    let middle = |side: u32| (f64::from(side) - 1.0) / 2.0;
    let (fx, fy) = description.camera.map_or_else(
        || {
            let fx = f64::from(width) / (2.0 * (ASSUMED_HFOV_RAD / 2.0).tan());
            (fx, fx)
        },
        |camera| {
            let scale = |focal: f64, from: u32, to: u32| focal * f64::from(to) / f64::from(from);
            (scale(camera.fx, camera.width, width), scale(camera.fy, camera.height, height))
        },
    );
    Intrinsics::new(fx, fy, middle(width), middle(height), width, height).map(Camera::pinhole)
}

/// The picture as the graph wants it: as it is, or as a foreign network's tensor in memory kept for it.
enum Input {
    Rgb,
    Float { format: TensorFormat, tensor: Vec<f32> },
}

impl Input {
    fn new(graph: &SerialGraph) -> Self {
        let (width, height) = graph.size();
        match graph.float_input() {
            None => Self::Rgb,
            Some(&format) => Self::Float { format, tensor: vec![0.0; 3 * width as usize * height as usize] },
        }
    }

    /// The graph's input for a picture of its size, and the bytes written to make it.
    fn of<'a>(&'a mut self, rgb: &'a [u8]) -> (GraphInput<'a>, u64) {
        match self {
            Self::Rgb => (GraphInput::Rgb(rgb), 0),
            Self::Float { format, tensor } => {
                format.fill(rgb, tensor);
                (GraphInput::Float(tensor), size_of_val(&tensor[..]) as u64)
            }
        }
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
    /// The cloud's buffers do not fit.
    #[error(transparent)]
    Cloud(#[from] CloudError),
    /// The model computes something else here than where it was exported.
    #[error("the model gives other numbers on this machine than when it was exported")]
    SelfTest(#[from] SelfTestMismatch),
}
