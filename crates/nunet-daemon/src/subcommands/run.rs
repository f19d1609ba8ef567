//! `nunetd run`: sources of frames become depth in shared memory.

mod camera;
mod outputs;

use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use nunet_ipc::{Access, IpcError, share_with};
use tracing::{error, info};

use self::camera::span_of;
use self::outputs::Outputs;
use crate::Outcome;
use crate::cli::{AccessArgs, RunArgs};
use crate::engine::{Engine, check_threads, tested_pipelines};
use crate::exit::BadArguments;
use crate::sink::metrics::Metrics;
use crate::sink::patience::Patience;
use crate::sink::recording::Tally;
use crate::sink::stats::{Common, ModelName, Stats, write_json};
use crate::sink::writing::Writing;
use crate::stream::{self, Bell, Ended, Remains, SourceEnd, Stop, Stopped};
use crate::telemetry::Counts;

/// Runs until all sources have ended, `--frames` of each are captured, or a signal comes.
pub(super) fn run(arguments: RunArgs) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    match start(&arguments, &stop) {
        Err(error) if error.is::<Stopped>() => {
            info!("{error}");
            Ok(Outcome::Done)
        }
        outcome => outcome,
    }
}

/// Everything before the first frame may take long, so that a stop is asked for before each step.
fn start(arguments: &RunArgs, stop: &Stop) -> anyhow::Result<Outcome> {
    share(&arguments.access)?;
    let cameras = camera::prepare(camera::plans(arguments)?, stop)?;
    let outputs = Outputs::of(&cameras, arguments.stats_json.as_deref());
    outputs.check()?;

    stop.check()?;
    let engine = Engine::start(&arguments.engine)?;
    let loaded = engine.load_unless(&arguments.model, &arguments.every, stop)?;
    stop.check()?;
    let model = ModelName { name: loaded.name(), hash: loaded.hash() };
    let pipelines = tested_pipelines(loaded, arguments.streams().map(|stream| &stream.optics))?;
    let graph = pipelines.first().context("one camera at least")?.graph();
    let (provider, classes) = (graph.provider().to_string(), graph.description().classes.clone());
    let common = Common { model: &model, provider: &provider, classes: &classes };

    let names: Vec<String> = cameras.iter().map(|camera| camera.plan.name.to_string()).collect();
    let shown: Vec<&str> = names.iter().map(String::as_str).collect();
    let several = names.len() > 1;
    let cameras = cameras.into_iter().zip(pipelines);
    let cameras = cameras.map(|(camera, pipeline)| camera.open(pipeline, common, several, stop));
    let cameras = cameras.collect::<anyhow::Result<Vec<_>>>()?;
    let metrics = arguments.metrics.map(|address| Metrics::serve(address, &shown)).transpose()?;
    let mut metrics = metrics.into_iter().flatten();
    // Last of all: a start that fails leaves no folders and no recordings. After the first recording a stop is one of the
    // stream's.
    stop.check()?;
    outputs.make()?;
    let bell = Arc::new(Bell::default());
    let streams = cameras.into_iter().map(|camera| camera.start(common, metrics.next(), &bell));
    let streams = streams.collect::<anyhow::Result<Vec<_>>>()?;

    let ended = stream::run(streams, &bell, stop)?;
    let stopped = || stop.requested();
    finish(&names, ended, common, arguments.stats_json.as_deref(), &mut Patience::new(&stopped))
}

/// What can be said of the arguments before anything is opened or made. `nunetd config` says it too.
pub(super) fn check(arguments: &RunArgs) -> anyhow::Result<()> {
    access(&arguments.access)?;
    check_threads(arguments.engine.threads)?;
    camera::plans(arguments).map(drop)
}

/// Lets a group read, where one is named. Which files it gets is for the crate that makes them.
fn share(arguments: &AccessArgs) -> anyhow::Result<()> {
    Ok(access(arguments)?.map_or(Ok(()), share_with)?)
}

