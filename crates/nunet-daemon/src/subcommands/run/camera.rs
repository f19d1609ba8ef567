//! One camera of a run: from its arguments to a stream.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::bail;
use nunet_core::pipeline::Pipeline;
use nunet_ipc::{CameraName, Limits, unix_nanos};
use tracing::{Span, error, error_span, warn};

use crate::cli::{RunArgs, SourceArgs, StreamArgs};
use crate::exit::{BadArguments, camera_name, source_error};
use crate::sink::metrics::MetricsServer;
use crate::sink::recording::{recording_path, refuse_output};
use crate::sink::shm::{ShmPublisher, ShmPublisherOptions, frame_id};
use crate::sink::stats::Common;
use crate::sink::{self, SinkContext, SinkOptions};
use crate::source::{
    Exclusive, Fill, Frame, OpenOptions, Rate, Source, SourceError, SourceErrorKind, SourceName,
};
use crate::stream::{CameraResolver, Notify, Pace, Stop, Stream, StreamTask};

/// A camera's arguments, checked as far as they can be without the machine.
pub(super) struct Plan<'a> {
    pub(super) arguments: &'a StreamArgs,
    pub(super) name: CameraName,
    source: SourceName,
    /// The file that `--record` means.
    pub(super) record: Option<PathBuf>,
}

/// The cameras' arguments, each of them and beside each other. Nothing is made yet.
pub(super) fn plans<'a>(arguments: &'a RunArgs) -> anyhow::Result<Vec<Plan<'a>>> {
    refuse_no_source(arguments)?;
    let streams: Vec<_> = arguments.streams().collect();
    let several = streams.len() > 1;
    let folders: Vec<_> = streams.iter().filter_map(|stream| stream.out.as_deref()).map(place).collect();
    let plan = |stream: &&'a StreamArgs| {
        let source = source_name(stream.source.as_deref());
        let name = stream.camera.as_deref().unwrap_or(source.properties().camera);
        Plan::new(stream, name, source.clone(), &folders).map_err(|error| in_camera(error, name, several))
    };
    let plans = streams.iter().map(plan).collect::<anyhow::Result<Vec<_>>>()?;
    refuse_shared(&plans)?;
    Ok(plans)
}

impl<'a> Plan<'a> {
    /// `folders` are those that will be made.
    fn new(
        arguments: &'a StreamArgs,
        name: &str,
        source: SourceName,
        folders: &[PathBuf],
    ) -> anyhow::Result<Self> {
        refuse_pace_of_live_source(&source, &arguments.pace)?;
        source.check(&arguments.pace.open_options()).map_err(source_error)?;
        let name = camera_name(name)?;
        frame_id(&name, arguments.frame_id.as_deref())?;
        let record = arguments.recording.record.as_deref().map(|path| {
            let is_folder = path.is_dir() || folders.iter().any(|folder| folder.starts_with(place(path)));
            recording_path(path, is_folder, name.as_str(), unix_nanos())
        });
        Ok(Self { arguments, name, source, record })
    }

    /// The recording that is read.
    fn input(&self) -> Option<&Path> {
        self.source.properties().is_recording.then(|| self.source.path())
    }
}

/// One name for what may be written in several ways: absolute, with links resolved as far as it is there.
pub(super) fn place(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let there = path.ancestors().find_map(|there| Some((there, there.canonicalize().ok()?)));
    let resolved = there.and_then(|(there, found)| Some((found, path.strip_prefix(there).ok()?)));
    match resolved {
        // Joining nothing would add a slash.
        Some((found, rest)) if rest.as_os_str().is_empty() => found,
        Some((found, rest)) => found.join(rest),
        None => path,
    }
}

/// What two cameras cannot both have.
fn refuse_shared(plans: &[Plan<'_>]) -> Result<(), BadArguments> {
    for (index, plan) in plans.iter().enumerate() {
        for (earlier, other) in plans.iter().enumerate().take(index) {
            if plan.name == other.name {
                return Err(BadArguments(format!(
                    "cameras {} and {} are both named `{}`\nhint: give each `[[camera]]` section a `name` of its own",
                    earlier + 1,
                    index + 1,
                    plan.name
                )));
            }
            if let Some(what) = shared_between(plan, other) {
                return Err(BadArguments(format!(
                    "cameras `{}` and `{}` both {what}\nhint: only one camera can",
                    other.name, plan.name
                )));
            }
        }
    }
    Ok(())
}

fn shared_between(one: &Plan<'_>, other: &Plan<'_>) -> Option<String> {
    let same_file = |a: &Option<PathBuf>, b: &Option<PathBuf>| {
        a.as_deref().zip(b.as_deref()).is_some_and(|(a, b)| place(a) == place(b))
    };
    match (one.source.properties().exclusive, other.source.properties().exclusive) {
        (Some(Exclusive::StandardInput), Some(Exclusive::StandardInput)) => return Some("read stdin".into()),
        // Its numbered name and those below /dev/v4l.
        (Some(Exclusive::Device), Some(Exclusive::Device))
            if place(one.source.path()) == place(other.source.path()) =>
        {
            return Some(format!("read `{}`", place(one.source.path()).display()));
        }
        _ => {}
    }
    if same_file(&one.arguments.out, &other.arguments.out) {
        return Some("write into one `out` folder".into());
    }
    same_file(&one.record, &other.record).then(|| "write one `record` file".into())
}

/// A camera that may begin.
pub(super) struct Prepared<'a> {
    pub(super) plan: Plan<'a>,
    source: Box<dyn Source>,
    camera: CameraResolver,
}

