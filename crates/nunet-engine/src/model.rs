//! A model that processes images in this process.

use std::num::{NonZeroU32, NonZeroUsize};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use nunet_core::camera::{CalibratedScale, Camera, Mount};
use nunet_core::cloud::CloudPoint;
use nunet_core::filter::{FilterOptions, FilterSpec};
use nunet_core::frame::ImageView;
use nunet_core::framing::{AspectMismatch, AspectMode, Framing};
use nunet_core::graph::Provider;
use nunet_core::pipeline::{FrameReport, Outputs, Pipeline, PipelineError, PipelineOptions};
use nunet_core::scale::ScaleMode;
use nunet_types::ImageSize;

use crate::clock::MonotonicClock;
use crate::engine::Engine;
use crate::error::EngineError;
use crate::model_report::ModelReport;
use crate::options::EngineOptions;
use crate::pool::{Pool, Pooled};
use crate::text::LIBRARY_VARIABLE;

/// The options of a model.
#[derive(Debug, Clone, Default)]
pub struct ModelOptions {
    /// Which execution provider computes.
    pub provider: Provider,
    /// Threads of one prediction; `None` for one per core.
    pub threads: Option<NonZeroUsize>,
    /// What is done with images of another aspect ratio than the network's.
    pub aspect: AspectMode,
    /// The filters for depth; each at most once.
    pub filters: Vec<FilterSpec>,
    /// The source of the factor by which the network's meters are multiplied.
    pub scale: ScaleMode,
    /// The factor of this camera and model, if it was measured.
    pub factor: Option<f32>,
}

/// A model that was checked, loaded and self-tested.
///
/// # Example
/// See the [crate's first page](crate).
pub struct Model {
    path: PathBuf,
    report: String,
    pipeline: Pipeline,
    camera: Option<Camera>,
    /// The factor of the camera's calibration, if it is used.
    scale: Option<CalibratedScale>,
    /// The factor of the options.
    own_factor: Option<f32>,
    /// Also counts images at which the network failed, because they may forget the state.
    runs: u64,
    pools: Pools,
}

/// One pool for each kind of result; all buffers of a kind have one size.
#[derive(Default)]
struct Pools {
    depth: Pool<f32>,
    labels: Pool<u8>,
    confidence: Pool<u8>,
    rgb: Pool<u8>,
}

/// The results of one image. Their buffers are reused once they are dropped.
#[derive(Debug)]
pub struct Inferred {
    /// `[H, W]` at [`Model::size`], rows from the top: meters or no unit, as `report.units` says; NaN = no
    /// measurement.
    pub depth: Pooled<f32>,
    /// `[H, W]`: class indices. `None` if the network does not segment.
    pub labels: Option<Pooled<u8>>,
    /// `[H, W]`: 255 = certain, 0 where there is no depth. `None` if the network has no confidence.
    pub confidence: Option<Pooled<u8>>,
    /// `[H, W, 3]`, RGB: the image as the network saw it, at the size of the results.
    pub rgb: Pooled<u8>,
    /// The report of the pipeline.
    pub report: FrameReport,
    /// The camera on whose rays the points lie, at [`Model::size`]: the given one, else the assumed one.
    pub points_camera: Camera,
    /// Which part of the image the results cover.
    pub framing: Framing,
    /// A factor that was measured with images that were taken in another way.
    pub aspect_mismatch: Option<AspectMismatch>,
    /// Nanoseconds of the whole call.
    pub total_nanos: u64,
}

impl Model {
    /// Finds a model by path or name, checks it in a child process if it is new on this machine, loads and
    /// self-tests it. The library is the one of `ORT_DYLIB_PATH`, else it is searched.
    ///
    /// # Errors
    /// No such model, no library, a file that is refused, options that do not fit the network.
    pub fn open(name: &Path, options: ModelOptions) -> Result<Self, EngineError> {
        let ModelOptions { provider, threads, aspect, filters, scale, factor } = options;
        let filters = FilterOptions::new(&filters)?;
        let library = std::env::var_os(LIBRARY_VARIABLE).filter(|path| !path.is_empty());
        let onnxruntime = library.map(PathBuf::from);
        let engine = Engine::start(EngineOptions { provider, threads, onnxruntime })?;
        let loaded = engine.load(name, &[], &AtomicBool::new(false))?;
        let (path, hash) = (loaded.path().to_owned(), loaded.hash());
        let options = PipelineOptions {
            aspect,
            filters,
            scale,
            calibrated_factor: factor,
            ..PipelineOptions::default()
        };
        let (pipeline, selftest) = loaded.into_pipeline(options)?;
        let file = path.display().to_string();
        let report = ModelReport { file, hash, graph: pipeline.graph(), selftest: &selftest };
        let report = report.json().to_string();
        Ok(Self {
            path,
            report,
            pipeline,
            camera: None,
            scale: None,
            own_factor: factor,
            runs: 0,
            pools: Pools::default(),
        })
    }