fn access(arguments: &AccessArgs) -> Result<Option<Access>, BadArguments> {
    let Some(group) = &arguments.access_group else { return Ok(None) };
    let bad = |error: IpcError| BadArguments(nunet_types::text_with_hint(&error));
    let access = Access::of_group(group).map_err(bad)?;
    arguments.access_mode.map_or(Ok(access), |mode| access.with_mode(mode).map_err(bad)).map(Some)
}

/// A camera's end, told.
struct End<'a> {
    camera: &'a str,
    counts: Counts,
    error: Option<String>,
    remains: Remains,
}

/// Tells how it ended and writes the figures, also where all cameras have failed.
fn finish(
    names: &[String],
    ended: Vec<Ended>,
    common: Common<'_>,
    stats_json: Option<&Path>,
    patience: &mut Patience<'_>,
) -> anyhow::Result<Outcome> {
    let (ends, outcome) = conclude(names, ended, patience);
    let written = stats_json.map_or(Ok(()), |path| write_figures(path, figures(&ends, common)?, patience));
    let files = ends.into_iter().map(|end| {
        let writing = end.remains.files?;
        writing.map_or(Ok(()), |writing| writing.end(patience))
    });
    let problems = std::iter::once(written).chain(files).filter_map(Result::err);
    // All of them, before anything is returned: what is not waited for is not written.
    let mut problems = problems.collect::<Vec<_>>().into_iter();
    let result = match outcome {
        Ok(outcome) => problems.next().map_or(Ok(outcome), Err),
        failure => failure,
    };
    problems.for_each(|problem| error!("{problem:#}"));
    result
}

/// The disk of the figures may be the one that hangs.
fn write_figures(path: &Path, stats: Stats, patience: &mut Patience<'_>) -> anyhow::Result<()> {
    let (what, path) = (format!("the figures in `{}`", path.display()), path.to_owned());
    Writing::start(what, move || write_json(&path, &stats))?.end(patience)
}

/// Says how each camera ended. One whose source failed leaves the others; where none is left, that is the failure.
fn conclude<'a>(
    names: &'a [String],
    ended: Vec<Ended>,
    patience: &mut Patience<'_>,
) -> (Vec<End<'a>>, anyhow::Result<Outcome>) {
    let several = names.len() > 1;
    let all_failed = ended.iter().all(|ended| ended.source.is_err());
    let (mut ends, mut outcome, mut failure) = (Vec::new(), Outcome::Done, None);
    for (camera, Ended { counts, mut remains, source }) in names.iter().zip(ended) {
        let _camera = span_of(camera, several).entered();
        let recording = remains.recording.take().map(|ending| ending.tally(patience));
        let (source, reason) = match source {
            Ok(end) => (end, None),
            Err(reason) => (SourceEnd::Cut, Some(reason)),
        };
        let error = reason.as_ref().map(|reason| format!("{reason:#}"));
        if say_how_it_ended(&counts, source, recording) == Outcome::Lost {
            outcome = Outcome::Lost;
        }
        match reason {
            Some(reason) if all_failed && failure.is_none() => failure = Some(reason),
            Some(reason) => error!("camera `{camera}` has failed: {reason:#}"),
            None => {}
        }
        ends.push(End { camera, counts, error, remains });
    }
    (ends, failure.map_or(Ok(outcome), Err))
}

