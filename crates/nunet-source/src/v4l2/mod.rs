//! Cameras of this machine, through V4L2.
//!
//! Requests are in [`linux`], mapped memory in [`mapping`], behind the trait [`Device`]. This file contains
//! the policy: it chooses the mode, takes the newest image, rejects bad images, and waits for a lost camera.

mod abi;
mod device;
mod fault;
mod linux;
mod list;
mod mapping;
mod negotiate;
mod planes;
mod settings;

use std::os::unix::fs::FileTypeExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use nunet_ipc::Clock;
use nunet_types::ImageSize;
use tracing::{debug, info, warn};

use self::device::{Buffer, Device, Host, Now};
use self::fault::CameraFault;
use self::linux::Linux;
pub use self::list::cameras;
use self::negotiate::{CaptureMode, Coding, RequestedMode, choose, set};
use crate::convert::{self, RawImageView};
use crate::error::{SourceError, SourceErrorKind};
use crate::health::Health;
use crate::rate::MAX_HZ;
use crate::source::Fused;
use crate::source_type::{Exclusive, Properties, SizeUse, SourceType};
use crate::{CaptureTime, Fill, Frame, OpenOptions, Rate, Source, decode_file};

/// How long one call may wait, so that a stop is noticed.
const POLL_TIMEOUT: Duration = Duration::from_millis(100);
/// One is read, one is filled, and two wait. More would only add latency.
const BUFFERS: u32 = 4;
/// How many filled buffers are searched for the newest, in case a driver never runs out of them.
const MAX_WAITING: u64 = 32;
/// A camera without an image for this long is reopened. Slow cameras have the time of [`STALL_FRAMES`]
/// frames.
const STALL: Duration = Duration::from_secs(3);
const STALL_FRAMES: f64 = 5.0;
/// A time stamp older than this is not a time of capture.
const MAX_AGE_NANOS: i64 = 10_000_000_000;

/// A camera. After it was opened once, the source waits for it whenever it is lost.
struct V4l2Camera<H> {
    host: H,
    path: PathBuf,
    requested: RequestedMode,
    stream: Option<StartedDevice>,
    health: Health,
    sequence: u64,
    segment: u64,
}

/// A device that was started.
struct StartedDevice {
    device: Box<dyn Device>,
    mode: CaptureMode,
    /// The camera's own name.
    name: String,
    /// `CLOCK_MONOTONIC` of the last buffer; `None` before the first request.
    last_nanos: Option<i64>,
}

/// A camera of this machine, connected or not.
pub(crate) struct VideoDevice;

impl SourceType for VideoDevice {
    /// The names below `/dev/v4l` stay the same when numbers change, and so do those of the package's udev
    /// rule.
    fn is_named(&self, name: &str) -> bool {
        let is_known = ["/dev/video", "/dev/v4l/", "/dev/nunet/"].iter().any(|start| name.starts_with(start));
        let is_device = || Path::new(name).metadata().is_ok_and(|found| found.file_type().is_char_device());
        is_known || is_device()
    }

    fn properties(&self) -> Properties {
        Properties {
            exclusive: Some(Exclusive::Device),
            size: SizeUse::Requested,
            has_settings: true,
            no_repeat: Some("a camera has no end to begin again at"),
            camera: "camera",
            default_size: Some("640x480"),
            default_rate: Some("30"),
            ..Properties::default()
        }
    }

    fn open(&self, name: &str, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        Ok(Box::new(Fused::new(V4l2Camera::open(Linux, Path::new(name), requested(options))?)))
    }

    fn stand_in(&self, name: &str, options: OpenOptions<'_>, _error: SourceError) -> Box<dyn Source> {
        Box::new(Fused::new(V4l2Camera::lost(Linux, Path::new(name), requested(options))))
    }
}

fn requested(options: OpenOptions<'_>) -> RequestedMode {
    let usual = RequestedMode::default();
    let hz = options.rate.map_or(usual.hz, |rate| match rate {
        Rate::Max => MAX_HZ,
        Rate::Hz(hz) => hz,
    });
    RequestedMode { size: options.size.unwrap_or(usual.size), hz, settings: options.camera_settings }
}

impl<H: Host> V4l2Camera<H> {
    fn lost(host: H, path: &Path, requested: RequestedMode) -> Self {
        let path = path.to_owned();
        Self { host, path, requested, stream: None, health: Health::default(), sequence: 0, segment: 0 }
    }

    fn open(mut host: H, path: &Path, requested: RequestedMode) -> Result<Self, SourceError> {
        let stream = StartedDevice::open(&mut host, path, requested).map_err(|fault| {
            let kind =
                if fault.is_argument() { SourceErrorKind::Argument } else { SourceErrorKind::Unavailable };
            let error = SourceError::new(kind, fault.to_string());
            let error = match fault.hint_on(&host) {
                Some(hint) => error.with_hint(hint),
                None => error,
            };
            error.context(format!("cannot use the camera `{}`", path.display()))
        })?;
        let video = Self::lost(host, path, requested);
        video.log_mode(&stream, "");
        Ok(Self { stream: Some(stream), ..video })
    }

    fn log_mode(&self, stream: &StartedDevice, how: &str) {
        let (path, StartedDevice { mode, name, .. }) = (self.path.display(), stream);
        if mode.fulfils(self.requested) {
            info!("camera `{path}` ({name}){how}: {mode}");
        } else {
            info!("camera `{path}` ({name}){how}: {mode}, the nearest to {}", self.requested);
        }
    }

