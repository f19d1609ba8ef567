//! The pipeline. [`Pipeline::process`] calls all stages of a frame in order.

use std::num::NonZeroU32;

use nunet_types::ImageSize;

use crate::camera::{Camera, Mount};
use crate::clock::Clock;
use crate::cloud::cloud_size;
use crate::depth::{Scale, Units};
use crate::filter::{self, Appearance, Decimation, DecimationOptions, FilterChain, FilterOptions};
use crate::frame::ImageView;
use crate::graph::{GraphReport, SerialGraph, StageTimes};
use crate::scale::ScaleMode;
use crate::stability::StabilityGauge;

mod confidence;
mod decoder;
mod error;
mod fit;
mod floor;
mod frame;
mod input;
mod lens;
mod letterbox;
mod network;
mod options;
mod selftest;
mod timer;

use confidence::ConfidenceMap;
use decoder::Decoder;
pub use error::PipelineError;
use floor::FloorScale;
pub use frame::{FrameReport, Outputs};
use lens::Lens;
use network::Network;
pub use options::{MAX_RAY_ANGLE_RAD, PipelineOptions};
use timer::StageTimer;

/// A graph with the stages before and after it.
///
/// # Example: depth and labels of one image
/// ```no_run
/// use nunet_core::frame::{ImageView, PixelFormat};
/// use nunet_core::graph::{GraphOptions, Runtime, SerialGraph};
/// use nunet_core::pipeline::{Outputs, Pipeline, PipelineOptions};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let runtime = Runtime::load("libonnxruntime.so".as_ref())?;
/// let graph = SerialGraph::load("wnet_c.onnx".as_ref(), &runtime, &GraphOptions::default())?;
/// let mut pipeline = Pipeline::new(graph, PipelineOptions::default())?;
/// let clock = || 0; // pass a real clock to measure times
/// pipeline.selftest(&clock)?;
///
/// let pixels = pipeline.size().pixel_count();
/// let (mut depth_m, mut labels) = (vec![0.0; pixels], vec![0; pixels]);
/// let bytes = vec![0; 640 * 480 * 3];
/// let frame = ImageView::packed(&bytes, 640, 480, PixelFormat::Rgb8)?;
/// let outputs =
///     Outputs { depth_m: &mut depth_m, labels: Some(&mut labels), confidence: None, cloud: None };
/// let report = pipeline.process(&frame, outputs, &clock)?;
/// println!("{} of {pixels} pixels without depth", report.invalid_pixels);
/// # Ok(())
/// # }
/// ```
pub struct Pipeline {
    network: Network,
    decoder: Decoder,
    lens: Lens,
    options: PipelineOptions,
    decimation: Option<Decimation>,
    confidence: ConfidenceMap,
    chain: FilterChain,
    stability: StabilityGauge,
    stage_names: Vec<String>,
}

impl Pipeline {
    /// Builds the pipeline around a graph.
    ///
    /// # Errors
    /// A camera that cannot be scaled to the network's size, a network too small for the decimation.
    pub fn new(mut graph: SerialGraph, options: PipelineOptions) -> Result<Self, PipelineError> {
        let decimation = options.filters.decimation().map(|options| Decimation::new(options, graph.size()));
        let framing = fit::initial_framing(&options, graph.size());
        let lens = Lens::new(&options, &framing, &mut graph)?;
        let decoder = Decoder::new(&graph, &options, &lens)?;
        let decimation = decimation.transpose()?;
        let confidence = ConfidenceMap::new(&graph, decimation.as_ref());
        let mut network = Network::new(graph);
        network.set_framing(framing);
        let mut pipeline = Self {
            network,
            decoder,
            lens,
            options,
            decimation,
            confidence,
            chain: FilterChain::default(),
            stability: StabilityGauge::default(),
            stage_names: Vec::new(),
        };
        pipeline.chain = FilterChain::new(&options.filters, pipeline.size());
        pipeline.stage_names = pipeline.named_stages().map(str::to_owned).collect();
        Ok(pipeline)
    }

