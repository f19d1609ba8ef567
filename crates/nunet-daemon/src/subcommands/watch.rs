//! `nunetd watch`: prints what a running daemon publishes, as text or JSON.

use std::io::IsTerminal as _;
use std::num::NonZeroU64;
use std::time::{Duration, Instant};

use anyhow::bail;
use console::Term;
use nunet_ipc::{CameraName, IpcError, Message, Reader, StatsRecord, Topic, cameras};

use crate::Outcome;
use crate::exit::{BadArguments, WithHint};
use crate::stream::Stop;
use nunet_sink::stdout::{StdoutError, print};
use nunet_sink::watch_text::{BesideDepth, json_of, line_of, screen_of};

/// The longest single wait, so that a stop is handled in time.
const GLANCE: Duration = Duration::from_millis(100);
/// What every output reads.
const TOPICS: [Topic; 2] = [Topic::Depth, Topic::Stats];
/// How long the first frame waits for the stats, which arrive with the next frame or when a late reader is
/// served.
const FIRST_STATS: Duration = Duration::from_millis(500);
/// How often it checks for them.
const FIRST_STATS_PERIOD: Duration = Duration::from_millis(5);
/// The most cameras that an error lists.
const MOST_NAMES: usize = 8;
/// How often the display is redrawn.
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
        .map_err(|_| BadArguments::new(format!("--timeout `{timeout_s:?}` is not a number of seconds")))?;
    let mut out = Output::choose(json);
    let Some(reader) = open(camera, &out, timeout, &stop)? else { return Ok(Outcome::Done) };
    let mut watcher =
        Watcher { reader, stats: None, beside: BesideDepth::default(), timeout, last: Instant::now() };
    let mut left = frames.map_or(u64::MAX, NonZeroU64::get);
    while left > 0 && !stop.requested() {
        if let Some(frame) = watcher.next()? {
            left -= 1;
            out.show(camera, &frame, &watcher)?;
        }
    }
    Ok(Outcome::Done)
}

/// Waits for the camera; `None` if a stop was requested.
fn open(camera: &CameraName, out: &Output, timeout: Duration, stop: &Stop) -> anyhow::Result<Option<Reader>> {
    match Reader::open_unless(camera, &TOPICS, timeout, || stop.requested()) {
        Ok(reader) => out.with_more_topics(reader).map(Some),
        Err(IpcError::NobodyPublishes { .. }) if stop.requested() => Ok(None),
        Err(error @ IpcError::NobodyPublishes { .. }) => Err(nobody(camera, error)),
        Err(error) => Err(error.into()),
    }
}

/// The error for a camera that is not published; lists the published ones, the most similar name first.
fn nobody(camera: &CameraName, error: IpcError) -> anyhow::Error {
    let mut there = cameras::list(Topic::Depth).unwrap_or_default();
    there.retain(|other| other != camera);
    if there.is_empty() {
        return error.into();
    }
    let likeness = |other: &CameraName| strsim::jaro_winkler(other.as_str(), camera.as_str());
    there.sort_by(|a, b| likeness(b).total_cmp(&likeness(a)));
    let names: Vec<_> = there.iter().take(MOST_NAMES).map(|name| format!("`{name}`")).collect();
    let more = if there.len() > names.len() { " and others" } else { "" };
    WithHint::new(error.to_string(), format!("published cameras: {}{more}", names.join(", "))).into()
}

struct Watcher {
    reader: Reader,
    stats: Option<StatsRecord>,
    beside: BesideDepth,
    timeout: Duration,
    last: Instant,
}

impl Watcher {
    /// The next frame; `None` if none arrived in time.
    fn next(&mut self) -> anyhow::Result<Option<Message>> {
        let mut frame = self.reader.next(Topic::Depth)?;
        if frame.is_none() {
            self.reader.wait(GLANCE)?;
            frame = self.reader.next(Topic::Depth)?;
        }
        if frame.is_some() {
            self.last = Instant::now();
            self.follow_stats()?;
            self.follow_topics()?;
        } else if self.last.elapsed() >= self.timeout {
            bail!(
                "no frame for {} s: {}",
                self.timeout.as_secs_f64(),
                if self.reader.is_connected() { "the source is paused" } else { "the daemon has ended" }
            );
        }
        Ok(frame)
    }

    /// The stats of a frame arrive after it, so the known ones are of the previous frame or newer. The first
    /// frame waits for them, because stages have no names without them.
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

    fn follow_topics(&mut self) -> anyhow::Result<()> {
        let Self { reader, beside, .. } = self;
        for (topic, newest) in
            [(Topic::Confidence, &mut beside.confidence), (Topic::Obstacles, &mut beside.obstacles)]
        {
            if reader.topics().any(|read| read == topic)
                && let Some(found) = reader.latest(topic)?
            {
                *newest = Some(found);
            }
        }
        Ok(())
    }
}

/// The output format.
enum Output {
    Json,
    Lines,
    Screen { term: Term, drawn: Option<Instant>, lines: usize },
}

impl Output {
    fn choose(json: bool) -> Self {
        if json {
            Self::Json
        } else if std::io::stdout().is_terminal() {
            Self::Screen { term: Term::stdout(), drawn: None, lines: 0 }
        } else {
            Self::Lines
        }
    }

    /// A terminal also shows confidence and obstacles, which nunetd computes only for readers.
    fn with_more_topics(&self, reader: Reader) -> anyhow::Result<Reader> {
        let camera = reader.camera().clone();
        let is_published = |topic| cameras::list(topic).is_ok_and(|all| all.contains(&camera));
        let is_shown = |topic: &Topic| matches!(self, Self::Screen { .. }) && is_published(*topic);
        let more: Vec<_> = [Topic::Confidence, Topic::Obstacles].into_iter().filter(is_shown).collect();
        if more.is_empty() {
            return Ok(reader);
        }
        drop(reader); // first: the camera may have no place for a second one
        Ok(Reader::open(&camera, &[TOPICS.as_slice(), &more].concat(), GLANCE)?)
    }

    fn show(&mut self, camera: &CameraName, frame: &Message, watcher: &Watcher) -> anyhow::Result<()> {
        let stats = &watcher.stats.unwrap_or_default();
        match self {
            Self::Json => print(json_of(frame, stats)?)?,
            Self::Lines => print(line_of(frame)?)?,
            Self::Screen { term, drawn, lines } => {
                if drawn.is_none_or(|last| last.elapsed() >= REDRAW) {
                    *drawn = Some(Instant::now());
                    let text = screen_of(camera, frame, stats, &watcher.beside)?;
                    term.clear_last_lines(*lines).map_err(StdoutError::from)?;
                    *lines = text.lines().count();
                    term.write_str(&text).map_err(StdoutError::from)?;
                }
            }
        }
        Ok(())
    }
}