/// Opens the sources of all cameras. Bad arguments of one camera are an error, and so is a source that cannot be opened
/// where no other can; beside others its camera is waited for, or fails alone.
///
/// With `open` of [`probe_source`] nothing is read from cameras and pipes: `nunetd config` refuses what `run` would.
pub(super) fn prepare<'a>(
    plans: Vec<Plan<'a>>,
    stop: &Stop,
    open: impl Fn(&SourceName, OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError>,
) -> anyhow::Result<Vec<Prepared<'a>>> {
    let several = plans.len() > 1;
    let inputs: Vec<PathBuf> = plans.iter().filter_map(Plan::input).map(Into::into).collect();
    let (model_folders, mut opened) = (nunet_engine::model_folders(), Vec::new());
    for plan in plans {
        let options = OpenOptions {
            stopped: Some(stop.flag()),
            model_folders: &model_folders,
            ..plan.arguments.pace.open_options()
        };
        let source = open(&plan.source, options);
        stop.check()?;
        let source = match source {
            Err(error) if error.kind() == SourceErrorKind::BadArguments => {
                return Err(in_camera(source_error(error), plan.name.as_str(), several));
            }
            source => source,
        };
        let camera = CameraResolver::new(&plan.arguments.optics.lens.geometry.options());
        let camera = camera.map_err(|error| in_camera(error, plan.name.as_str(), several))?;
        refuse_recording(&plan, &inputs).map_err(|error| in_camera(error, plan.name.as_str(), several))?;
        opened.push((plan, source, camera));
    }
    if opened.iter().all(|(_, source, _)| source.is_err()) {
        let mut errors = opened.into_iter().filter_map(|(plan, source, _)| Some((plan, source.err()?)));
        let first =
            errors.next().map(|(plan, error)| in_camera(source_error(error), plan.name.as_str(), several));
        errors.for_each(|(plan, error)| error!("camera `{}`: {error:#}", plan.name));
        return first.map_or_else(|| Ok(Vec::new()), Err);
    }
    let mut cameras = Vec::new();
    for (plan, source, camera) in opened {
        let options = plan.arguments.pace.open_options();
        let source = source.unwrap_or_else(|error| plan.source.stand_in(options, error));
        cameras.push(Prepared { plan, source, camera });
    }
    Ok(cameras)
}

/// Stands in for a source that is not to be read.
struct Unread;

impl Source for Unread {
    fn fill(&mut self, _frame: &mut Frame) -> Fill {
        Fill::End
    }
}

/// Checks a source without taking anything from it: a camera may be in use, and what is read from a pipe is gone.
pub(super) fn probe_source(
    name: &SourceName,
    options: OpenOptions<'_>,
) -> Result<Box<dyn Source>, SourceError> {
    name.check(&options)?;
    match name.properties().exclusive {
        Some(Exclusive::StandardInput) => Ok(Box::new(Unread)),
        Some(Exclusive::Device) if name.path().exists() => Ok(Box::new(Unread)),
        _ => name.open(options),
    }
}

/// Says which of several cameras is meant; what kind of error it is stays.
pub(super) fn in_camera(error: anyhow::Error, camera: &str, several: bool) -> anyhow::Error {
    let text = format!("camera `{camera}` cannot begin");
    match several {
        false => error,
        true if error.is::<BadArguments>() => error.context(BadArguments(text)),
        true => error.context(text),
    }
}

/// Around what is logged of a camera, where there are several.
pub(super) fn span_of(camera: &str, several: bool) -> Span {
    if several { error_span!("camera", name = %camera) } else { Span::none() }
}

