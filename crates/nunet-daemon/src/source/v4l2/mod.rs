//! A camera of this machine, by V4L2.
//!
//! What is known of requests and mapped memory stands in [`linux`], behind the trait [`Device`]. Here is the policy:
//! which mode is taken, that the newest picture wins, what a bad one is, and that a lost camera is waited for.

mod abi;
mod device;
mod health;
mod huffman;
mod linux;
mod list;
mod negotiate;
mod trouble;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, bail};
use nunet_ipc::Clock;
use tracing::{debug, info, warn};

use self::device::{Buffer, Device, Host, Now};
use self::health::Health;
use self::linux::Linux;
pub(crate) use self::list::cameras;
pub(crate) use self::negotiate::Wish;
use self::negotiate::{Coding, Mode, choose, set};
use self::trouble::Trouble;
use super::{Capture, Fill, Frame, Source, decode_file};

/// How long one call may wait, so that a stop is seen.
const PATIENCE: Duration = Duration::from_millis(100);
/// One is read, one is filled, and two lie between: more would only make old pictures.
const BUFFERS: u32 = 4;
/// How many filled buffers are looked through for the newest, should a driver never run out of them.
const MAX_WAITING: u64 = 32;
/// A camera without a picture for so long is opened anew; slow ones have time for as many frames.
const STALL: Duration = Duration::from_secs(3);
const STALL_FRAMES: f64 = 5.0;
/// A time stamp older than this is no time of capture.
const MAX_AGE_NANOS: i64 = 10_000_000_000;

/// A camera. Once it has been opened, it is waited for whenever it goes away.
struct Video<H> {
    host: H,
    path: PathBuf,
    wish: Wish,
    stream: Option<Stream>,
    health: Health,
    sequence: u64,
    stretch: u64,
}

/// A device that was started.
struct Stream {
    device: Box<dyn Device>,
    mode: Mode,
    /// The camera's own name.
    name: String,
    /// `CLOCK_MONOTONIC` of the last buffer; `None` before we asked for any.
    last_nanos: Option<i64>,
}

/// Opens a camera of this machine.
///
/// # Errors
/// None there, no right to open it, nothing that is read here, in use.
pub(super) fn open(path: &Path, wish: Wish) -> anyhow::Result<impl Source + use<>> {
    Video::open(Linux, path, wish)
}

/// A camera of this machine that is not there yet, or cannot be used yet.
pub(super) fn wait_for(path: &Path, wish: Wish) -> impl Source + use<> {
    Video::lost(Linux, path, wish)
}

impl<H: Host> Video<H> {
    fn lost(host: H, path: &Path, wish: Wish) -> Self {
        let path = path.to_owned();
        Self { host, path, wish, stream: None, health: Health::default(), sequence: 0, stretch: 0 }
    }

    fn open(mut host: H, path: &Path, wish: Wish) -> anyhow::Result<Self> {
        let stream = Stream::open(&mut host, path, wish)
            .map_err(|trouble| trouble.with_hint(&host))
            .with_context(|| format!("cannot use the camera `{}`", path.display()))?;
        let video = Self::lost(host, path, wish);
        video.tell(&stream, "");
        Ok(Self { stream: Some(stream), ..video })
    }

    fn tell(&self, stream: &Stream, how: &str) {
        let (path, Stream { mode, name, .. }) = (self.path.display(), stream);
        if mode.fulfils(self.wish) {
            info!("camera `{path}` ({name}){how}: {mode}");
        } else {
            info!("camera `{path}` ({name}){how}: {mode}, the nearest to {}", self.wish);
        }
    }

    fn try_fill(&mut self, frame: &mut Frame) -> Result<Fill, Trouble> {
        if self.stream.is_none() && !self.try_again()? {
            return Ok(Fill::Nothing);
        }
        let Some(stream) = &mut self.stream else { return Ok(Fill::Nothing) };
        let waiting = stream.next(self.host.now())?;
        let now = self.host.now();
        let Some((buffer, count)) = waiting else {
            return if stream.has_stalled(now) { Err(Trouble::Stalled) } else { Ok(Fill::Nothing) };
        };
        stream.last_nanos = Some(now.monotonic_nanos);
        self.sequence += count;
        frame.sequence = self.sequence - 1;
        frame.stretch = self.stretch;
        frame.capture = capture(&buffer, now);
        frame.camera = None;
        let copied = stream.mode.copy(stream.device.bytes(&buffer), buffer.flawed, frame);
        // Before the slow work: the driver needs it.
        stream.device.queue(buffer).map_err(Trouble::at("give a buffer back"))?;
        Ok(match copied.and_then(|()| stream.mode.decode(frame)) {
            Ok(()) => {
                self.good();
                Fill::Frame
            }
            Err(error) => Fill::Failed(error.context(format!("a picture of `{}`", self.path.display()))),
        })
    }

    /// Opens a lost camera when it is time to; it may be another one by now. False while it is not.
    fn try_again(&mut self) -> Result<bool, Trouble> {
        let wait = self.health.wait(self.host.now().monotonic_nanos);
        if !wait.is_zero() {
            self.host.pause(wait.min(PATIENCE));
            return Ok(false);
        }
        self.stream = Some(Stream::open(&mut self.host, &self.path, self.wish)?);
        self.stretch += 1;
        Ok(true)
    }

