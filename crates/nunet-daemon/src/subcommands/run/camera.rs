//! One camera of a run: turns its configuration into a stream.

use std::path::PathBuf;
use std::sync::Arc;

use nunet_core::pipeline::Pipeline;
use nunet_engine::find_model;
use nunet_ipc::unix_nanos;
use nunet_ros2::Topics;
use nunet_ros2::options::Available;
use nunet_sink::attitude::AttitudeStage;
use nunet_sink::file_plan::{FilePlan, place};
use nunet_sink::obstacle_record::obstacle_frame;
use nunet_sink::obstacles::ObstacleStage;
use nunet_sink::output_file::recording_path;
use nunet_sink::output_paths::{CameraPaths, OutputPaths};
use tracing::{Span, error, error_span};

use super::servers::Servers;
use crate::config::{CameraConfig, Config};
use crate::exit::{BadArguments, in_camera};
use crate::sink::recording::refuse_output;
use crate::sink::shm::{ShmPublisher, ShmPublisherOptions};
use crate::sink::stats::Common;
use crate::sink::{self, SinkContext};
use crate::source::{
    CameraResolver, Exclusive, Notify, OpenOptions, Source, SourceError, SourceErrorKind, SourceName,
    first_frame,
};
use crate::stream::{Pace, Stop, Stream, StreamTask};
use crate::subcommands::load::obstacle_stage;

/// A camera's configuration, with its paths resolved on this machine.
pub(super) struct CameraPlan<'a> {
    pub(super) config: &'a CameraConfig,
    /// The file that is recorded into.
    pub(super) record: Option<PathBuf>,
}

/// Plans all cameras. Nothing is created yet.
pub(super) fn plans(config: &Config) -> Result<Vec<CameraPlan<'_>>, BadArguments> {
    let folders = config.cameras.iter().filter_map(|camera| camera.out.as_deref()).map(place);
    let folders: Vec<_> = folders.collect();
    let plans: Vec<_> = config.cameras.iter().map(|camera| CameraPlan::new(camera, &folders)).collect();
    refuse_shared(&plans)?;
    file_plan(config, &plans).check().map_err(|error| BadArguments::of(&error))?;
    Ok(plans)
}

/// Every file that is read or will be written.
fn file_plan(config: &Config, plans: &[CameraPlan<'_>]) -> FilePlan {
    let mut files = FilePlan::default();
    config.file.iter().for_each(|file| files.read("the configuration", file));
    find_model(&config.model.path).iter().for_each(|model| files.read_model(model));
    for CameraPlan { config: camera, record } in plans {
        files.read_source("the source", &camera.source.name);
        camera.processing.geometry.calibration.iter().for_each(|file| files.read("the calibration", file));
        camera.out.iter().for_each(|folder| files.write_results(folder));
        record.iter().for_each(|file| files.write("the recording", file));
    }
    config.outputs.stats_json.iter().for_each(|file| files.write("the statistics", file));
    files
}

impl<'a> CameraPlan<'a> {
    /// `folders` are those that will be created.
    fn new(config: &'a CameraConfig, folders: &[PathBuf]) -> Self {
        let record = config.record.as_ref().map(|record| {
            let path = &record.path;
            let is_folder = path.is_dir() || folders.iter().any(|folder| folder.starts_with(place(path)));
            recording_path(path, is_folder, config.name.as_str(), unix_nanos())
        });
        Self { config, record }
    }

    fn name(&self) -> &'a str {
        self.config.name.as_str()
    }
}

