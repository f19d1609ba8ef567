//! Images that a program writes to its standard output: any command (`exec:`), or ffmpeg for a network camera
//! (`rtsp:`).

mod child;
mod guard;
mod processes;

use std::time::{Duration, Instant};

use nunet_ipc::{Clock, monotonic_nanos};
use nunet_types::is_host_and_port;
use tracing::{debug, info, warn};

use self::child::{Ended, Ending, Running};
use crate::error::{SourceError, SourceErrorKind};
use crate::health::Health;
use crate::secret::{shown_name, without_passwords};
use crate::source::Fused;
use crate::source_type::{Properties, SizeUse, SourceType};
use crate::{Fill, Frame, OpenOptions, Source};

/// How long one call may wait, so that a stop is noticed.
const POLL_TIMEOUT: Duration = Duration::from_millis(100);
/// The longest time until the first image: a network camera has to answer.
const START_TIMEOUT: Duration = Duration::from_secs(30);
/// A program without an image for this time is started again. A slow one has the time of [`STALL_FRAMES`]
/// images.
const STALL: Duration = Duration::from_secs(10);
const STALL_FRAMES: u32 = 10;

/// A shell command.
pub(crate) struct ShellCommand;
/// A network camera, read by ffmpeg.
pub(crate) struct NetworkCamera;

const EXEC: &str = "exec:";
const RTSP: [&str; 2] = ["rtsp://", "rtsps://"];
/// The port of a URL that states none.
const RTSP_PORT: u16 = 554;

const LIVE: Properties = Properties {
    exclusive: None,
    own_pace: None,
    is_started: true,
    is_on_network: false,
    is_published: false,
    states_frame_id: false,
    has_attitude: false,
    has_topics: false,
    has_settings: false,
    size: SizeUse::None,
    no_repeat: Some("a program has no end: it is started again"),
    camera: "camera",
    default_size: None,
    default_rate: Some("max"),
};

impl SourceType for ShellCommand {
    fn is_named(&self, name: &str) -> bool {
        name.starts_with(EXEC)
    }

    fn properties(&self) -> Properties {
        Properties { size: SizeUse::Raw, ..LIVE }
    }

    fn open(&self, name: &str, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        let command = name.strip_prefix(EXEC).unwrap_or(name).trim();
        if command.is_empty() {
            return Err(SourceError::bad_arguments("`exec:` names no command")
                .with_hint("write the command after it, such as `exec:ffmpeg -i ... -f yuv4mpegpipe -`"));
        }
        let arguments = ["/bin/sh", "-c", command].map(str::to_owned).to_vec();
        Ok(Box::new(Fused::new(ProgramSource::new(
            arguments,
            format!("command `{}`", without_passwords(command)),
            options,
        ))))
    }
}

impl SourceType for NetworkCamera {
    fn is_named(&self, name: &str) -> bool {
        RTSP.iter().any(|scheme| name.starts_with(scheme))
    }

    /// A camera that can never be reached would be waited for.
    fn check(&self, name: &str) -> Result<(), SourceError> {
        if has_host(name) {
            return Ok(());
        }
        let shown = shown_name(name);
        let message =
            format!("`{shown}` has no host, or no port from 1 to 65535, expected rtsp://HOST:PORT/PATH");
        Err(SourceError::bad_arguments(message).with_hint("without a port, rtsp://HOST/PATH means 554"))
    }

    fn properties(&self) -> Properties {
        LIVE
    }

    fn open(&self, name: &str, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        let place = format!("network camera `{}`", shown_name(name));
        Ok(Box::new(Fused::new(ProgramSource::new(ffmpeg(name), place, options))))
    }
}

/// Whether a URL has a host and, if it states one, a port that can exist.
///
/// A password that is not encoded may contain `/`, `?` or `#`, where the host would end, and a path may
/// contain `@`, so both readings of the host are tried.
fn has_host(url: &str) -> bool {
    let rest = url.split_once("://").map_or("", |(_, rest)| rest);
    is_place(until_path(behind_user(rest))) || is_place(behind_user(until_path(rest)))
}

