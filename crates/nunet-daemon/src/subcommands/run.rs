//! `nunetd run`: publishes depth of sources of frames in shared memory.

mod camera;
mod servers;

use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use nunet_core::pipeline::Pipeline;
use nunet_engine::Engine;
use nunet_files::{FilesError, write_json};
use nunet_ipc::{Access, IpcError, share_with};
use nunet_sink::file_writer::FileWriter;
use nunet_telemetry::{Counts, DrainTimeout};
use tracing::{error, info};

use self::camera::{output_paths, span_of};
use self::servers::Servers;
use super::load::load_unless;
use crate::Outcome;
use crate::config::{AccessConfig, Config};
use crate::exit::{BadArguments, in_camera};
use crate::sink::stats::{Common, ModelName, Stats};
use crate::source::{Notify, SourceName};
use crate::stream::{self, SourceEnd, Stop, Stopped, StreamEnd, StreamSummary};

/// Runs until all sources have ended, `--frames` of each are captured, or a stop is requested. `warn` is
/// called before the first frame, if the configuration is valid.
pub(crate) fn run(config: &Config, warn: impl FnOnce()) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    match start(config, &stop, warn) {
        Err(error) if error.is::<Stopped>() => {
            info!("{error}");
            Ok(Outcome::Done)
        }
        outcome => outcome,
    }
}

/// Each step before the first frame may take long, so a stop is checked before each.
fn start(config: &Config, stop: &Stop, warn: impl FnOnce()) -> anyhow::Result<Outcome> {
    share(config.outputs.access.as_ref())?;
    let cameras = camera::prepare(camera::plans(config)?, stop, SourceName::open)?;
    let (outputs, several) = (output_paths(&cameras, config), cameras.len() > 1);
    let of_camera = |error: FilesError, camera: &str| in_camera(error.into(), camera, several);
    outputs.check(of_camera)?;

    // Before the model, because a port in use is noticed at once.
    let servers = Servers::open(&config.outputs, cameras.len())?;
    stop.check()?;
    let (model, pipelines) = load_pipelines(config, stop)?;
    let graph = pipelines.first().context("one camera at least")?.graph();
    let (provider, classes) = (graph.provider().to_string(), graph.description().classes.clone());
    let common = Common { model: &model, provider: &provider, classes: &classes };

    let names: Vec<String> = cameras.iter().map(|camera| camera.plan.config.name.to_string()).collect();
    let cameras = cameras.into_iter().zip(pipelines);
    let cameras = cameras.map(|(camera, pipeline)| camera.open(pipeline, common, several, stop));
    let cameras = cameras.collect::<anyhow::Result<Vec<_>>>()?;
    // Last, so that a failed start leaves no folders and no recordings. From the first recording on, the
    // stream handles a stop.
    stop.check()?;
    outputs.make(of_camera)?;
    warn();
    let notify = Arc::new(Notify::default());
    let streams = cameras.into_iter().map(|camera| camera.start(common, &servers, &notify));
    let streams = streams.collect::<anyhow::Result<Vec<_>>>()?;

    let ended = stream::run(streams, &notify, stop)?;
    let stopped = || stop.requested();
    finish(&names, ended, common, config.outputs.stats_json.as_deref(), &mut DrainTimeout::new(&stopped))
}

/// One pipeline for each camera.
fn load_pipelines(config: &Config, stop: &Stop) -> anyhow::Result<(ModelName, Vec<Pipeline>)> {
    let engine = Engine::start(config.engine.clone())?;
    let loaded = load_unless(&engine, &config.model, stop)?;
    stop.check()?;
    let model = ModelName { name: loaded.name(), hash: loaded.hash() };
    let options = config.cameras.iter().map(|camera| camera.processing.pipeline);
    Ok((model, loaded.into_pipelines(options)?))
}

/// Makes all checks of `run` before its first result. Nothing is created, and no camera or pipe is read. For
/// `nunetd config`.
pub(super) fn check(config: &Config) -> anyhow::Result<()> {
    let stop = Stop::default();
    access(config.outputs.access.as_ref())?;
    config.engine.check()?;
    let cameras = camera::prepare(camera::plans(config)?, &stop, SourceName::probe)?;
    let (several, topics) = (cameras.len() > 1, &config.outputs.ros2.topics);
    output_paths(&cameras, config).check(|error, camera| in_camera(error.into(), camera, several))?;
    Servers::check(&config.outputs)?;
    let (_, pipelines) = load_pipelines(config, &stop)?;
    let mut cameras = cameras.into_iter().zip(pipelines);
    cameras.try_for_each(|(camera, pipeline)| camera.check(pipeline, topics, several))
}

