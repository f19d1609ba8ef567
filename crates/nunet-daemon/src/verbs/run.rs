//! `nunetd run`: a source of frames becomes depth in shared memory.

use std::num::NonZeroU32;
use std::path::PathBuf;

use anyhow::bail;
use nunet_ipc::{CameraName, Limits};
use tracing::{info, warn};

use crate::Outcome;
use crate::cli::{RunArgs, SourceArgs};
use crate::engine::{Engine, tested_pipeline};
use crate::exit::{BadArguments, camera_name};
use crate::sink::collect::Collector;
use crate::sink::files::make_folder;
use crate::sink::metrics::Metrics;
use crate::sink::recording::{About, FrameWriter, Recorder, Tally, recording_path, refuse_output};
use crate::sink::shm::{Outlet, OutletOptions};
use crate::sink::stats::{ModelName, Stats, check_writable, write_json};
use crate::source::{self, Kind, Rate};
use crate::stream::{self, Ended, Optics, Pace, SourceEnd, Stop, Worker};
use crate::telemetry::{Counts, unix_nanos};

/// Runs until the source ends, `--frames` are captured, or a signal comes.
pub(super) fn run(arguments: RunArgs) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    // In this order: the figures often go into the folder of the results.
    arguments.out.as_deref().map_or(Ok(()), make_folder)?;
    arguments.stats_json.as_deref().map_or(Ok(()), check_writable)?;
    let kind = source_kind(arguments.source.as_deref());
    let source = source::open(&kind, arguments.pace.opening())?;
    refuse_pace_of_live_source(&kind, &arguments.pace)?;
    let optics = Optics::new(&arguments.optics.lens.geometry)?;
    let camera = camera_name(arguments.camera.as_deref().unwrap_or(kind.default_camera()))?;
    let record = recording_to_make(&arguments, &kind, &camera)?;

    let engine = Engine::start(&arguments.engine)?;
    let loaded = engine.load(&arguments.model, &arguments.every)?;
    let model = ModelName { name: loaded.name(), hash: loaded.hash() };
    let pipeline = tested_pipeline(loaded, &arguments.optics)?;
    let provider = pipeline.graph().provider().to_string();

    let options = OutletOptions {
        camera: &camera,
        frame_id: arguments.frame_id.as_deref(),
        publish: &arguments.publish,
        limits: limits(arguments.readers),
        model: &model.name,
    };
    let outlet = Outlet::open(&pipeline, &options)?;
    let collector = arguments.out.map(|folder| Collector::attach(folder, &camera, &outlet)).transpose()?;
    let about = About {
        camera: camera.as_str(),
        frame_id: arguments.frame_id.as_deref(),
        mount: arguments.recording.mount.mount,
        model: &model,
        provider: &provider,
        force: arguments.recording.force,
    };
    let recorder =
        record.as_deref().map(|path| Recorder::start(FrameWriter::create(path, &about)?, &camera, &outlet));
    let recorder = recorder.transpose()?;
    let metrics = arguments.metrics.map(|address| Metrics::serve(address, camera.as_str())).transpose()?;
    let worker = Worker::new(pipeline, optics, outlet, recorder, metrics);
    let pace = Pace { rate: arguments.pace.rate.unwrap_or(Rate::Max), limit: arguments.pace.frames };
    let Ended { counts, remains, source: source_end } = stream::run(source, worker, pace, stop)?;

    let stats = Stats::new(
        camera.to_string(),
        model,
        provider,
        remains.scale,
        counts,
        &remains.totals,
        &remains.latencies,
    );
    if let Some(path) = &arguments.stats_json {
        write_json(path, &stats)?;
    }
    let outcome = say_how_it_ended(&counts, source_end, remains.recording);
    if let Some(collector) = collector {
        collector.write(&remains.outlet)?;
    }
    Ok(outcome)
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

/// Frames that a newer one replaced are the policy of a live source; failed ones are a loss.
fn say_how_it_ended(counts: &Counts, source: SourceEnd, recording: Option<Tally>) -> Outcome {
    let Counts { captured, published, superseded, failed, in_flight: _ } = counts;
    info!("{captured} frames captured: {published} published, {superseded} superseded, {failed} failed");
    if *failed > 0 {
        warn!("{failed} frames were lost");
    }
    let recorded = recording.is_none_or(Tally::say);
    if *failed == 0 && source == SourceEnd::Whole && recorded { Outcome::Done } else { Outcome::Lost }
}

/// The file that `--record` means, refused before any work is done where it may not be written.
fn recording_to_make(
    arguments: &RunArgs,
    kind: &Kind,
    camera: &CameraName,
) -> anyhow::Result<Option<PathBuf>> {
    let Some(path) = &arguments.recording.record else { return Ok(None) };
    let path = recording_path(path, camera.as_str(), unix_nanos());
    let input = if let Kind::Recording(input) = kind { Some(input.as_path()) } else { None };
    refuse_output(&path, input, arguments.recording.force)?;
    Ok(Some(path))
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
