//! Frames that another process publishes in shared memory, without copying them.

use std::time::{Duration, Instant};

use nunet_core::camera::Camera;
use nunet_ipc::{
    CameraName, Clock, Encoding, FrameHeader, IpcError, Reader, Topic, check_capture_time, monotonic_nanos,
    unix_nanos,
};
use nunet_types::Hint as _;
use nunet_types::{ImageSize, PixelFormat};
use tracing::{info, warn};

use crate::error::{SourceError, SourceErrorKind};
use crate::silence::Silence;
use crate::source::Fused;
use crate::source_type::{Properties, SourceType};
use crate::{CaptureTime, Fill, Frame, OpenOptions, Pixels, Source};

/// How long one call may wait, so that a stop is noticed. Also how often it looks for a publisher that does
/// not exist.
const POLL_TIMEOUT: Duration = Duration::from_millis(100);
/// Another process publishes frames in shared memory under a camera's name.
pub(crate) struct SharedMemoryCamera;

const PREFIX: &str = "shm:";

impl SourceType for SharedMemoryCamera {
    fn is_named(&self, name: &str) -> bool {
        name.starts_with(PREFIX)
    }

    fn properties(&self) -> Properties {
        Properties {
            own_pace: Some("a camera in shared memory has its own pace"),
            is_published: true,
            camera: "camera",
            ..Properties::default()
        }
    }

    fn open(&self, name: &str, _options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        Ok(Box::new(Fused::new(SharedMemory::open(name.strip_prefix(PREFIX).unwrap_or(name))?)))
    }
}

fn unavailable(error: IpcError) -> SourceError {
    SourceError::new(SourceErrorKind::Unavailable, "cannot read the camera in shared memory")
        .with_cause(error)
}

/// The camera's `rgb` topic. If its publisher does not exist yet or ends, the source waits for it.
#[derive(Debug)]
pub(crate) struct SharedMemory {
    camera: CameraName,
    reader: Option<Reader>,
    silence: Silence,
    bad_camera: bool,
}

impl SharedMemory {
    pub(crate) fn open(camera: &str) -> Result<Self, SourceError> {
        let camera = CameraName::new(camera).map_err(|error| {
            let hint = error.hint();
            let bad = SourceError::bad_arguments(error.to_string());
            hint.map_or_else(|| SourceError::bad_arguments(error.to_string()), |hint| bad.with_hint(hint))
        })?;
        Ok(Self { camera, reader: None, silence: Silence::default(), bad_camera: false })
    }

    fn try_fill(&mut self, frame: &mut Frame) -> Result<Fill, IpcError> {
        let Some(reader) = self.connect()? else { return Ok(Fill::Nothing) };
        // The event is only a hint: a frame that arrived before this reader listened has no event.
        if let Some(sample) = latest_or_wait(reader)? {
            self.silence.ends(Instant::now());
            return Ok(self.describe(sample, frame));
        }
        if self.silence.is_long(Instant::now()) {
            self.remind("it sends no frames");
        }
        Ok(Fill::Nothing)
    }

    /// Another contract version is final; everything else may change while we wait.
    fn connect(&mut self) -> Result<Option<&Reader>, IpcError> {
        if self.reader.is_none() {
            // Only the first attempt waits: each wait begins with short periods, which cost processor time.
            let timeout = if self.silence.is_waiting() { Duration::ZERO } else { POLL_TIMEOUT };
            match Reader::open(&self.camera, &[Topic::Rgb], timeout) {
                Ok(reader) => {
                    info!("connected to camera `{}`", self.camera);
                    self.reader = Some(reader);
                    self.silence.begins(Instant::now());
                }
                Err(IpcError::NobodyPublishes { .. }) => self.reconnect("it does not exist yet"),
                Err(error @ IpcError::ContractVersion { .. }) => return Err(error),
                Err(error) => self.reconnect(&error.to_string()),
            }
        }
        Ok(self.reader.as_ref())
    }

    /// Drops a connection that failed; it does not recover by itself. No frame is lost by it. The next
    /// attempt is later.
    fn reconnect(&mut self, reason: &str) {
        self.reader = None;
        self.remind(reason);
        std::thread::sleep(POLL_TIMEOUT);
    }

    fn remind(&mut self, what: &str) {
        if self.silence.is_news(Instant::now()) {
            warn!("waiting for camera `{}`: {what}", self.camera);
        }
    }

    fn describe(&mut self, sample: nunet_ipc::Message, frame: &mut Frame) -> Fill {
        let header = sample.header();
        frame.sequence = header.sequence;
        match format_of(&self.camera, header) {
            Ok(format) => frame.format = Some(format),
            Err(error) => return Fill::Failed(error),
        }
        frame.size = ImageSize::new(header.width, header.height);
        frame.row_stride = header.row_stride_bytes;
        frame.capture = CaptureTime {
            nanos: header.capture_nanos,
            clock: header.capture_clock().unwrap_or(Clock::Monotonic),
            // Some publishers do not set it, and the stamps of recordings are derived from it.
            unix_nanos: header.unix_of_capture(monotonic_nanos(), unix_nanos()),
        };
        frame.camera = self.camera_of(header);
        frame.pixels = Pixels::Shared(sample);
        Fill::Frame
    }