/// Lets a group read, if one is configured.
fn share(config: Option<&AccessConfig>) -> anyhow::Result<()> {
    Ok(access(config)?.map_or(Ok(()), share_with)?)
}

fn access(config: Option<&AccessConfig>) -> Result<Option<Access>, BadArguments> {
    let Some(AccessConfig { group, mode }) = config else { return Ok(None) };
    let bad = |error: IpcError| BadArguments::of(&error);
    let access = Access::of_group(group).map_err(bad)?;
    mode.map_or(Ok(access), |mode| access.with_mode(mode).map_err(bad)).map(Some)
}

/// A camera after its end.
struct CameraEnd<'a> {
    camera: &'a str,
    counts: Counts,
    error: Option<String>,
    summary: StreamSummary,
}

/// Logs how each camera ended, writes the stats, and waits for the sinks; also if all cameras failed.
fn finish(
    names: &[String],
    ended: Vec<StreamEnd>,
    common: Common<'_>,
    stats_json: Option<&Path>,
    timeout: &mut DrainTimeout<'_>,
) -> anyhow::Result<Outcome> {
    let (ends, outcome) = conclude(names, ended);
    let written = stats_json.map_or(Ok(()), |path| write_stats(path, stats(&ends, common)?, timeout));
    let mut results = vec![written.map(|()| Outcome::Done)];
    let several = names.len() > 1;
    for CameraEnd { camera, summary, .. } in ends {
        let _camera = span_of(camera, several).entered();
        // Wait for all of them before returning an error: writes that are not awaited are lost.
        results.extend(summary.sinks.into_iter().map(|sink| sink.wait(timeout)));
    }
    combine(outcome, results)
}

/// The outcome of the cameras, then that of everything that was written: the first failure is returned,
/// others are logged.
fn combine(
    cameras: anyhow::Result<Outcome>,
    written: Vec<anyhow::Result<Outcome>>,
) -> anyhow::Result<Outcome> {
    let mut failure = None;
    let mut outcome = Outcome::Done;
    for result in std::iter::once(cameras).chain(written) {
        match result {
            Ok(Outcome::Done) => {}
            Ok(Outcome::Lost) => outcome = Outcome::Lost,
            Err(error) if failure.is_none() => failure = Some(error),
            Err(error) => error!("{error:#}"),
        }
    }
    failure.map_or(Ok(outcome), Err)
}

/// Writes the stats on a thread, because their disk may hang as well.
fn write_stats(path: &Path, stats: Stats, timeout: &mut DrainTimeout<'_>) -> anyhow::Result<()> {
    let (what, path) = (format!("the stats in `{}`", path.display()), path.to_owned());
    FileWriter::start(what, move || Ok(write_json(&path, &stats)?))?.end(timeout)
}

/// Logs how each camera ended. If all failed, the run fails; if some failed, the others continued.
fn conclude(names: &[String], ended: Vec<StreamEnd>) -> (Vec<CameraEnd<'_>>, anyhow::Result<Outcome>) {
    let several = names.len() > 1;
    let all_failed = ended.iter().all(|ended| ended.source.is_err());
    let (mut ends, mut outcome, mut failure) = (Vec::new(), Outcome::Done, None);
    for (camera, StreamEnd { counts, summary, source }) in names.iter().zip(ended) {
        let _camera = span_of(camera, several).entered();
        let (source, reason) = match source {
            Ok(end) => (end, None),
            Err(reason) => (SourceEnd::Truncated, Some(reason)),
        };
        let error = reason.as_ref().map(|reason| format!("{reason:#}"));
        if log_counts(&counts, source) == Outcome::Lost {
            outcome = Outcome::Lost;
        }
        match reason {
            Some(reason) if all_failed && failure.is_none() => failure = Some(reason),
            Some(reason) => error!("camera `{camera}` failed: {reason:#}"),
            None => {}
        }
        ends.push(CameraEnd { camera, counts, error, summary });
    }
    (ends, failure.map_or(Ok(outcome), Err))
}

/// Superseded frames of a live source are normal; failed ones are a loss. What sets the exit code is logged
/// as an error, so that `-q` shows it.
fn log_counts(counts: &Counts, source: SourceEnd) -> Outcome {
    let Counts { captured, published, superseded, failed, in_flight: _ } = counts;
    let frames = nunet_types::counted(*captured, "frame");
    info!("{frames} captured: {published} published, {superseded} superseded, {failed} failed");
    if *failed > 0 {
        error!("lost {failed} of {frames}");
    }
    if *failed == 0 && source != SourceEnd::Truncated { Outcome::Done } else { Outcome::Lost }
}

