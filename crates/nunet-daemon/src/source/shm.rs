//! Frames that another process publishes in shared memory: taken as they lie.

use std::time::{Duration, Instant};

use nunet_core::camera::Camera;
use nunet_ipc::{CameraName, Clock, FrameHeader, IpcError, Reader, Topic};
use tracing::{info, warn};

use super::{Capture, Fill, Frame, Pixels, Source};
use crate::exit::camera_name;
use crate::words;

/// How long one call may wait, so that a stop is seen.
const PATIENCE: Duration = Duration::from_millis(100);
/// How often the user is told that the camera is not there.
const REMINDER: Duration = Duration::from_secs(10);

/// The camera's `rgb` topic. A camera that is not there yet, or goes away, is waited for.
#[derive(Debug)]
pub(super) struct SharedMemory {
    camera: CameraName,
    reader: Option<Reader>,
    last_sign: Option<Instant>,
    waiting: bool,
    bad_camera: bool,
}

impl SharedMemory {
    pub(super) fn open(camera: &str) -> anyhow::Result<Self> {
        let camera = camera_name(camera)?;
        Ok(Self { camera, reader: None, last_sign: None, waiting: false, bad_camera: false })
    }

    fn try_fill(&mut self, frame: &mut Frame) -> Result<Fill, IpcError> {
        let Some(reader) = self.connect()? else { return Ok(Fill::Nothing) };
        // The event is a hint: a frame that came before we listened has no event any more.
        if let Some(sample) = latest_or_wait(reader)? {
            self.last_sign = Some(Instant::now());
            self.waiting = false;
            return Ok(self.describe(sample, frame));
        }
        self.remind("it sends no frames");
        Ok(Fill::Nothing)
    }

    /// A camera that speaks another version will not learn ours; everything else may change while we wait.
    fn connect(&mut self) -> Result<Option<&Reader>, IpcError> {
        if self.reader.is_none() {
            match Reader::open(&self.camera, &[Topic::Rgb], PATIENCE) {
                Ok(reader) => {
                    info!("connected to camera `{}`", self.camera);
                    self.reader = Some(reader);
                }
                Err(IpcError::NobodyPublishes { .. }) => self.remind("it is not there yet"),
                Err(error @ IpcError::ContractVersion { .. }) => return Err(error),
                Err(error) => {
                    self.remind(&error.to_string());
                    std::thread::sleep(PATIENCE);
                }
            }
        }
        Ok(self.reader.as_ref())
    }

    fn remind(&mut self, what: &str) {
        if self.last_sign.is_none_or(|last| last.elapsed() >= REMINDER) {
            self.last_sign = Some(Instant::now());
            self.waiting = true;
            warn!("waiting for camera `{}`: {what}", self.camera);
        }
    }

    fn describe(&mut self, sample: nunet_ipc::Frame, frame: &mut Frame) -> Fill {
        let header = sample.header();
        let format = header.encoding().ok().and_then(words::pixel_format);
        frame.sequence = header.sequence;
        if format.is_none() {
            return Fill::Failed(anyhow::anyhow!(
                "camera `{}` sends encoding `{}`, which is no picture",
                self.camera,
                header.encoding
            ));
        }
        frame.format = format;
        frame.size = (header.width, header.height);
        frame.row_stride = header.row_stride_bytes;
        frame.capture = Capture {
            nanos: header.capture_nanos,
            clock: header.capture_clock().unwrap_or(Clock::Monotonic),
            unix_nanos: header.capture_unix_nanos,
        };
        frame.camera = self.camera_of(header);
        frame.pixels = Pixels::Shared(sample);
        Fill::Frame
    }

    /// A camera or a lens that makes no sense is told once and not used.
    fn camera_of(&mut self, header: &FrameHeader) -> Option<Camera> {
        words::camera(header).unwrap_or_else(|error| {
            if !self.bad_camera {
                warn!("camera `{}` sends intrinsics that are not used: {error:#}", self.camera);
            }
            self.bad_camera = true;
            None
        })
    }
}

impl Source for SharedMemory {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        match self.try_fill(frame) {
            Ok(fill) => fill,
            Err(IpcError::TooManyFramesHeld { .. }) => Fill::Crowded,
            Err(error @ IpcError::ContractVersion { .. }) => Fill::Broken(error.into()),
            Err(error) => Fill::Failed(error.into()),
        }
    }

    fn is_live(&self) -> bool {
        true
    }

    fn is_waiting(&self) -> bool {
        self.waiting
    }
}

fn latest_or_wait(reader: &Reader) -> Result<Option<nunet_ipc::Frame>, IpcError> {
    if let Some(sample) = reader.latest(Topic::Rgb)? {
        return Ok(Some(sample));
    }
    reader.wait(PATIENCE)?;
    reader.latest(Topic::Rgb)
}