    fn named_stages(&self) -> impl Iterator<Item = &str> {
        let graph = self.network.graph.stages().iter().map(|stage| stage.name.as_str());
        let decimation = self.decimation.iter().map(|_| Decimation::NAME);
        let after = ["decode"].into_iter().chain(decimation).chain(self.chain.names()).chain(["cloud"]);
        ["preprocess"].into_iter().chain(graph).chain(after)
    }

    /// Sets the factor that was measured for this camera and model; `None` if there is none. It replaces the
    /// ratio of the focal lengths.
    ///
    /// # Errors
    /// A factor out of range, or relative depth.
    pub fn set_calibrated_factor(&mut self, calibrated_factor: Option<f32>) -> Result<(), PipelineError> {
        self.set_options(PipelineOptions { calibrated_factor, ..self.options })
    }

    /// Sets the options, and computes the values that depend on them and the lens.
    fn set_options(&mut self, options: PipelineOptions) -> Result<(), PipelineError> {
        self.decoder = Decoder::new(&self.network.graph, &options, &self.lens)?;
        // Another scale is no drift.
        self.stability.reset();
        self.options = options;
        Ok(())
    }

    /// Sets the mount for the next frames, for example with the attitude of an inertial sensor. Only the
    /// scale from the floor uses it.
    pub fn set_mount(&mut self, mount: Mount) {
        if let Some(floor) = &mut self.decoder.floor {
            floor.set_mount(mount);
            self.options.scale = ScaleMode::Floor(mount);
        }
    }

    /// The mount of the scale from the floor; `None` if the floor is not used.
    #[must_use]
    pub fn mount(&self) -> Option<Mount> {
        if let ScaleMode::Floor(mount) = self.options.scale { Some(mount) } else { None }
    }

    /// Sets the capture time of the next frame, for the scale from the floor. Only differences count. A frame
    /// without a time counts as 0.1 s after the one before.
    pub fn set_frame_nanos(&mut self, nanos: i64) {
        self.decoder.floor.iter_mut().for_each(|floor| floor.set_frame_nanos(nanos));
    }

    /// The graph.
    #[must_use]
    pub fn graph(&self) -> &SerialGraph {
        &self.network.graph
    }