impl<'a> Prepared<'a> {
    /// Reserves the camera's memory.
    pub(super) fn open(
        self,
        pipeline: Pipeline,
        common: Common<'_>,
        several: bool,
        stop: &Stop,
    ) -> anyhow::Result<Opened<'a>> {
        stop.check()?;
        let Plan { arguments, name, .. } = &self.plan;
        let span = span_of(name.as_str(), several);
        let open = || {
            let _camera = span.enter();
            ShmPublisher::open(
                &pipeline,
                &ShmPublisherOptions {
                    camera: name,
                    frame_id: arguments.frame_id.as_deref(),
                    publish: &arguments.publish,
                    limits: limits(arguments),
                    model: &common.model.name,
                    given_up: &|| stop.requested(),
                },
            )
        };
        let opened = open();
        stop.check()?;
        let publisher = opened.map_err(|error| in_camera(error, name.as_str(), several))?;
        Ok(Opened { prepared: self, pipeline, publisher, span })
    }
}

/// A camera with its shared memory.
pub(super) struct Opened<'a> {
    prepared: Prepared<'a>,
    pipeline: Pipeline,
    publisher: ShmPublisher,
    span: Span,
}

impl Opened<'_> {
    /// Opens the sinks.
    pub(super) fn start(
        self,
        common: Common<'_>,
        metrics: Option<&MetricsServer>,
        notify: &Arc<Notify>,
    ) -> anyhow::Result<Stream> {
        let Self { prepared, pipeline, publisher, span } = self;
        let Prepared { plan: Plan { arguments, name, source: _, record }, source, camera } = prepared;
        let entered = span.clone().entered();
        let notify = Arc::clone(notify);
        let context = SinkContext {
            options: SinkOptions {
                record: record.as_deref(),
                force: arguments.recording.force,
                lossless: arguments.recording.record_lossless,
                out: arguments.out.as_deref(),
            },
            camera: &name,
            frame_id: arguments.frame_id.as_deref(),
            mount: arguments.recording.mount.mount,
            common,
            pipeline: &pipeline,
            metrics,
            on_room: Arc::new(move || notify.notify()),
        };
        let sinks = sink::open_all(&context)?;
        let pace = Pace { rate: arguments.pace.rate.unwrap_or(Rate::Max), limit: arguments.pace.frames };
        drop(entered);
        Ok(Stream { source, pace, task: StreamTask::new(pipeline, camera, publisher, sinks), span })
    }
}

/// Clouds are by far the largest messages: half as many processes may read them.
fn limits(arguments: &StreamArgs) -> Limits {
    let readers = arguments.readers.map_or(Limits::DEFAULT.max_readers, |readers| readers.get() as usize);
    Limits { max_readers: readers, max_cloud_readers: readers.div_ceil(2), ..Limits::default() }
}

/// A file is written for a robot: depth of an invented room must not go out under a camera's name because a line is
/// missing. The bare command line may leave it out.
fn refuse_no_source(arguments: &RunArgs) -> Result<(), BadArguments> {
    let Some(config) = &arguments.config else { return Ok(()) };
    let Some(stream) = arguments.streams().find(|stream| stream.source.is_none()) else { return Ok(()) };
    let camera = stream.camera.as_ref().map(|name| format!(" for camera `{name}`")).unwrap_or_default();
    Err(BadArguments(format!(
        "neither `{}` nor the command line names a source{camera}\nhint: `source = \"/dev/video0\"`, or \
         `source = \"demo\"` if the demo scene is meant",
        config.display()
    )))
}

/// Without `--source`, the demo scene; someone who forgot the flag is told.
fn source_name(source: Option<&str>) -> SourceName {
    source.map_or_else(
        || {
            warn!("no --source: frames come from the built-in demo scene");
            SourceName::demo()
        },
        SourceName::parse,
    )
}

/// Refused before any work is done where it may not be written, or is what some camera reads.
fn refuse_recording(plan: &Plan<'_>, inputs: &[PathBuf]) -> anyhow::Result<()> {
    let Some(path) = &plan.record else { return Ok(()) };
    let force = plan.arguments.recording.force;
    inputs.iter().try_for_each(|input| refuse_output(path, Some(input), force))?;
    refuse_output(path, None, force)
}

/// A camera has a pace of its own and no end to begin again at.
fn refuse_pace_of_live_source(source: &SourceName, pace: &SourceArgs) -> anyhow::Result<()> {
    if source.properties().is_shared_memory && (pace.rate.is_some() || pace.repeat) {
        bail!(BadArguments(
            "--rate and --loop are for files: a camera in shared memory has its own pace\nhint: give them to whoever \
             publishes the camera, such as `nunetd feed`"
                .into()
        ));
    }
    Ok(())
}
