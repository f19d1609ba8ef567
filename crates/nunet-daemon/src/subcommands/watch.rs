//! `nunetd watch`: shows what a running daemon publishes, for people and for scripts.

use std::io::{IsTerminal as _, Write as _};
use std::num::NonZeroU64;
use std::time::{Duration, Instant};

use anyhow::{anyhow, bail};
use console::Term;
use nunet_ipc::{
    CameraName, Frame, FrameHeader, IpcError, Reader, StatsRecord, Topic, Units, cameras, monotonic_nanos,
    unix_nanos,
};
use serde_json::{Map, Value, json};

use crate::Outcome;
use crate::exit::BadArguments;
use crate::stream::Stop;

/// The longest single wait, so that a stop is noticed.
const GLANCE: Duration = Duration::from_millis(100);
/// How long the first frame waits for the stats, which arrive with the next frame or when a late reader is served.
const FIRST_STATS: Duration = Duration::from_millis(500);
/// How often it checks for them.
const FIRST_STATS_PERIOD: Duration = Duration::from_millis(5);
/// The most cameras that an error lists.
const MOST_NAMES: usize = 8;
/// How often the view is redrawn.
const REDRAW: Duration = Duration::from_millis(200);

/// Follows the camera until `--frames` are seen, a stop is requested, or no frame arrives within `--timeout`.
pub(crate) fn watch(
    camera: &CameraName,
    json: bool,
    frames: Option<NonZeroU64>,
    timeout_s: f64,
) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    let timeout = Duration::try_from_secs_f64(timeout_s)
        .map_err(|_| BadArguments(format!("--timeout `{timeout_s}` is not a number of seconds")))?;
    let Some(reader) = open(camera, timeout, &stop)? else { return Ok(Outcome::Done) };
    let mut watcher = Watcher { reader, stats: None, timeout, last: Instant::now() };
    let mut view = View::choose(json);
    let mut left = frames.map_or(u64::MAX, NonZeroU64::get);
    while left > 0 && !stop.requested() {
        if let Some(frame) = watcher.next()? {
            left -= 1;
            view.show(camera, &frame, &watcher.stats.unwrap_or_default())?;
        }
    }
    Ok(Outcome::Done)
}

/// Waits for the camera in short steps; `None` if a stop was requested.
fn open(camera: &CameraName, timeout: Duration, stop: &Stop) -> anyhow::Result<Option<Reader>> {
    let start = Instant::now();
    while !stop.requested() {
        let turn = GLANCE.min(timeout.saturating_sub(start.elapsed()));
        match Reader::open(camera, &[Topic::Depth, Topic::Stats], turn) {
            Ok(reader) => return Ok(Some(reader)),
            Err(IpcError::NobodyPublishes { .. }) if start.elapsed() < timeout => {}
            Err(IpcError::NobodyPublishes { service, .. }) => {
                return Err(nobody(camera, &IpcError::NobodyPublishes { service, timeout }));
            }
            Err(error) => return Err(error.into()),
        }
    }
    Ok(None)
}

/// The error for a camera that is not published; lists the published ones, the most similar name first.
fn nobody(camera: &CameraName, error: &IpcError) -> anyhow::Error {
    let mut there = cameras::list(Topic::Depth).unwrap_or_default();
    there.retain(|other| other != camera);
    if there.is_empty() {
        return anyhow!(nunet_types::text_with_hint(error));
    }
    let likeness = |other: &CameraName| strsim::jaro_winkler(other.as_str(), camera.as_str());
    there.sort_by(|a, b| likeness(b).total_cmp(&likeness(a)));
    let names: Vec<_> = there.iter().take(MOST_NAMES).map(|name| format!("`{name}`")).collect();
    let more = if there.len() > names.len() { " and others" } else { "" };
    anyhow!("{error}\nhint: published cameras: {}{more}", names.join(", "))
}

struct Watcher {
    reader: Reader,
    stats: Option<StatsRecord>,
    timeout: Duration,
    last: Instant,
}

impl Watcher {
    /// The next frame; `None` if none arrived in time.
    fn next(&mut self) -> anyhow::Result<Option<Frame>> {
        let mut frame = self.reader.next(Topic::Depth)?;
        if frame.is_none() {
            self.reader.wait(GLANCE)?;
            frame = self.reader.next(Topic::Depth)?;
        }
        if frame.is_some() {
            self.last = Instant::now();
            self.follow_stats()?;
        } else if self.last.elapsed() >= self.timeout {
            bail!(
                "no frame for {} s: {}",
                self.timeout.as_secs_f64(),
                if self.reader.is_connected() { "the source is paused" } else { "the daemon is gone" }
            );
        }
        Ok(frame)
    }

    /// The stats of a frame arrive after it, so the known ones are of the previous frame or newer. The first frame waits for
    /// them, because stages have no names without them.
    fn follow_stats(&mut self) -> anyhow::Result<()> {
        let start = Instant::now();
        loop {
            if let Some(message) = self.reader.latest(Topic::Stats)? {
                self.stats = Some(*message.stats()?);
            }
            if self.stats.is_some() || start.elapsed() >= FIRST_STATS {
                return Ok(());
            }
            std::thread::sleep(FIRST_STATS_PERIOD);
        }
    }
}