    /// Width and height of depth map and labels, pixels: the network's, or less with decimation.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        let size = self.network.graph.size();
        self.options.filters.decimation().map_or(size, |decimation| decimation.reduced(size))
    }

    /// The camera of the cloud's rays, at [`Pipeline::size`]: the known one, else the assumed one.
    #[must_use]
    pub fn points_camera(&self) -> &Camera {
        &self.lens.camera
    }

    /// The image of `frame`, the last one that was processed, pixel on pixel with the results before
    /// decimation: `[H, W, 3]`, RGB, at the network's size. It is the frame itself if that has the network's
    /// size and format.
    #[must_use]
    pub fn network_image<'a>(&'a self, frame: &ImageView<'a>) -> &'a [u8] {
        self.network.appearance(frame).rgb
    }

    /// The confidence of the last frame's depth, `[H, W]` at [`Pipeline::size`]: 255 = certain, 0 where depth
    /// is invalid or was filled in by a filter. `None` if the network has no confidence, or it was written
    /// into the caller's memory ([`Outputs::confidence`]).
    #[must_use]
    pub fn confidence(&self) -> Option<&[u8]> {
        self.confidence.values(&self.network)
    }

    /// Pixels of the network along each side of a pixel of the depth map: 1 without decimation.
    #[must_use]
    pub fn decimation(&self) -> NonZeroU32 {
        self.options.filters.decimation().map_or(NonZeroU32::MIN, DecimationOptions::factor)
    }

    /// The filters.
    #[must_use]
    pub fn filters(&self) -> &FilterOptions {
        &self.options.filters
    }

    /// Width and height of the cloud, points.
    #[must_use]
    pub fn cloud_size(&self) -> ImageSize {
        cloud_size(self.size(), self.options.cloud_stride)
    }

    /// The cloud has each n-th column and row of the depth map.
    #[must_use]
    pub fn cloud_stride(&self) -> NonZeroU32 {
        self.options.cloud_stride
    }

    /// The unit of the last depth map and its scale. It changes with the camera, and from frame to frame if
    /// it follows the floor.
    #[must_use]
    pub fn scale(&self) -> Scale {
        self.decoder.scale
    }

    /// `preprocess`, the graph's stages, `decode`, the filters that are on, `cloud`.
    #[must_use]
    pub fn stage_names(&self) -> &[String] {
        &self.stage_names
    }

    /// Whether a frame's results depend only on that frame, so that it can be processed again without an
    /// effect on later ones.
    #[must_use]
    pub fn is_stateless(&self) -> bool {
        self.network.graph.is_stateless() && self.options.filters.temporal.is_none() && self.mount().is_none()
    }

    /// Marks a discontinuity: the next frame does not continue the stream. State starts with zeros, every
    /// stage runs, and the temporal filter starts again. The scale from the floor is kept, because the camera
    /// is the same; [`Self::reset_with_scale`] discards it too.
    ///
    /// The caller decides when a discontinuity occurs.
    pub fn reset(&mut self) {
        self.network.graph.reset();
        self.chain.reset();
        self.stability.reset();
    }

    /// Makes the next frame independent of all earlier ones: [`Self::reset`], and the scale from the floor
    /// starts again.
    pub fn reset_with_scale(&mut self) {
        self.reset();
        self.decoder.forget_floor();
    }

    /// Computes depth, labels, confidence and cloud of one frame. A recurrent network treats it as the
    /// successor of the last frame, unless [`Self::reset`] was called; a frame that fails in the network does
    /// not change the state.
    ///
    /// Nothing is allocated on the Rust side once the frame's size and each buffer's address have been seen.
    ///
    /// # Errors
    /// Buffers of another length than [`Self::size`], before anything is computed, and ONNX Runtime's errors.
    pub fn process(
        &mut self,
        frame: &ImageView<'_>,
        mut outputs: Outputs<'_>,
        clock: &dyn Clock,
    ) -> Result<FrameReport, PipelineError> {
        outputs.check(self.graph(), self.size(), self.cloud_size())?;
        self.fit_to(frame.size())?;
        let size = self.size();
        let mut timer = StageTimer::new(clock);
        let mut results = outputs.of_network(self.decimation.as_mut());
        let (run, mut bytes_copied) = self.network.run(frame, results.reborrow(), clock, &mut timer)?;
        let decoded = timer.time(|| {
            bytes_copied += self.network.take_results(results.reborrow());
            self.decoder.decode(&mut self.network, frame, results)
        });

        let Outputs { depth_m, labels, confidence, cloud } = outputs;
        let full = self.network.appearance(frame);
        let appearance = match &mut self.decimation {
            None => Appearance { labels: labels.as_deref().or(full.labels), ..full },
            Some(decimation) => timer.time(|| decimation.reduce(full, depth_m, labels, cloud.is_some()))?,
        };
        self.chain.apply(depth_m, clock, timer.stages())?;
        let is_filtered = self.options.filters != FilterOptions::default();
        let invalid_pixels = if is_filtered { filter::count_invalid(depth_m) } else { decoded };
        let stability = self.stability.update(full.rgb, self.network.graph.size(), depth_m, size);
        let max_range_m = self.decoder.max_range_m();
        timer.time(|| self.lens.fill_cloud(depth_m, &appearance, max_range_m, cloud))?;
        let filtered = is_filtered.then_some(&*depth_m);
        self.confidence.finish(&mut self.network, self.decimation.as_ref(), confidence, filtered)?;

        let report = self.report(timer.finish(), run, bytes_copied, invalid_pixels);
        Ok(FrameReport { stability, ..report })
    }

    fn report(
        &self,
        stages: StageTimes,
        run: GraphReport,
        bytes_copied: u64,
        invalid_pixels: u32,
    ) -> FrameReport {
        let scale = self.decoder.scale;
        FrameReport {
            stages,
            quality: run.quality,
            units: scale.units,
            scale_source: scale.source,
            scale_factor: if scale.units == Units::Metre { scale.factor } else { 0.0 },
            scale_age_nanos: scale.age_nanos,
            bytes_copied: bytes_copied + run.bytes_copied,
            invalid_pixels,
            stability: None,
            camera: self.lens.known,
            view: self.framing().view(),
        }
    }
}