    fn good(&mut self) {
        if self.health.recovers()
            && let Some(stream) = &self.stream
        {
            self.tell(stream, " is back");
        }
    }

    fn lose(&mut self, trouble: &Trouble) {
        // Closed first: as long as it is open, a camera that is plugged in again gets another path.
        self.stream = None;
        let (path, now) = (self.path.display(), self.host.now());
        if self.health.fails(&trouble.to_string(), now.monotonic_nanos) {
            warn!("waiting for camera `{path}`: {trouble}");
        } else {
            debug!("camera `{path}`: {trouble}");
        }
    }
}

impl<H: Host> Source for Video<H> {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        self.try_fill(frame).unwrap_or_else(|trouble| {
            self.lose(&trouble);
            Fill::Nothing
        })
    }

    fn is_live(&self) -> bool {
        true
    }

    fn is_waiting(&self) -> bool {
        self.health.is_bad()
    }
}

impl Stream {
    fn open(host: &mut dyn Host, path: &Path, wish: Wish) -> Result<Self, Trouble> {
        let mut device = host.open(path).map_err(Trouble::at("open it"))?;
        let name = list::name_of_camera(device.as_mut())?;
        let choice = choose(device.as_mut(), wish)?;
        let mode = set(device.as_mut(), choice, wish)?;
        device.start(BUFFERS).map_err(Trouble::at("start it"))?;
        Ok(Self { device, mode, name, last_nanos: None })
    }

    /// The newest picture and how many there were with it, or nothing within [`PATIENCE`].
    fn next(&mut self, now: Now) -> Result<Option<(Buffer, u64)>, Trouble> {
        let failed = Trouble::at("take a picture");
        if self.last_nanos.is_none() {
            // What was filled while the model loaded shows the past.
            self.last_nanos = Some(now.monotonic_nanos);
            if let Some((stale, _)) = newest(self.device.as_mut()).map_err(&failed)? {
                self.device.queue(stale).map_err(&failed)?;
            }
        }
        if !self.device.wait(PATIENCE).map_err(&failed)? {
            return Ok(None);
        }
        newest(self.device.as_mut()).map_err(failed)
    }

    fn has_stalled(&self, now: Now) -> bool {
        let period = Duration::from_secs_f64(self.mode.hz.map_or(0.0, |hz| (STALL_FRAMES / hz).min(3600.0)));
        let silent = now.monotonic_nanos - self.last_nanos.unwrap_or(now.monotonic_nanos);
        Duration::from_nanos(silent.max(0).unsigned_abs()) > STALL.max(period)
    }
}

/// The newest filled buffer, and how many were filled; older ones go back to the driver unseen.
fn newest(device: &mut dyn Device) -> device::Result<Option<(Buffer, u64)>> {
    let Some(mut newest) = device.dequeue()? else { return Ok(None) };
    let mut count = 1;
    while count < MAX_WAITING
        && let Some(newer) = device.dequeue()?
    {
        device.queue(std::mem::replace(&mut newest, newer))?;
        count += 1;
    }
    Ok(Some((newest, count)))
}

/// The driver's time where it can be one, else that of arrival.
fn capture(buffer: &Buffer, now: Now) -> Capture {
    let arrived = now.monotonic_nanos;
    let is_sensible = |taken: &i64| (0..=MAX_AGE_NANOS).contains(&arrived.saturating_sub(*taken));
    let nanos = buffer.taken_nanos.filter(is_sensible).unwrap_or(arrived);
    Capture { nanos, clock: Clock::Monotonic, unix_nanos: now.unix_nanos - (arrived - nanos) }
}

impl Mode {
    /// Copies a buffer's picture into `frame`, once: the buffer goes back to the driver.
    fn copy(&self, bytes: &[u8], flawed: bool, frame: &mut Frame) -> anyhow::Result<()> {
        if flawed {
            bail!("the driver says that it is damaged");
        }
        if bytes.is_empty() {
            bail!("it is empty");
        }
        frame.file.clear();
        let (width, height) = self.size;
        match self.coding {
            Coding::Jpeg => huffman::copy_with_tables(bytes, &mut frame.file),
            Coding::Raw(format) => {
                let expected = format.byte_len(width, height, self.row_stride);
                let Some(picture) = bytes.get(..expected) else {
                    bail!("it has {} bytes; {self} takes {expected}", bytes.len());
                };
                frame.buffer(expected).copy_from_slice(picture);
                frame.format = Some(format);
                frame.size = self.size;
                frame.row_stride = self.row_stride;
            }
        }
        Ok(())
    }

    /// What is left to do when the buffer has been given back.
    fn decode(&self, frame: &mut Frame) -> anyhow::Result<()> {
        if self.coding == Coding::Jpeg {
            decode_file(frame)?;
            let ((width, height), (wide, high)) = (frame.size, self.size);
            if frame.size != self.size {
                bail!("it has {width}x{height} pixels; the camera was set to {wide}x{high}");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