/// The stats of the camera, or of all together if there are several.
fn stats(ends: &[CameraEnd<'_>], common: Common<'_>) -> anyhow::Result<Stats> {
    let of = |CameraEnd { camera, counts, error, summary }: &CameraEnd<'_>| {
        let StreamSummary { scale, view, totals, latencies, messages, .. } = summary;
        let stats = Stats::new((*camera).to_owned(), common, *scale, *counts, totals, latencies);
        let stats = stats.with_view(*view);
        let messages = messages.iter().map(|(output, counts)| (*output, counts.into())).collect();
        Stats { messages, error: error.clone(), ..stats }
    };
    let (first, others) = ends.split_first().context("one camera at least")?;
    if others.is_empty() {
        return Ok(of(first));
    }
    let (mut totals, mut latencies) = (first.summary.totals.clone(), first.summary.latencies.clone());
    for other in others {
        totals.join(&other.summary.totals);
        latencies.join(&other.summary.latencies);
    }
    Ok(Stats::of_all(ends.iter().map(of).collect(), common, first.summary.scale, &totals, &latencies))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use anyhow::anyhow;
    use nunet_core::depth::{Scale, ScaleSource, Units};
    use nunet_telemetry::{Latencies, Totals};
    use serde_json::Value;

    use super::*;
    use crate::sink::FinishingSink;

    fn broken(published: u64, why: &'static str) -> StreamEnd {
        let summary = StreamSummary {
            scale: Scale { units: Units::Metre, source: ScaleSource::Metric, factor: 1.0, age_nanos: 0 },
            view: nunet_types::PixelRect::default(),
            totals: Totals::default(),
            latencies: Latencies::new(["queue"]),
            messages: Vec::new(),
            sinks: Vec::new(),
            failure: None,
        };
        let counts = Counts { captured: published + 1, published, failed: 1, ..Counts::default() };
        StreamEnd { counts, summary, source: Err(anyhow!(why)) }
    }

    /// As `run` has it, without a stop.
    fn finished(
        names: &[&str],
        ended: Vec<StreamEnd>,
        common: Common<'_>,
        path: &Path,
    ) -> anyhow::Result<Outcome> {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        finish(&names, ended, common, Some(path), &mut DrainTimeout::new(&|| false))
    }

    #[test]
    fn the_stats_of_cameras_that_all_failed_are_written_before_the_failure_is_returned() {
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
    fn stats_that_cannot_be_written_do_not_hide_why_the_cameras_failed() {
        let model = ModelName { name: "model.onnx".into(), hash: "00".into() };
        let common = Common { model: &model, provider: "cpu", classes: &[] };
        let path = Path::new("/nonexistent/stats.json");
        let failure = finished(&["front"], vec![broken(7, "gone")], common, path).unwrap_err();
        assert_eq!(failure.to_string(), "gone");
    }

    #[test]
    fn files_whose_disk_hangs_hold_up_neither_the_stats_nor_the_files_of_other_cameras() {
        let folder = tempfile::tempdir().unwrap();
        let (path, slow) = (folder.path().join("stats.json"), folder.path().join("slow"));
        let model = ModelName { name: "model.onnx".into(), hash: "00".into() };
        let common = Common { model: &model, provider: "cpu", classes: &[] };
        let (let_go, hangs) = std::sync::mpsc::channel::<()>();
        let hanging = FileWriter::start("the files in `o`".into(), move || Ok(hangs.recv()?));
        let file = slow.clone();
        let slowly = FileWriter::start("the files in `p`".into(), move || {
            std::thread::sleep(Duration::from_millis(100));
            Ok(std::fs::write(file, "")?)
        });
        let ended = [hanging, slowly].map(|writing| {
            let ended = broken(7, "");
            let sink = FinishingSink::new(move |timeout| writing?.end(timeout).map(|()| Outcome::Done));
            let summary = StreamSummary { sinks: vec![sink], ..ended.summary };
            StreamEnd { summary, source: Ok(SourceEnd::Complete), ..ended }
        });
        let mut timeout = DrainTimeout::with(&|| true, Duration::ZERO, Duration::from_secs(60));
        let names = ["front".to_owned(), "rear".to_owned()];
        let failure = finish(&names, ended.into(), common, Some(&path), &mut timeout).unwrap_err();
        assert!(failure.to_string().starts_with("cannot write the files in `o`: "), "{failure}");
        let stats: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(stats["frames"]["published"], 14);
        assert!(slow.is_file(), "the other camera's files were not waited for");
        drop(let_go);
    }
}
