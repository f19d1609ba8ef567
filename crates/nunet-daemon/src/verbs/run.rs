//! `nunetd run`: sources of frames become depth in shared memory.

mod camera;

use anyhow::Context as _;
use nunet_ipc::{Access, IpcError, share_with};
use tracing::{error, info, warn};

use self::camera::{Plan, span_of};
use crate::Outcome;
use crate::cli::{AccessArgs, RunArgs};
use crate::engine::{Engine, tested_pipelines};
use crate::exit::BadArguments;
use crate::sink::metrics::Metrics;
use crate::sink::recording::{Ending, Tally};
use crate::sink::stats::{Common, ModelName, Stats, check_writable, write_json};
use crate::stream::{self, Ended, Remains, SourceEnd, Stop};
use crate::telemetry::Counts;

/// Runs until all sources have ended, `--frames` of each are captured, or a signal comes.
pub(super) fn run(arguments: RunArgs) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    share(&arguments.access)?;
    let plans = arguments.streams().map(Plan::new).collect::<anyhow::Result<Vec<_>>>()?;
    camera::refuse_shared(&plans)?;
    arguments.stats_json.as_deref().map_or(Ok(()), check_writable)?;
    let cameras = camera::prepare(plans)?;

    let engine = Engine::start(&arguments.engine)?;
    let loaded = engine.load(&arguments.model, &arguments.every)?;
    let model = ModelName { name: loaded.name(), hash: loaded.hash() };
    let pipelines = tested_pipelines(loaded, arguments.streams().map(|stream| &stream.optics))?;
    let provider = pipelines.first().context("one camera at least")?.graph().provider().to_string();
    let common = Common { model: &model, provider: &provider };

    let names: Vec<String> = cameras.iter().map(|camera| camera.plan.name.to_string()).collect();
    let shown: Vec<&str> = names.iter().map(String::as_str).collect();
    let metrics = arguments.metrics.map(|address| Metrics::serve(address, &shown)).transpose()?;
    let mut metrics = metrics.into_iter().flatten();
    let streams = cameras
        .into_iter()
        .zip(pipelines)
        .map(|(camera, pipeline)| camera.start(pipeline, common, metrics.next(), names.len() > 1));
    let streams = streams.collect::<anyhow::Result<Vec<_>>>()?;

    let ended = stream::run(streams, &stop)?;
    let (ends, outcome) = conclude(&names, ended)?;
    if let Some(path) = &arguments.stats_json {
        write_json(path, &figures(&ends, common)?)?;
    }
    ends.into_iter().try_for_each(|end| end.remains.files)?;
    Ok(outcome)
}

/// Lets a group read, where one is named. Which files it gets is for the crate that makes them.
fn share(arguments: &AccessArgs) -> anyhow::Result<()> {
    let Some(group) = &arguments.access_group else { return Ok(()) };
    let bad = |error: IpcError| BadArguments(error.to_string());
    let access = Access::of_group(group).map_err(bad)?;
    let access = match arguments.access_mode {
        Some(mode) => access.with_mode(mode).map_err(bad)?,
        None => access,
    };
    Ok(share_with(access)?)
}

/// A camera's end, told.
struct End<'a> {
    camera: &'a str,
    counts: Counts,
    error: Option<String>,
    remains: Remains,
}

/// Says how each camera ended. One whose source failed leaves the others; where none is left, that is the failure.
fn conclude(names: &[String], ended: Vec<Ended>) -> anyhow::Result<(Vec<End<'_>>, Outcome)> {
    let several = names.len() > 1;
    let all_failed = ended.iter().all(|ended| ended.source.is_err());
    let (mut ends, mut outcome, mut failure) = (Vec::new(), Outcome::Done, None);
    for (camera, Ended { counts, mut remains, source }) in names.iter().zip(ended) {
        let _camera = span_of(camera, several).entered();
        let recording = remains.recording.take().map(Ending::tally);
        let (source, reason) = match source {
            Ok(end) => (end, None),
            Err(reason) => (SourceEnd::Cut, Some(reason)),
        };
        let error = reason.as_ref().map(|reason| format!("{reason:#}"));
        match reason {
            Some(reason) if all_failed && failure.is_none() => failure = Some(reason),
            Some(reason) => error!("camera `{camera}` has failed: {reason:#}"),
            None => {}
        }
        if failure.is_none() && say_how_it_ended(&counts, source, recording) == Outcome::Lost {
            outcome = Outcome::Lost;
        }
        ends.push(End { camera, counts, error, remains });
    }
    failure.map_or(Ok((ends, outcome)), Err)
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

/// Of the camera, or of all together where there are several.
fn figures(ends: &[End<'_>], common: Common<'_>) -> anyhow::Result<Stats> {
    let of = |End { camera, counts, error, remains }: &End<'_>| {
        let Remains { scale, totals, latencies, .. } = remains;
        let stats = Stats::new((*camera).to_owned(), common, *scale, *counts, totals, latencies);
        Stats { error: error.clone(), ..stats }
    };
    let (first, others) = ends.split_first().context("one camera at least")?;
    if others.is_empty() {
        return Ok(of(first));
    }
    let (mut totals, mut latencies) = (first.remains.totals.clone(), first.remains.latencies.clone());
    for other in others {
        totals.join(&other.remains.totals);
        latencies.join(&other.remains.latencies);
    }
    Ok(Stats::of_all(ends.iter().map(of).collect(), common, first.remains.scale, &totals, &latencies))
}