/// Refuses cameras that share something exclusive.
fn refuse_shared(plans: &[CameraPlan<'_>]) -> Result<(), BadArguments> {
    for (index, plan) in plans.iter().enumerate() {
        for (earlier, other) in plans.iter().enumerate().take(index) {
            if plan.name() == other.name() {
                let (first, second) = (earlier + 1, index + 1);
                let message = format!("cameras {first} and {second} are both named `{}`", plan.name());
                return Err(BadArguments::new(message)
                    .with_hint("give each `[[camera]]` section a `name` of its own"));
            }
            if let Some(what) = shared_between(plan, other) {
                let message = format!("cameras `{}` and `{}` both {what}", other.name(), plan.name());
                return Err(BadArguments::new(message).with_hint("let only one camera use it"));
            }
        }
    }
    Ok(())
}

fn shared_between(one: &CameraPlan<'_>, other: &CameraPlan<'_>) -> Option<String> {
    let same_file = |a: &Option<PathBuf>, b: &Option<PathBuf>| {
        a.as_deref().zip(b.as_deref()).is_some_and(|(a, b)| place(a) == place(b))
    };
    match (one.config.source.name.properties().exclusive, other.config.source.name.properties().exclusive) {
        (Some(Exclusive::StandardInput), Some(Exclusive::StandardInput)) => return Some("read stdin".into()),
        // Its numbered name and those below /dev/v4l.
        (Some(Exclusive::Device), Some(Exclusive::Device))
            if place(one.config.source.name.path()) == place(other.config.source.name.path()) =>
        {
            return Some(format!("read `{}`", place(one.config.source.name.path()).display()));
        }
        _ => {}
    }
    if same_file(&one.config.out, &other.config.out) {
        return Some("write into one `out` folder".into());
    }
    same_file(&one.record, &other.record).then(|| "write one `record` file".into())
}

/// A camera that is ready to start.
pub(super) struct PreparedCamera<'a> {
    pub(super) plan: CameraPlan<'a>,
    source: Box<dyn Source>,
    camera: CameraResolver,
}

/// Opens the sources of all cameras. Bad arguments of one camera are an error. So is a source that cannot be
/// opened, if no other can. Otherwise, a camera device is waited for, and any other source fails alone.
///
/// With `open` of [`SourceName::probe`] nothing is read from cameras and pipes: `nunetd config` refuses what
/// `run` would.
pub(super) fn prepare<'a>(
    plans: Vec<CameraPlan<'a>>,
    stop: &Stop,
    open: impl Fn(&SourceName, OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError>,
) -> anyhow::Result<Vec<PreparedCamera<'a>>> {
    let several = plans.len() > 1;
    let (model_folders, mut opened) = (nunet_engine::model_folders(), Vec::new());
    for plan in plans {
        let options = OpenOptions {
            stopped: Some(stop.flag()),
            model_folders: &model_folders,
            ..plan.config.open_options()
        };
        let source = open(&plan.config.source.name, options);
        stop.check()?;
        let source = match source {
            Err(error) if error.kind() == SourceErrorKind::Argument => {
                return Err(in_camera(error.into(), plan.name(), several));
            }
            source => source,
        };
        let camera = CameraResolver::new(&plan.config.processing.geometry);
        let camera = camera.map_err(|error| in_camera(error.into(), plan.name(), several))?;
        refuse_recording(&plan).map_err(|error| in_camera(error, plan.name(), several))?;
        opened.push((plan, source, camera));
    }
    if opened.iter().all(|(_, source, _)| source.is_err()) {
        let mut errors = opened.into_iter().filter_map(|(plan, source, _)| Some((plan, source.err()?)));
        let first = errors.next().map(|(plan, error)| in_camera(error.into(), plan.name(), several));
        errors.for_each(|(plan, error)| error!("camera `{}`: {error:#}", plan.name()));
        return first.map_or_else(|| Ok(Vec::new()), Err);
    }
    let mut cameras = Vec::new();
    for (plan, source, camera) in opened {
        let name = &plan.config.source.name;
        let source = source.unwrap_or_else(|error| name.stand_in(plan.config.open_options(), error));
        cameras.push(PreparedCamera { plan, source, camera });
    }
    Ok(cameras)
}

/// All output paths of a run.
pub(super) fn output_paths(cameras: &[PreparedCamera<'_>], config: &Config) -> OutputPaths {
    let paths = |PreparedCamera { plan, .. }: &PreparedCamera<'_>| CameraPaths {
        camera: plan.config.name.to_string(),
        folder: plan.config.out.clone(),
        record: plan.record.clone(),
    };
    let stats_json = config.outputs.stats_json.clone();
    OutputPaths { cameras: cameras.iter().map(paths).collect(), stats_json }
}

/// The span for log lines of one camera, if there are several.
pub(super) fn span_of(camera: &str, several: bool) -> Span {
    if several { error_span!("camera", name = %camera) } else { Span::none() }
}

