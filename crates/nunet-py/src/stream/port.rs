//! The shared-memory topic of a publisher, which its loans use too.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use nunet_core::camera::Camera;
use nunet_ipc::{
    CameraName, Clock, FrameHeader, IpcError, Limits, Topic, TopicPlan, Wake, check_capture_time,
    monotonic_nanos, unix_nanos,
};
use pyo3::prelude::*;

use super::errors::ipc_error;
use super::late::Served;
use super::layout::ImageLayout;
use crate::error::{NunetError, hinted};
use crate::fork_guard::ForkGuard;

/// The name of the class in messages.
const NAME: &str = "publisher";

/// Chunks that may be on loan at a time: the anchor, the image of an open block, the copy that is sent
/// instead of it, and one that an array of an earlier block holds.
const MAX_LOANS: usize = 4;

/// A chunk that keeps the publisher's memory mapped, but not the camera's name taken.
pub(super) type Anchor = Arc<Mutex<nunet_ipc::Loan>>;

/// The description of a camera, which travels with every image.
#[derive(Debug)]
pub(super) struct ImageOrigin {
    pub(super) camera: CameraName,
    pub(super) layout: ImageLayout,
    pub(super) camera_info: Option<Camera>,
    pub(super) clock: Clock,
    pub(super) frame_id: String,
}

/// The topic `rgb` of a camera, and a count of copies.
#[derive(Debug)]
pub(super) struct ImageTopic {
    pub(super) source: ImageOrigin,
    copied: AtomicU64,
    open: ForkGuard<Served<OpenTopic>>,
}

#[derive(Debug)]
struct OpenTopic {
    // Dropped before the publisher, unless an array still needs it.
    anchor: Anchor,
    publisher: nunet_ipc::Publisher,
    sequence: u64,
}

/// Capture time and number of an image; `None` for the current time and for the next number.
#[derive(Debug, Clone, Copy)]
pub(super) struct ImageStamp {
    pub(super) nanos: Option<i64>,
    pub(super) sequence: Option<u64>,
}

impl ImageStamp {
    /// Refuses a time that cannot be sent, before an image is written for it.
    ///
    /// # Errors
    /// `ValueError` for a negative time.
    pub(super) fn check(self) -> PyResult<()> {
        self.nanos.map_or(Ok(()), |nanos| check_capture_time(Topic::Rgb, nanos)).map_err(ipc_error)
    }
}

impl ImageTopic {
    /// Creates the topic, with memory for so many readers.
    ///
    /// # Errors
    /// `NunetError` if the camera is published already or memory is short.
    pub(super) fn create(py: Python<'_>, source: ImageOrigin, readers: u32) -> PyResult<Self> {
        let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: source.layout.bytes() };
        let limits = Limits { max_readers: readers as usize, max_loans: MAX_LOANS, ..Limits::default() };
        let publisher = py
            .detach(|| nunet_ipc::Publisher::create(&source.camera, &[plan], &limits))
            .map_err(ipc_error)?;
        let anchor = publisher.loan(Topic::Rgb).map_err(ipc_error)?;
        let open = OpenTopic { anchor: Arc::new(Mutex::new(anchor)), publisher, sequence: 0 };
        // An error is reported when the next image is sent, because sending does the same.
        let open = Served::start(open, |open| drop(open.publisher.refresh()))?;
        Ok(Self { source, copied: AtomicU64::new(0), open: ForkGuard::new(open) })
    }

    fn open(&self) -> PyResult<MutexGuard<'_, Option<OpenTopic>>> {
        Ok(self.open.get(NAME)?.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Runs `action` on the open topic. No Python code may run meanwhile.
    fn with<T>(&self, action: impl FnOnce(&mut OpenTopic) -> Result<T, IpcError>) -> PyResult<T> {
        let mut open = self.open()?;
        let camera = &self.source.camera;
        let open = open.as_mut().ok_or_else(|| {
            hinted::<NunetError>(
                format!("this publisher of camera `{camera}` is closed"),
                "use it inside its `with` block, or make a new one",
            )
        })?;
        action(open).map_err(|error| match error {
            IpcError::TooManyLoans { .. } => hinted::<NunetError>(
                format!("no memory for another image of camera `{camera}`: arrays of earlier loans hold it"),
                "drop the arrays and views of a loan before the next one",
            ),
            error => ipc_error(error),
        })
    }

    /// Checks that the topic is open.
    pub(super) fn check_open(&self) -> PyResult<()> {
        self.with(|_| Ok(()))
    }

    /// A chunk for one image.
    pub(super) fn chunk(&self) -> PyResult<nunet_ipc::Loan> {
        self.with(|open| open.publisher.loan(Topic::Rgb))
    }

    pub(super) fn anchor(&self) -> PyResult<Anchor> {
        self.with(|open| Ok(Arc::clone(&open.anchor)))
    }

    /// Sends a filled chunk and wakes the readers. Returns the image's number.
    pub(super) fn send(&self, mut loan: nunet_ipc::Loan, capture: ImageStamp) -> PyResult<u64> {
        self.with(|open| {
            let sequence = capture.sequence.unwrap_or(open.sequence);
            self.source.describe(loan.header_mut(), capture, sequence);
            loan.publish(monotonic_nanos())?;
            open.sequence = sequence.wrapping_add(1);
            open.publisher.notify(Wake::Image)?;
            Ok(sequence)
        })
    }

    /// Sends a copy of an image that arrays can still write to.
    pub(super) fn send_copy(&self, image: &[u8], capture: ImageStamp) -> PyResult<u64> {
        let mut copy = self.chunk()?;
        copy.bytes_mut().copy_from_slice(image);
        self.copied.fetch_add(1, Ordering::Relaxed);
        self.send(copy, capture)
    }

    /// Sends the last image to late subscribers.
    pub(super) fn refresh(&self) -> PyResult<()> {
        self.with(|open| open.publisher.refresh())
    }

    pub(super) fn has_readers(&self) -> PyResult<bool> {
        self.with(|open| Ok(open.publisher.has_readers(Topic::Rgb)))
    }

    pub(super) fn is_closed(&self) -> PyResult<bool> {
        Ok(self.open()?.is_none())
    }

    pub(super) fn close(&self, py: Python<'_>) -> PyResult<()> {
        let open = self.open()?.take();
        py.detach(|| drop(open));
        Ok(())
    }

    /// Number of loans that were copied.
    pub(super) fn copied(&self) -> u64 {
        self.copied.load(Ordering::Relaxed)
    }
}

impl ImageOrigin {
    /// Fills the header of an image.
    fn describe(&self, header: &mut FrameHeader, capture: ImageStamp, sequence: u64) {
        *header = FrameHeader::default();
        header.sequence = sequence;
        let (monotonic, unix) = (monotonic_nanos(), unix_nanos());
        let now = match self.clock {
            Clock::Monotonic => monotonic,
            Clock::Unix => unix,
            Clock::Media => 0,
        };
        header.capture_nanos = capture.nanos.unwrap_or(now);
        header.set_capture_clock(self.clock);
        header.capture_unix_nanos = header.unix_of_capture(monotonic, unix);
        header.set_encoding(self.layout.encoding);
        (header.width, header.height) = (self.layout.size.width, self.layout.size.height);
        header.row_stride_bytes = self.layout.row_bytes;
        header.set_frame_id(&self.frame_id);
        if let Some(camera_info) = &self.camera_info {
            header.set_camera(&camera_info.into());
        }
    }
}
