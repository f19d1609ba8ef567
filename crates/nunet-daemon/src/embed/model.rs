//! A model that was vetted, loaded and tested, and pictures through it.

use std::num::{NonZeroU32, NonZeroUsize};
use std::path::{Path, PathBuf};

use nunet_core::camera::Camera;
use nunet_core::cloud::CloudPoint;
use nunet_core::filter::FilterSpec;
use nunet_core::frame::ImageView;
use nunet_core::graph::Provider;
use nunet_core::pipeline::{FrameReport, Outputs, Pipeline, PipelineError};

use super::memory::{Pool, Recycled};
use crate::cli::{CameraArgs, EngineArgs, FilterArgs};
use crate::engine::{Engine, tested};
use crate::subcommands::About;
use crate::telemetry::MonotonicClock;

/// Names ONNX Runtime's library, as it does for `nunetd`.
const LIBRARY_VARIABLE: &str = "ORT_DYLIB_PATH";

/// How a model is to run.
#[derive(Debug, Clone, Default)]
pub struct ModelOptions {
    /// What computes.
    pub provider: Provider,
    /// Threads of one prediction; one a core where nobody says.
    pub threads: Option<NonZeroUsize>,
    /// What is done to depth after the network; each filter at most once.
    pub filters: Vec<FilterSpec>,
}

/// A pipeline that has passed its self-test.
pub struct Model {
    path: PathBuf,
    about: String,
    pipeline: Pipeline,
    camera: Option<Camera>,
    runs: u64,
    memory: Memory,
}

/// What becomes results; each kind has one size.
#[derive(Default)]
struct Memory {
    depth: Pool<f32>,
    labels: Pool<u8>,
    rgb: Pool<u8>,
}

/// One picture's results.
#[derive(Debug)]
pub struct Inferred {
    /// `[H, W]` at [`Model::size`], rows from the top: metres or no unit, as `report.units` says; NaN where there is none.
    pub depth: Recycled<f32>,
    /// `[H, W]`: class indices, where the network segments.
    pub labels: Option<Recycled<u8>>,
    /// `[H, W, 3]`, RGB: the picture as the network saw it.
    pub rgb: Recycled<u8>,
    /// What happened on the way.
    pub report: FrameReport,
    /// The camera whose rays the points lie on, at [`Model::size`]: the known one, else the one that is assumed.
    pub points_camera: Camera,
    /// Nanoseconds of the whole way, with the results' memory.
    pub total_nanos: u64,
}

impl Model {
    /// Finds a model by path or name, has it vetted in a child process where it is new, loads and tests it.
    ///
    /// # Errors
    /// As `nunetd --model`: no such model, no library, a file that is refused.
    pub fn open(name: &Path, options: ModelOptions) -> anyhow::Result<Self> {
        let ModelOptions { provider, threads, filters } = options;
        let onnxruntime =
            std::env::var_os(LIBRARY_VARIABLE).filter(|path| !path.is_empty()).map(PathBuf::from);
        let loaded = Engine::start(&EngineArgs { provider, threads, onnxruntime })?.load(name, &[])?;
        let (path, hash) = (loaded.path.clone(), loaded.hash());
        let camera = CameraArgs { filters: FilterArgs { filters }, ..CameraArgs::default() };
        let (pipeline, report) = tested(loaded, &camera)?;
        let file = path.display().to_string();
        let about = About { file, hash, graph: pipeline.graph(), report: &report }.json().to_string();
        Ok(Self { path, about, pipeline, camera: None, runs: 0, memory: Memory::default() })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What `nunetd inspect --json` prints of it.
    #[must_use]
    pub fn about_json(&self) -> &str {
        &self.about
    }

    /// What runs.
    #[must_use]
    pub fn pipeline(&self) -> &Pipeline {
        &self.pipeline
    }

    /// Width and height of the results, pixels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        self.pipeline.size()
    }

    /// How many pictures have been through it.
    #[must_use]
    pub fn runs(&self) -> u64 {
        self.runs
    }

    /// Takes one picture, of the camera at the picture's size where it is known.
    ///
    /// With `keep_state`, a recurrent network and the temporal filter keep their state from the image before.
    ///
    /// # Errors
    /// A camera that does not fit, and what ONNX Runtime reports.
    pub fn infer(
        &mut self,
        frame: &ImageView<'_>,
        camera: Option<Camera>,
        keep_state: bool,
    ) -> Result<Inferred, PipelineError> {
        let start = std::time::Instant::now();
        if self.camera != camera {
            self.pipeline.set_camera(camera)?;
            self.camera = camera;
        }
        if !keep_state {
            self.pipeline.reset();
        }
        self.runs += 1;
        let (width, height) = self.pipeline.size();
        let pixels = width as usize * height as usize;
        let mut depth = self.memory.depth.take(pixels);
        let mut labels = self.pipeline.graph().has_labels().then(|| self.memory.labels.take(pixels));
        // Decimation reduces the colors only for a cloud, and they must lie pixel on pixel with depth.
        let mut points =
            (self.pipeline.decimation() > NonZeroU32::MIN).then(|| vec![CloudPoint::NONE; pixels]);
        let cloud = points.as_deref_mut();
        let outputs = Outputs { depth_m: &mut depth, labels: labels.as_deref_mut(), cloud };
        let report = self.pipeline.process(frame, outputs, &MonotonicClock)?;
        let mut rgb = self.memory.rgb.take(3 * pixels);
        match &points {
            None => rgb.copy_from_slice(self.pipeline.picture_of(frame)),
            Some(points) => {
                for (pixel, point) in rgb.chunks_exact_mut(3).zip(points) {
                    pixel.copy_from_slice(&[point.r, point.g, point.b]);
                }
            }
        }
        let points_camera = *self.pipeline.points_camera();
        let total_nanos = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        Ok(Inferred { depth, labels, rgb, report, points_camera, total_nanos })
    }
}