    /// An impossible camera or lens is reported once and not used.
    fn camera_of(&mut self, header: &FrameHeader) -> Option<Camera> {
        camera_in(header).unwrap_or_else(|error| {
            if !self.bad_camera {
                warn!("camera `{}` sends intrinsics that are not used: {error:#}", self.camera);
            }
            self.bad_camera = true;
            None
        })
    }
}

/// The format of an image, if it can be processed.
fn format_of(camera: &CameraName, header: &FrameHeader) -> Result<PixelFormat, SourceError> {
    let format = header.encoding().ok().and_then(Encoding::pixel_format).ok_or_else(|| {
        let encoding = header.encoding;
        let message = format!("camera `{camera}` sends encoding `{encoding}`, which is not an image");
        SourceError::bad_frame(message)
    })?;
    // Its results would have the same time and could not be published.
    check_capture_time(Topic::Rgb, header.capture_nanos).map_err(|error| {
        let message = format!("camera `{camera}` sends an image without a valid capture time");
        SourceError::bad_frame(message).with_cause(error)
    })?;
    Ok(format)
}

/// The camera that a message describes; `None` if its sender does not know it.
///
/// # Errors
/// Invalid intrinsics, or an unknown lens model.
pub fn camera_in(header: &FrameHeader) -> Result<Option<Camera>, SourceError> {
    let info = header.camera().map_err(|error| SourceError::bad_frame(error.to_string()))?;
    let camera = info.as_ref().map(Camera::try_from).transpose();
    camera.map_err(|error| SourceError::bad_frame(error.to_string()))
}

impl Source for SharedMemory {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        match self.try_fill(frame) {
            Ok(fill) => fill,
            Err(IpcError::TooManyFramesHeld { .. }) => Fill::Crowded,
            Err(error @ IpcError::ContractVersion { .. }) => Fill::Broken(unavailable(error)),
            Err(error @ IpcError::BadMessage { .. }) => Fill::Failed(
                SourceError::bad_frame("a message in shared memory is damaged").with_cause(error),
            ),
            Err(error) => {
                self.reconnect(&error.to_string());
                Fill::Nothing
            }
        }
    }

    fn is_live(&self) -> bool {
        true
    }

    fn is_waiting(&self) -> bool {
        self.silence.is_waiting()
    }
}

fn latest_or_wait(reader: &Reader) -> Result<Option<nunet_ipc::Message>, IpcError> {
    if let Some(sample) = reader.latest(Topic::Rgb)? {
        return Ok(Some(sample));
    }
    reader.wait(POLL_TIMEOUT)?;
    reader.latest(Topic::Rgb)
}

#[cfg(test)]
mod tests {
    use nunet_ipc::{Encoding, Limits, Publisher, TopicPlan};

    use super::*;

    #[test]
    fn a_payload_that_is_no_image_and_a_time_that_no_result_could_have_are_bad_frames() {
        let camera = CameraName::new("front").unwrap();
        let sent = |encoding, capture_nanos| {
            let mut header = FrameHeader { capture_nanos, ..FrameHeader::default() };
            header.set_encoding(encoding);
            format_of(&camera, &header).map_err(|error| error.kind())
        };
        assert_eq!(sent(Encoding::Mono8, 0), Ok(PixelFormat::Mono8));
        assert_eq!(sent(Encoding::Mono8, -1), Err(SourceErrorKind::BadFrame));
        assert_eq!(sent(Encoding::DepthF32, 0), Err(SourceErrorKind::BadFrame));
    }

    #[test]
    fn an_image_without_a_time_of_day_gets_the_current_one() {
        nunet_ipc::use_root(&nunet_testkit::ipc_root()).unwrap();
        let name = CameraName::new(&format!("test-{}-shm-now", std::process::id())).unwrap();
        let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: 4 };
        let publisher = Publisher::create(&name, &[plan], &Limits::default()).unwrap();
        let mut source = SharedMemory::open(name.as_str()).unwrap();
        let started = unix_nanos();
        for (sent, expected) in [(0, None), (77, Some(77))] {
            let mut loan = publisher.loan(Topic::Rgb).unwrap();
            let header = loan.header_mut();
            (header.width, header.height, header.row_stride_bytes) = (2, 2, 2);
            header.set_encoding(Encoding::Mono8);
            header.set_capture_clock(Clock::Media);
            (header.capture_nanos, header.capture_unix_nanos) = (5, sent);
            loan.publish(monotonic_nanos()).unwrap();
            let mut frame = Frame::default();
            let came = (0..300).any(|_| {
                publisher.refresh().unwrap(); // for the late subscriber
                matches!(source.fill(&mut frame), Fill::Frame)
            });
            assert!(came, "no frame of `{name}`");
            assert_eq!((frame.capture.nanos, frame.capture.clock), (5, Clock::Media));
            let unix = frame.capture.unix_nanos;
            assert!(expected.map_or((started..=unix_nanos()).contains(&unix), |sent| sent == unix), "{unix}");
        }
    }
}