fn behind_user(text: &str) -> &str {
    text.rsplit_once('@').map_or(text, |(_, host)| host)
}

fn until_path(text: &str) -> &str {
    text.split(['/', '?', '#']).next().unwrap_or_default()
}

/// Whether a text is a host, with or without a port.
fn is_place(text: &str) -> bool {
    let has_port = text.rsplit_once(':').is_some_and(|(_, port)| !port.contains(']'));
    if has_port { is_host_and_port(text) } else { is_host_and_port(&format!("{text}:{RTSP_PORT}")) }
}

/// Reads a network camera without a queue of old images.
fn ffmpeg(url: &str) -> Vec<String> {
    let input = "ffmpeg -nostdin -loglevel warning -fflags nobuffer -flags low_delay -rtsp_transport tcp -i";
    let output = "-an -f yuv4mpegpipe -pix_fmt yuv420p -";
    input.split(' ').chain([url]).chain(output.split(' ')).map(str::to_owned).collect()
}

/// Why a program is ended.
enum Loss {
    /// Its images ended, perhaps with an error.
    Over(Option<SourceError>),
    /// It sent no image for this time.
    Silent(Duration),
}

/// A program that is started, read, and started again when it ends or falls silent.
struct ProgramSource {
    arguments: Vec<String>,
    /// What messages call it.
    name: String,
    size: Option<nunet_types::ImageSize>,
    format: Option<nunet_types::PixelFormat>,
    running: Option<Running>,
    /// The program that ran before, and why it is ended.
    ending: Option<(Ending, Loss)>,
    health: Health,
    sequence: u64,
    /// Counts starts.
    segment: u64,
    last_image: Option<Instant>,
    /// Between the last two images.
    interval: Duration,
}

impl ProgramSource {
    /// Nothing is started before the first frame is asked for.
    fn new(arguments: Vec<String>, name: String, options: OpenOptions<'_>) -> Self {
        Self {
            arguments,
            name,
            size: options.size,
            format: options.format,
            running: None,
            ending: None,
            health: Health::default(),
            sequence: 0,
            segment: 0,
            last_image: None,
            interval: Duration::ZERO,
        }
    }

    /// Starts the program when it is time to. Returns false while it is not.
    fn start(&mut self) -> Result<bool, SourceError> {
        let wait = self.health.wait(monotonic_nanos());
        if !wait.is_zero() {
            std::thread::sleep(wait.min(POLL_TIMEOUT));
            return Ok(false);
        }
        let options = OpenOptions { size: self.size, format: self.format, ..OpenOptions::default() };
        self.running = Some(Running::start(&self.arguments, &options)?);
        self.segment += 1;
        (self.last_image, self.interval) = (None, Duration::ZERO);
        Ok(true)
    }

    /// The frame as one of a live camera: it was captured when it arrived.
    fn image(&mut self, frame: &mut Frame) {
        let now = Instant::now();
        self.interval = self.last_image.map_or(Duration::ZERO, |last| now - last);
        self.last_image = Some(now);
        frame.capture.clock = Clock::Monotonic;
        frame.capture.nanos = monotonic_nanos();
        if self.health.recovers(frame.capture.nanos) {
            info!("{} is back", self.name);
        }
    }

    /// How long the program may send no image.
    fn silence_limit(&self) -> Duration {
        self.last_image.map_or(START_TIMEOUT, |_| STALL.max(self.interval * STALL_FRAMES))
    }

    fn is_silent(&self, running: &Running) -> bool {
        self.last_image.unwrap_or(running.started).elapsed() > self.silence_limit()
    }

    fn lose(&mut self, loss: Loss) -> Fill {
        self.ending = self.running.take().map(|running| (running.end(), loss));
        self.wait_for_end()
    }

