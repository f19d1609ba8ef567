//! One camera of a run: from its arguments to a stream.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::bail;
use nunet_core::pipeline::Pipeline;
use nunet_ipc::{CameraName, Limits, unix_nanos};
use tracing::{Span, error, error_span, warn};

use crate::cli::{RunArgs, SourceArgs, StreamArgs};
use crate::exit::{BadArguments, camera_name};
use crate::sink::collect::Collector;
use crate::sink::metrics::Metrics;
use crate::sink::recording::{About, FrameWriter, Recorder, recording_path, refuse_output, settings};
use crate::sink::shm::{Outlet, OutletOptions, frame_id};
use crate::sink::stats::Common;
use crate::source::{self, Kind, Opening, Rate, Source};
use crate::stream::{Bell, Optics, Pace, Sinks, Stop, Stream, Worker};

/// A camera's arguments, checked as far as they can be without the machine.
pub(super) struct Plan<'a> {
    pub(super) arguments: &'a StreamArgs,
    pub(super) name: CameraName,
    kind: Kind,
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
        let kind = source_kind(stream.source.as_deref());
        let name = stream.camera.as_deref().unwrap_or(kind.default_camera());
        Plan::new(stream, name, kind.clone(), &folders).map_err(|error| in_camera(error, name, several))
    };
    let plans = streams.iter().map(plan).collect::<anyhow::Result<Vec<_>>>()?;
    refuse_shared(&plans)?;
    Ok(plans)
}

impl<'a> Plan<'a> {
    /// `folders` are those that will be made.
    fn new(arguments: &'a StreamArgs, name: &str, kind: Kind, folders: &[PathBuf]) -> anyhow::Result<Self> {
        refuse_pace_of_live_source(&kind, &arguments.pace)?;
        arguments.pace.opening().check(&kind)?;
        let name = camera_name(name)?;
        frame_id(&name, arguments.frame_id.as_deref())?;
        let record = arguments.recording.record.as_deref().map(|path| {
            let is_folder = path.is_dir() || folders.iter().any(|folder| folder.starts_with(place(path)));
            recording_path(path, is_folder, name.as_str(), unix_nanos())
        });
        Ok(Self { arguments, name, kind, record })
    }

    /// The recording that is read.
    fn input(&self) -> Option<&Path> {
        if let Kind::Recording(input) = &self.kind { Some(input) } else { None }
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
    match (&one.kind, &other.kind) {
        (Kind::Pipe, Kind::Pipe) => return Some("read stdin".into()),
        // Its numbered name and those below /dev/v4l.
        (Kind::Video(path), Kind::Video(another)) if place(path) == place(another) => {
            return Some(format!("read `{}`", place(path).display()));
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
    optics: Optics,
}

/// Opens the sources of all cameras. Bad arguments of one camera are an error, and so is a source that cannot be opened
/// where no other can; beside others its camera is waited for, or fails alone.
pub(super) fn prepare<'a>(plans: Vec<Plan<'a>>, stop: &Stop) -> anyhow::Result<Vec<Prepared<'a>>> {
    let several = plans.len() > 1;
    let inputs: Vec<PathBuf> = plans.iter().filter_map(Plan::input).map(Into::into).collect();
    let mut opened = Vec::new();
    for plan in plans {
        let opening = Opening { stopped: Some(stop.flag()), ..plan.arguments.pace.opening() };
        let source = source::open(&plan.kind, opening);
        stop.check()?;
        let source = match source {
            Err(error) if error.is::<BadArguments>() => {
                return Err(in_camera(error, plan.name.as_str(), several));
            }
            source => source,
        };
        let optics = Optics::new(&plan.arguments.optics.lens.geometry);
        let optics = optics.map_err(|error| in_camera(error, plan.name.as_str(), several))?;
        refuse_recording(&plan, &inputs).map_err(|error| in_camera(error, plan.name.as_str(), several))?;
        opened.push((plan, source, optics));
    }
    if opened.iter().all(|(_, source, _)| source.is_err()) {
        let mut errors = opened.into_iter().filter_map(|(plan, source, _)| Some((plan, source.err()?)));
        let first = errors.next().map(|(plan, error)| in_camera(error, plan.name.as_str(), several));
        errors.for_each(|(plan, error)| error!("camera `{}`: {error:#}", plan.name));
        return first.map_or_else(|| Ok(Vec::new()), Err);
    }
    let mut cameras = Vec::new();
    for (plan, source, optics) in opened {
        let opening = plan.arguments.pace.opening();
        let source = source.unwrap_or_else(|error| source::in_place_of(&plan.kind, opening, error));
        cameras.push(Prepared { plan, source, optics });
    }
    Ok(cameras)
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
            let outlet = Outlet::open(
                &pipeline,
                &OutletOptions {
                    camera: name,
                    frame_id: arguments.frame_id.as_deref(),
                    publish: &arguments.publish,
                    limits: limits(arguments),
                    model: &common.model.name,
                    given_up: &|| stop.requested(),
                },
            )?;
            let folder = arguments.out.clone();
            let collector = folder.map(|folder| Collector::attach(folder, name, &outlet)).transpose()?;
            Ok((outlet, collector))
        };
        let opened = open();
        stop.check()?;
        let (outlet, collector) = opened.map_err(|error| in_camera(error, name.as_str(), several))?;
        Ok(Opened { prepared: self, pipeline, outlet, collector, span })
    }
}