impl<'a> PreparedCamera<'a> {
    /// Checks whether the obstacles and the topics of ROS 2 fit the model, and the camera the first image of
    /// files.
    pub(super) fn check(self, mut pipeline: Pipeline, topics: &Topics, several: bool) -> anyhow::Result<()> {
        let Self { plan, mut source, mut camera } = self;
        let mut check = || -> anyhow::Result<()> {
            let obstacles = obstacle_stage(plan.config.obstacles, &pipeline)?.is_some();
            let (labels, confidence) = (pipeline.graph().has_labels(), pipeline.graph().has_confidence());
            topics.of_camera(Available { labels, confidence, obstacles })?;
            let is_live = plan.config.source.name.properties().is_live();
            match (!is_live).then(|| first_frame(&mut *source)).transpose()?.flatten() {
                Some(frame) => Ok(camera.update(&frame, &mut pipeline).map(drop)?),
                None => Ok(()),
            }
        };
        check().map_err(|error| in_camera(error, plan.name(), several))
    }

    /// Reserves the camera's memory.
    pub(super) fn open(
        self,
        pipeline: Pipeline,
        common: Common<'_>,
        several: bool,
        stop: &Stop,
    ) -> anyhow::Result<Opened<'a>> {
        stop.check()?;
        let config = self.plan.config;
        let span = span_of(config.name.as_str(), several);
        let obstacles = obstacle_stage(config.obstacles, &pipeline);
        let obstacles = obstacles.map_err(|error| in_camera(error.into(), config.name.as_str(), several))?;
        let open = || {
            let _camera = span.enter();
            ShmPublisher::open(
                &pipeline,
                &ShmPublisherOptions {
                    camera: &config.name,
                    frame_id: &config.frame_id,
                    publish: &config.publish,
                    obstacles: obstacles.is_some(),
                    obstacle_frame: obstacle_frame(config.attitude.is_some()),
                    limits: config.limits(),
                    model: &common.model.name,
                    given_up: &|| stop.requested(),
                },
            )
        };
        let opened = open();
        stop.check()?;
        let publisher = opened.map_err(|error| in_camera(error, config.name.as_str(), several))?;
        Ok(Opened { prepared: self, pipeline, publisher, obstacles, span })
    }
}

/// A camera with its shared memory.
pub(super) struct Opened<'a> {
    prepared: PreparedCamera<'a>,
    pipeline: Pipeline,
    publisher: ShmPublisher,
    obstacles: Option<ObstacleStage>,
    span: Span,
}

impl Opened<'_> {
    /// Opens the sinks.
    pub(super) fn start(
        self,
        common: Common<'_>,
        servers: &Servers,
        notify: &Arc<Notify>,
    ) -> anyhow::Result<Stream> {
        let Self { prepared, pipeline, publisher, obstacles, span } = self;
        let PreparedCamera { plan: CameraPlan { config, record }, source, camera } = prepared;
        let entered = span.clone().entered();
        let notify = Arc::clone(notify);
        let context = SinkContext {
            config,
            record: record.as_deref(),
            common,
            pipeline: &pipeline,
            has_obstacles: obstacles.is_some(),
            metrics: servers.metrics.as_ref(),
            view: servers.view.as_ref(),
            ros2: servers.ros2.as_ref(),
            foxglove: servers.foxglove.as_ref(),
            on_room: Arc::new(move || notify.notify()),
        };
        let sinks = sink::open_all(&context)?;
        let pace = Pace::of(&config.source);
        drop(entered);
        let attitude = config.attitude.map(|attitude| AttitudeStage::new(&config.name, attitude));
        let task = StreamTask::new(pipeline, camera, publisher, sinks).with_stages(obstacles, attitude);
        Ok(Stream { source, pace, task: task.with_stability_limit(config.stability_limit), span })
    }
}

/// Refuses a recording that would replace a file, before any work is done.
fn refuse_recording(plan: &CameraPlan<'_>) -> anyhow::Result<()> {
    let Some(path) = &plan.record else { return Ok(()) };
    refuse_output(path, plan.config.record.as_ref().is_some_and(|record| record.force))
}