    /// Waits a moment for the end of a lost program.
    fn wait_for_end(&mut self) -> Fill {
        let Some((ending, loss)) = self.ending.take() else { return Fill::Nothing };
        match (ending.wait(POLL_TIMEOUT), loss) {
            (Ok(ended), Loss::Over(why)) => self.lost(why, &ended),
            (Ok(Ended { last_line, .. }), Loss::Silent(time)) => {
                let after = match last_line.as_str() {
                    "" => String::new(),
                    line => format!("; it last wrote: {line}"),
                };
                self.report(&format!("no image for {} s{after}", time.as_secs()));
                Fill::Nothing
            }
            (Err(ending), loss) => {
                self.ending = Some((ending, loss));
                Fill::Nothing
            }
        }
    }

    /// A lost program is tried again, unless it never gave an image and never will.
    fn lost(&mut self, why: Option<SourceError>, ended: &Ended) -> Fill {
        let reason = reason(why.as_ref(), ended);
        if let Some(error) = why.filter(|error| self.sequence == 0 && !is_an_end(error)) {
            return Fill::Broken(error.context(format!("cannot read {}", self.name)));
        }
        if let Some(problem) = ended.never_starts()
            && self.sequence == 0
        {
            let message = format!("cannot run {}: {problem}", self.name);
            let error = SourceError::new(SourceErrorKind::Unavailable, message);
            return Fill::Broken(error.with_hint("try the command in a shell"));
        }
        self.report(&reason);
        Fill::Nothing
    }

    fn report(&mut self, reason: &str) {
        if self.health.fails(&without_numbers(reason), monotonic_nanos()) {
            warn!("waiting for {}: {reason}", self.name);
        } else {
            debug!("{}: {reason}", self.name);
        }
    }
}

/// Whether the images ended too early, and not with something else.
fn is_an_end(error: &SourceError) -> bool {
    matches!(error.kind(), SourceErrorKind::NothingReadable | SourceErrorKind::CutOff)
}

/// Why there are no more images.
fn reason(why: Option<&SourceError>, ended: &Ended) -> String {
    match why {
        // The program says best why it ended, and its output what is missing.
        Some(error) if is_an_end(error) => format!("{}; {error:#}", ended.reason()),
        Some(error) => format!("{error:#}"),
        None => ended.reason(),
    }
}

/// A reason without its words that have digits, for comparison: addresses, times and counts in the messages
/// of a program differ each time.
fn without_numbers(reason: &str) -> String {
    let words = reason.split(|c: char| !c.is_alphanumeric());
    let words = words.filter(|word| !word.is_empty() && !word.contains(|c: char| c.is_ascii_digit()));
    words.collect::<Vec<_>>().join(" ")
}

impl Source for ProgramSource {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        if self.ending.is_some() {
            return self.wait_for_end();
        }
        if self.running.is_none() {
            match self.start() {
                Ok(true) => {}
                Ok(false) => return Fill::Nothing,
                Err(error) if self.sequence == 0 => {
                    return Fill::Broken(error.context(format!("cannot run {}", self.name)));
                }
                Err(error) => {
                    self.report(&format!("{error:#}"));
                    return Fill::Nothing;
                }
            }
        }
        let Some(running) = &mut self.running else { return Fill::Nothing };
        let fill = running.images.fill(frame);
        if fill.had_frame() {
            frame.sequence = self.sequence;
            frame.segment = self.segment;
            self.sequence += 1;
        }
        match fill {
            Fill::Frame => {
                self.image(frame);
                Fill::Frame
            }
            Fill::Nothing => {
                if self.running.as_ref().is_some_and(|running| self.is_silent(running)) {
                    return self.lose(Loss::Silent(self.silence_limit()));
                }
                Fill::Nothing
            }
            Fill::End => self.lose(Loss::Over(None)),
            Fill::Cut(error) | Fill::Broken(error) => self.lose(Loss::Over(Some(error))),
            other => other,
        }
    }

    fn is_live(&self) -> bool {
        true
    }

    fn is_waiting(&self) -> bool {
        self.ending.is_some() || self.health.is_bad() || self.sequence == 0
    }
}

#[cfg(test)]
mod tests;