/// A camera that owns its shared memory.
pub(super) struct Opened<'a> {
    prepared: Prepared<'a>,
    pipeline: Pipeline,
    outlet: Outlet,
    collector: Option<Collector>,
    span: Span,
}

impl Opened<'_> {
    /// Begins the recording, where one is wanted.
    pub(super) fn start(
        self,
        common: Common<'_>,
        metrics: Option<Metrics>,
        bell: &Arc<Bell>,
    ) -> anyhow::Result<Stream> {
        let Self { prepared, pipeline, outlet, collector, span } = self;
        let Prepared { plan: Plan { arguments, name, kind: _, record }, source, optics } = prepared;
        let entered = span.clone().entered();
        let about = About {
            camera: name.as_str(),
            frame_id: arguments.frame_id.as_deref(),
            mount: arguments.recording.mount.mount,
            model: common.model,
            provider: common.provider,
            settings: settings(&pipeline),
            force: arguments.recording.force,
        };
        let bell = Arc::clone(bell);
        let recorder = record.as_deref().map(|path| {
            Recorder::start(FrameWriter::create(path, &about)?, &name, &outlet, move || bell.ring())
        });
        let sinks = Sinks { recorder: recorder.transpose()?, collector, metrics };
        let pace = Pace { rate: arguments.pace.rate.unwrap_or(Rate::Max), limit: arguments.pace.frames };
        drop(entered);
        Ok(Stream { source, pace, worker: Worker::new(pipeline, optics, outlet, sinks), span })
    }
}

/// Clouds are by far the largest messages: half as many may read them. nunetd's own readers come on top.
fn limits(arguments: &StreamArgs) -> Limits {
    let own = usize::from(arguments.recording.record.is_some()) + usize::from(arguments.out.is_some());
    let readers = arguments.readers.map_or(Limits::DEFAULT.max_readers, |readers| readers.get() as usize);
    Limits { max_readers: readers + own, max_cloud_readers: readers.div_ceil(2) + own, ..Limits::default() }
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
fn source_kind(source: Option<&str>) -> Kind {
    source.map_or_else(
        || {
            warn!("no --source: frames come from the built-in demo scene");
            Kind::Demo
        },
        Kind::parse,
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
fn refuse_pace_of_live_source(kind: &Kind, pace: &SourceArgs) -> anyhow::Result<()> {
    if matches!(kind, Kind::SharedMemory(_)) && (pace.rate.is_some() || pace.repeat) {
        bail!(BadArguments(
            "--rate and --loop are for files: a camera in shared memory has its own pace\nhint: give them to whoever \
             publishes the camera, such as `nunetd feed`"
                .into()
        ));
    }
    Ok(())
}