/// The output format.
enum View {
    Json,
    Lines,
    Screen { term: Term, drawn: Option<Instant>, lines: usize },
}

impl View {
    fn choose(json: bool) -> Self {
        if json {
            Self::Json
        } else if std::io::stdout().is_terminal() {
            Self::Screen { term: Term::stdout(), drawn: None, lines: 0 }
        } else {
            Self::Lines
        }
    }

    fn show(&mut self, camera: &CameraName, frame: &Frame, stats: &StatsRecord) -> anyhow::Result<()> {
        match self {
            Self::Json => writeln!(std::io::stdout(), "{}", json_of(frame, stats)?)?,
            Self::Lines => writeln!(std::io::stdout(), "{}", line_of(frame)?)?,
            Self::Screen { term, drawn, lines } => {
                if drawn.is_none_or(|last| last.elapsed() >= REDRAW) {
                    *drawn = Some(Instant::now());
                    let text = screen_of(camera, frame, stats)?;
                    term.clear_last_lines(*lines)?;
                    *lines = text.lines().count();
                    term.write_str(&text)?;
                }
            }
        }
        Ok(())
    }
}

/// Milliseconds since the image was taken; `None` if its capture time is unknown.
fn age_ms(header: &FrameHeader) -> Option<f64> {
    header.age_nanos(monotonic_nanos(), unix_nanos()).map(|nanos| nanos as f64 / 1e6)
}

fn age_of(header: &FrameHeader) -> String {
    age_ms(header).map_or_else(|| "unknown".to_owned(), |age| format!("{age:.1} ms"))
}

/// Depth at the center of the image; `None` if there is no measurement.
fn depth_center(frame: &Frame) -> anyhow::Result<Option<f32>> {
    let (width, height) = (frame.header().width as usize, frame.header().height as usize);
    let depth = frame.depth()?.get(height / 2 * width + width / 2).copied();
    Ok(depth.filter(|value| value.is_finite()))
}

fn json_of(frame: &Frame, stats: &StatsRecord) -> anyhow::Result<Value> {
    let header = frame.header();
    let metric = header.units()? == Units::Metre;
    let stages: Map<_, _> =
        stats.stage_names().zip(header.stages()).map(|(name, us)| (name.into_owned(), json!(us))).collect();
    Ok(json!({
        "contract": header.contract_version,
        "sequence": header.sequence,
        "capture_nanos": header.capture_nanos,
        "age_ms": age_ms(header),
        "quality": header.quality()?.name(),
        "units": header.units()?.name(),
        "scale_source": header.scale_source()?.name(),
        "depth_center_m": depth_center(frame)?.filter(|_| metric),
        "invalid_pixels": header.invalid_pixels,
        "bytes_copied": header.bytes_copied,
        "stages": stages,
        "frames": {
            "captured": stats.captured,
            "published": stats.published,
            "superseded": stats.superseded,
            "failed": stats.failed,
            "in_flight": stats.in_flight,
        },
    }))
}

fn center_of(frame: &Frame) -> anyhow::Result<String> {
    let unit = if frame.header().units()? == Units::Metre { " m" } else { " (no unit)" };
    Ok(depth_center(frame)?.map_or_else(|| "none".to_owned(), |depth| format!("{depth:.3}{unit}")))
}

fn line_of(frame: &Frame) -> anyhow::Result<String> {
    let header = frame.header();
    Ok(format!(
        "frame {} age {} center {} quality {}",
        header.sequence,
        age_of(header),
        center_of(frame)?,
        header.quality()?.name()
    ))
}

fn screen_of(camera: &CameraName, frame: &Frame, stats: &StatsRecord) -> anyhow::Result<String> {
    let header = frame.header();
    let mut text = format!(
        "camera {camera} · {} on {} · {}x{} · {:.1} frames/s\n\
         frame {} · age {} · center {} · scale {} · quality {}\n\
         captured {} = published {} + superseded {} + failed {} + in flight {}\n\
         copied {} bytes · without depth {} pixels\n\
         {:<14} {:>9} {:>9} {:>9} {:>9}\n",
        stats.model_name(),
        stats.provider(),
        header.width,
        header.height,
        stats.fps,
        header.sequence,
        age_of(header),
        center_of(frame)?,
        header.scale_source()?.name(),
        header.quality()?.name(),
        stats.captured,
        stats.published,
        stats.superseded,
        stats.failed,
        stats.in_flight,
        header.bytes_copied,
        header.invalid_pixels,
        "stage, ms",
        "p50",
        "p90",
        "p99",
        "max"
    );
    for (index, name) in stats.stage_names().enumerate() {
        let quantiles = [stats.stage_p50_us, stats.stage_p90_us, stats.stage_p99_us, stats.stage_max_us];
        text += &row_of(&name, quantiles.map(|all| all[index]));
    }
    text +=
        &row_of("total", [stats.total_p50_us, stats.total_p90_us, stats.total_p99_us, stats.total_max_us]);
    Ok(text)
}

fn row_of(name: &str, micros: [f64; 4]) -> String {
    let cells: String = micros.iter().map(|us| format!(" {:>9.2}", us / 1e3)).collect();
    format!("{name:<14}{cells}\n")
}