/// Frames that a newer one replaced are the policy of a live source; failed ones are a loss. What sets the exit code is an
/// error, so that it is told with `-q` as well.
fn say_how_it_ended(counts: &Counts, source: SourceEnd, recording: Option<Tally>) -> Outcome {
    let Counts { captured, published, superseded, failed, in_flight: _ } = counts;
    info!("{captured} frames captured: {published} published, {superseded} superseded, {failed} failed");
    if *failed > 0 {
        error!("{failed} of {captured} frames were lost");
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use anyhow::anyhow;
    use nunet_core::depth::{Scale, ScaleSource, Units};
    use serde_json::Value;

    use super::*;
    use crate::telemetry::{Latencies, Totals};

    fn broken(published: u64, why: &'static str) -> Ended {
        let remains = Remains {
            scale: Scale { units: Units::Metre, source: ScaleSource::Metric, focal_factor: 1.0 },
            totals: Totals::default(),
            latencies: Latencies::new(["queue"]),
            recording: None,
            files: Ok(None),
        };
        let counts = Counts { captured: published + 1, published, failed: 1, ..Counts::default() };
        Ended { counts, remains, source: Err(anyhow!(why)) }
    }

    /// As `run` has it, without a stop.
    fn finished(
        names: &[&str],
        ended: Vec<Ended>,
        common: Common<'_>,
        path: &Path,
    ) -> anyhow::Result<Outcome> {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        finish(&names, ended, common, Some(path), &mut Patience::new(&|| false))
    }

    #[test]
    fn the_figures_of_cameras_that_all_broke_on_the_way_are_written_before_that_is_the_failure() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stats.json");
        let model = ModelName { name: "model.onnx".into(), hash: "00".into() };
        let common = Common { model: &model, provider: "cpu", classes: &[] };
        let ended = vec![broken(7, "another contract"), broken(5, "stdin's thread has failed")];
        let failure = finished(&["front", "rear"], ended, common, &path).unwrap_err();
        assert_eq!(failure.to_string(), "another contract");
        let stats: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!((&stats["frames"]["published"], &stats["frames"]["failed"]), (&12.into(), &2.into()));
        assert_eq!(stats["cameras"][0]["error"], "another contract");
        assert_eq!(stats["cameras"][1]["error"], "stdin's thread has failed");

        let failure = finished(&["front"], vec![broken(7, "gone")], common, &path).unwrap_err();
        assert_eq!(failure.to_string(), "gone");
        let stats: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!((&stats["camera"], &stats["error"]), (&"front".into(), &"gone".into()));
    }

    #[test]
    fn figures_that_cannot_be_written_do_not_hide_why_the_cameras_failed() {
        let model = ModelName { name: "model.onnx".into(), hash: "00".into() };
        let common = Common { model: &model, provider: "cpu", classes: &[] };
        let path = Path::new("/nonexistent/stats.json");
        let failure = finished(&["front"], vec![broken(7, "gone")], common, path).unwrap_err();
        assert_eq!(failure.to_string(), "gone");
    }

    #[test]
    fn files_whose_disk_hangs_are_told_of_after_the_figures_and_do_not_keep_those_of_other_cameras() {
        let folder = tempfile::tempdir().unwrap();
        let (path, slow) = (folder.path().join("stats.json"), folder.path().join("slow"));
        let model = ModelName { name: "model.onnx".into(), hash: "00".into() };
        let common = Common { model: &model, provider: "cpu", classes: &[] };
        let (let_go, hangs) = std::sync::mpsc::channel::<()>();
        let hanging = Writing::start("the files in `o`".into(), move || Ok(hangs.recv()?));
        let file = slow.clone();
        let slowly = Writing::start("the files in `p`".into(), move || {
            std::thread::sleep(Duration::from_millis(100));
            Ok(std::fs::write(file, "")?)
        });
        let ended = [hanging, slowly].map(|writing| {
            let ended = broken(7, "");
            let remains = Remains { files: writing.map(Some), ..ended.remains };
            Ended { remains, source: Ok(SourceEnd::Whole), ..ended }
        });
        let mut patience = Patience::with(&|| true, Duration::ZERO, Duration::from_secs(60));
        let names = ["front".to_owned(), "rear".to_owned()];
        let failure = finish(&names, ended.into(), common, Some(&path), &mut patience).unwrap_err();
        assert!(failure.to_string().starts_with("cannot write the files in `o`: "), "{failure}");
        let stats: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(stats["frames"]["published"], 14);
        assert!(slow.is_file(), "the other camera's files were not waited for");
        drop(let_go);
    }
}