    fn try_fill(&mut self, frame: &mut Frame) -> Result<Fill, CameraFault> {
        if self.stream.is_none() && !self.try_again()? {
            return Ok(Fill::Nothing);
        }
        let Some(stream) = &mut self.stream else { return Ok(Fill::Nothing) };
        let waiting = stream.next(self.host.now())?;
        let now = self.host.now();
        let Some((buffer, count)) = waiting else {
            return if stream.has_stalled(now) { Err(CameraFault::Stalled) } else { Ok(Fill::Nothing) };
        };
        stream.last_nanos = Some(now.monotonic_nanos);
        self.sequence += count;
        frame.sequence = self.sequence - 1;
        frame.superseded = count - 1;
        frame.segment = self.segment;
        frame.capture = capture(&buffer, now);
        frame.camera = None;
        let copied = stream.mode.copy(stream.device.bytes(&buffer), buffer.flawed, frame);
        // Before decoding, because the driver needs the buffer.
        stream.device.queue(buffer).map_err(CameraFault::at("give a buffer back"))?;
        Ok(match copied.and_then(|()| stream.mode.decode(frame)) {
            Ok(()) => {
                self.good();
                Fill::Frame
            }
            Err(error) => Fill::Failed(error.context(format!("an image of `{}`", self.path.display()))),
        })
    }

    /// Reopens a lost camera when the wait is over. Returns false before that. It may be another camera by
    /// then.
    fn try_again(&mut self) -> Result<bool, CameraFault> {
        let wait = self.health.wait(self.host.now().monotonic_nanos);
        if !wait.is_zero() {
            self.host.pause(wait.min(POLL_TIMEOUT));
            return Ok(false);
        }
        self.stream = Some(StartedDevice::open(&mut self.host, &self.path, self.requested)?);
        self.segment += 1;
        Ok(true)
    }

    fn good(&mut self) {
        if self.health.recovers(self.host.now().monotonic_nanos)
            && let Some(stream) = &self.stream
        {
            self.log_mode(stream, " is back");
        }
    }

    fn lose(&mut self, fault: &CameraFault) {
        // Closed first: while it is open, a camera that is plugged in again gets another path.
        self.stream = None;
        let (path, now) = (self.path.display(), self.host.now());
        if self.health.fails(&fault.to_string(), now.monotonic_nanos) {
            warn!("waiting for camera `{path}`: {fault}");
        } else {
            debug!("camera `{path}`: {fault}");
        }
    }
}

impl<H: Host> Source for V4l2Camera<H> {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        self.try_fill(frame).unwrap_or_else(|fault| {
            self.lose(&fault);
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

impl StartedDevice {
    fn open(host: &mut dyn Host, path: &Path, requested: RequestedMode) -> Result<Self, CameraFault> {
        let mut device = host.open(path).map_err(CameraFault::at("open it"))?;
        let name = list::name_of_camera(device.as_mut())?;
        let choice = choose(device.as_mut(), requested)?;
        let mode = set(device.as_mut(), choice, requested)?;
        settings::apply(device.as_mut(), requested.settings)?;
        device.start(BUFFERS).map_err(CameraFault::at("start it"))?;
        Ok(Self { device, mode, name, last_nanos: None })
    }

    /// The newest image and the number of filled buffers, or `None` after [`POLL_TIMEOUT`].
    fn next(&mut self, now: Now) -> Result<Option<(Buffer, u64)>, CameraFault> {
        let failed = CameraFault::at("take an image");
        if self.last_nanos.is_none() {
            // Buffers that were filled while the model was loaded are outdated.
            self.last_nanos = Some(now.monotonic_nanos);
            if let Some((stale, _)) = newest(self.device.as_mut()).map_err(&failed)? {
                self.device.queue(stale).map_err(&failed)?;
            }
        }
        if !self.device.wait(POLL_TIMEOUT).map_err(&failed)? {
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

/// The newest filled buffer, and the number of filled ones. Older ones are returned to the driver unread.
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

/// The driver's time stamp if it is plausible, else the time of arrival.
fn capture(buffer: &Buffer, now: Now) -> CaptureTime {
    let arrived = now.monotonic_nanos;
    let is_sensible = |taken: &i64| (0..=MAX_AGE_NANOS).contains(&arrived.saturating_sub(*taken));
    let nanos = buffer.taken_nanos.filter(is_sensible).unwrap_or(arrived);
    CaptureTime { nanos, clock: Clock::Monotonic, unix_nanos: now.unix_nanos - (arrived - nanos) }
}

impl CaptureMode {
    /// Copies a buffer's image into `frame`, because the buffer is returned to the driver.
    fn copy(&self, bytes: &[u8], flawed: bool, frame: &mut Frame) -> Result<(), SourceError> {
        if flawed {
            return Err(SourceError::bad_frame("the driver reports that it is damaged"));
        }
        if bytes.is_empty() {
            return Err(SourceError::bad_frame("it is empty"));
        }
        frame.file.clear();
        match self.coding {
            Coding::Jpeg => frame.file.extend_from_slice(bytes),
            Coding::Raw(layout) => {
                let image = RawImageView { layout, size: self.size, row_stride: self.row_stride, bytes };
                if !convert::fill(frame, image) {
                    let expected = layout.byte_len(self.size, self.row_stride);
                    let message = format!("it has {} bytes; {self} takes {expected}", bytes.len());
                    return Err(SourceError::bad_frame(message));
                }
            }
        }
        Ok(())
    }

    /// Decodes the copied image, after the buffer was returned.
    fn decode(&self, frame: &mut Frame) -> Result<(), SourceError> {
        if self.coding == Coding::Jpeg {
            let orientation = decode_file(frame)?.orientation;
            let is_swapped = orientation.to_exif() >= 5
                && ImageSize::new(frame.size.height, frame.size.width) == self.size;
            if frame.size != self.size && !is_swapped {
                let message = format!("it has {} pixels; the camera was set to {}", frame.size, self.size);
                return Err(SourceError::bad_frame(message));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
