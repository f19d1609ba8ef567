//! One camera of a run: from its arguments to a stream.

use std::num::NonZeroU32;
use std::path::PathBuf;

use anyhow::bail;
use nunet_core::pipeline::Pipeline;
use nunet_ipc::{CameraName, Limits};
use tracing::{Span, error, error_span, warn};

use crate::cli::{SourceArgs, StreamArgs};
use crate::exit::{BadArguments, camera_name};
use crate::sink::collect::Collector;
use crate::sink::files::make_folder;
use crate::sink::metrics::Metrics;
use crate::sink::recording::{About, FrameWriter, Recorder, recording_path, refuse_output};
use crate::sink::shm::{Outlet, OutletOptions};
use crate::sink::stats::Common;
use crate::source::{self, Kind, Rate, Source};
use crate::stream::{Optics, Pace, Sinks, Stream, Worker};
use crate::telemetry::unix_nanos;

/// A camera's arguments, checked as far as they can be without the machine.
pub(super) struct Plan<'a> {
    arguments: &'a StreamArgs,
    pub(super) name: CameraName,
    kind: Kind,
    /// The file that `--record` means.
    record: Option<PathBuf>,
}

impl<'a> Plan<'a> {
    pub(super) fn new(arguments: &'a StreamArgs) -> anyhow::Result<Self> {
        // Before the others: the figures and the recording often go into the folder of the results.
        arguments.out.as_deref().map_or(Ok(()), make_folder)?;
        let kind = source_kind(arguments.source.as_deref());
        refuse_pace_of_live_source(&kind, &arguments.pace)?;
        let name = camera_name(arguments.camera.as_deref().unwrap_or(kind.default_camera()))?;
        let record = arguments.recording.record.as_ref();
        let record = record.map(|path| recording_path(path, name.as_str(), unix_nanos()));
        Ok(Self { arguments, name, kind, record })
    }

    /// The recording that is read.
    fn input(&self) -> Option<&std::path::Path> {
        if let Kind::Recording(input) = &self.kind { Some(input) } else { None }
    }
}

/// What two cameras cannot both have.
pub(super) fn refuse_shared(plans: &[Plan<'_>]) -> Result<(), BadArguments> {
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
    let same_file = |a: &Option<PathBuf>, b: &Option<PathBuf>| a.is_some() && a == b;
    match &one.kind {
        Kind::Pipe if other.kind == Kind::Pipe => return Some("read stdin".into()),
        Kind::Video(path) if other.kind == one.kind => return Some(format!("read `{}`", path.display())),
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
pub(super) fn prepare(plans: Vec<Plan<'_>>) -> anyhow::Result<Vec<Prepared<'_>>> {
    let several = plans.len() > 1;
    let inputs: Vec<PathBuf> = plans.iter().filter_map(Plan::input).map(Into::into).collect();
    let mut opened = Vec::new();
    for plan in plans {
        let source = match source::open(&plan.kind, plan.arguments.pace.opening()) {
            Err(error) if error.is::<BadArguments>() => return Err(in_camera(error, &plan, several)),
            source => source,
        };
        let optics = Optics::new(&plan.arguments.optics.lens.geometry);
        let optics = optics.map_err(|error| in_camera(error, &plan, several))?;
        refuse_recording(&plan, &inputs)?;
        opened.push((plan, source, optics));
    }
    if opened.iter().all(|(_, source, _)| source.is_err()) {
        let mut errors = opened.into_iter().filter_map(|(plan, source, _)| Some((plan, source.err()?)));
        let first = errors.next().map(|(plan, error)| in_camera(error, &plan, several));
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
fn in_camera(error: anyhow::Error, plan: &Plan<'_>, several: bool) -> anyhow::Error {
    let text = format!("camera `{}` cannot begin", plan.name);
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

impl Prepared<'_> {
    /// Reserves the camera's memory and opens its sinks.
    pub(super) fn start(
        self,
        pipeline: Pipeline,
        common: Common<'_>,
        metrics: Option<Metrics>,
        several: bool,
    ) -> anyhow::Result<Stream> {
        let Self { plan: Plan { arguments, name, kind: _, record }, source, optics } = self;
        let span = span_of(name.as_str(), several);
        let _camera = span.clone().entered();
        let frame_id = arguments.frame_id.as_deref();
        let limits = limits(arguments.readers);
        let options = OutletOptions {
            camera: &name,
            frame_id,
            publish: &arguments.publish,
            limits,
            model: &common.model.name,
        };
        let outlet = Outlet::open(&pipeline, &options)?;
        let folder = arguments.out.clone();
        let collector = folder.map(|folder| Collector::attach(folder, &name, &outlet)).transpose()?;
        let about = About {
            camera: name.as_str(),
            frame_id,
            mount: arguments.recording.mount.mount,
            model: common.model,
            provider: common.provider,
            force: arguments.recording.force,
        };
        let recorder = record.as_deref();
        let recorder =
            recorder.map(|path| Recorder::start(FrameWriter::create(path, &about)?, &name, &outlet));
        let sinks = Sinks { recorder: recorder.transpose()?, collector, metrics };
        let pace = Pace { rate: arguments.pace.rate.unwrap_or(Rate::Max), limit: arguments.pace.frames };
        Ok(Stream { source, pace, worker: Worker::new(pipeline, optics, outlet, sinks), span })
    }
}

/// Clouds are by far the largest messages: half as many may read them.
fn limits(readers: Option<NonZeroU32>) -> Limits {
    readers.map_or(Limits::default(), |readers| {
        let readers = readers.get() as usize;
        Limits { max_readers: readers, max_cloud_readers: readers.div_ceil(2), ..Limits::default() }
    })
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