    /// The model file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What `nunetd inspect --json` prints about it.
    #[must_use]
    pub fn report_json(&self) -> &str {
        &self.report
    }

    /// The pipeline.
    #[must_use]
    pub fn pipeline(&self) -> &Pipeline {
        &self.pipeline
    }

    /// Width and height of the results, pixels.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        self.pipeline.size()
    }

    /// How many images were given to the network, also those at which it failed. If it is unchanged, no one
    /// else has used the model, and its state is the one that the last image left.
    #[must_use]
    pub fn runs(&self) -> u64 {
        self.runs
    }

    /// Sets the factor of a calibration for the next images; `None` for that of the options. Returns
    /// whether it is used: a factor that was measured with another model is not.
    ///
    /// # Errors
    /// Depth without a unit.
    pub fn set_calibrated_scale(&mut self, scale: Option<CalibratedScale>) -> Result<bool, EngineError> {
        let fitting = scale.filter(|scale| scale.is_for(&self.pipeline.graph().description().hash));
        let factor_of = |scale: Option<CalibratedScale>| scale.map(|scale| scale.factor).or(self.own_factor);
        let factor = factor_of(fitting);
        if factor != factor_of(self.scale) {
            self.pipeline.set_calibrated_factor(factor)?;
        }
        self.scale = fitting;
        Ok(fitting.is_some() == scale.is_some())
    }

    /// Sets the mount for the next images, for example with the attitude of an inertial sensor. Only the
    /// scale from the floor uses it.
    pub fn set_mount(&mut self, mount: Mount) {
        self.pipeline.set_mount(mount);
    }

    /// Sets the capture time of the next image, for the scale from the floor ([`Pipeline::set_frame_nanos`]).
    pub fn set_frame_nanos(&mut self, nanos: i64) {
        self.pipeline.set_frame_nanos(nanos);
    }

    /// A discontinuity of the stream, as in `nunetd`: a recurrent network and the temporal filter lose their
    /// state. The scale from the floor stays.
    pub fn reset(&mut self) {
        self.pipeline.reset();
    }

    /// Processes one image, taken with `camera` at the image's size, if it is known.
    ///
    /// With `keep_state`, a recurrent network, the temporal filter and the scale from the floor keep their
    /// state from the image before.
    ///
    /// # Errors
    /// A camera that does not fit the image, and errors of ONNX Runtime.
    pub fn infer(
        &mut self,
        image: &ImageView<'_>,
        camera: Option<Camera>,
        keep_state: bool,
    ) -> Result<Inferred, EngineError> {
        let start = Instant::now();
        self.take_camera(camera, image)?;
        if !keep_state {
            self.pipeline.reset_with_scale();
        }
        self.runs += 1;
        let pixels = self.pipeline.size().pixel_count();
        let mut depth = self.pools.depth.take(pixels);
        let graph = self.pipeline.graph();
        let mut labels = graph.has_labels().then(|| self.pools.labels.take(pixels));
        let mut confidence = graph.has_confidence().then(|| self.pools.confidence.take(pixels));
        // Colors must match depth pixel by pixel, and decimation reduces them only for a cloud.
        let mut points =
            (self.pipeline.decimation() > NonZeroU32::MIN).then(|| vec![CloudPoint::NONE; pixels]);
        let outputs = Outputs {
            depth_m: &mut depth,
            labels: labels.as_deref_mut(),
            confidence: confidence.as_deref_mut(),
            cloud: points.as_deref_mut(),
        };
        let report = self.pipeline.process(image, outputs, &MonotonicClock)?;
        let rgb = self.colors(image, points.as_deref(), pixels);
        let points_camera = *self.pipeline.points_camera();
        let total_nanos = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        let framing = *self.pipeline.framing();
        let aspect_mismatch = self.scale.and_then(|scale| self.pipeline.aspect_mismatch(&scale));
        Ok(Inferred {
            depth,
            labels,
            confidence,
            rgb,
            report,
            points_camera,
            framing,
            aspect_mismatch,
            total_nanos,
        })
    }

    /// Sets the camera of the next image.
    fn take_camera(&mut self, camera: Option<Camera>, image: &ImageView<'_>) -> Result<(), EngineError> {
        if let Some(camera) = camera {
            camera.fitted_to(image.width(), image.height()).map_err(PipelineError::from)?;
        }
        if self.camera != camera {
            self.pipeline.set_camera(camera)?;
            self.camera = camera;
        }
        Ok(())
    }

    /// The colors of the last image's results: those of the cloud if there is one, else the network's input.
    fn colors(&self, image: &ImageView<'_>, points: Option<&[CloudPoint]>, pixels: usize) -> Pooled<u8> {
        let mut rgb = self.pools.rgb.take(3 * pixels);
        match points {
            None => rgb.copy_from_slice(self.pipeline.network_image(image)),
            Some(points) => {
                for (pixel, point) in rgb.chunks_exact_mut(3).zip(points) {
                    pixel.copy_from_slice(&[point.r, point.g, point.b]);
                }
            }
        }
        rgb
    }
}
