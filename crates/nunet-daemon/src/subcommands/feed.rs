//! `nunetd feed`: publishes the frames of a source in shared memory, like a camera driver.

use std::ops::ControlFlow;
use std::sync::OnceLock;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Instant;

use anyhow::{Context as _, bail, ensure};
use nunet_core::camera::Camera;
use nunet_core::frame::PixelFormat;
use nunet_ipc::{
    CameraName, FrameHeader, LATE_JOINER_PERIOD, Limits, Publisher, Topic, TopicPlan, Wake, monotonic_nanos,
};
use nunet_telemetry::RateLimit;
use nunet_types::{ImageSize, counted};
use tracing::{error, info, warn};

use crate::Outcome;
use crate::config::SourceConfig;
use crate::exit::{BadArguments, is_usage};
use crate::source::{CameraGeometry, CameraResolver, Frame, OpenOptions};
use crate::stream::{FrameHandler, Pace, SourceEnd, Stop, drive};

/// The options of `feed`.
pub(crate) struct FeedOptions {
    pub(crate) source: SourceConfig,
    pub(crate) camera: CameraName,
    pub(crate) geometry: CameraGeometry,
}

/// Publishes until the source ends, `--frames` are sent, or a stop is requested.
pub(crate) fn feed(options: &FeedOptions) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    if options.source.name.properties().is_published {
        let error = BadArguments::new("a camera in shared memory needs no feed");
        bail!(error.with_hint("name it with --source shm:CAMERA"));
    }
    let resolver = CameraResolver::new(&options.geometry)?;
    let folders = nunet_engine::model_folders();
    let open_options = OpenOptions {
        rotation: options.geometry.rotation,
        stopped: Some(stop.flag()),
        model_folders: &folders,
        ..options.source.open_options()
    };
    let source = options.source.name.open(open_options);
    if stop.requested() {
        return Ok(Outcome::Done);
    }
    let mut source = source?;
    let images = OnceLock::new();
    let mut feeder = Feeder::new(options.camera.clone(), resolver, &images, &stop);
    let pace = Pace::of(&options.source);
    let end = serving_late_joiners(&images, || drive(source.as_mut(), pace, &stop, &mut feeder))?;
    let Feeder { camera, sent, superseded, failed, .. } = feeder;
    info!("camera `{camera}`: {} sent, {superseded} superseded, {failed} failed", counted(sent, "frame"));
    if failed > 0 {
        error!("lost {failed} of {}", counted(sent + failed, "frame"));
    }
    Ok(if failed == 0 && end != SourceEnd::Truncated { Outcome::Done } else { Outcome::Lost })
}

/// Sends the last image to readers that join while `feed` waits for the next one. It runs on its own thread,
/// because a pipe can block and a slow pace sleeps.
fn serving_late_joiners(
    images: &OnceLock<RgbPublisher>,
    feed: impl FnOnce() -> anyhow::Result<SourceEnd>,
) -> anyhow::Result<SourceEnd> {
    std::thread::scope(|scope| {
        let (feeding, over) = channel::<()>();
        let serve = move || {
            let mut failures = RateLimit::default();
            while over.recv_timeout(LATE_JOINER_PERIOD) == Err(RecvTimeoutError::Timeout) {
                if let Some(Err(error)) = images.get().map(|images| images.publisher.refresh())
                    && let Some(suppressed) = failures.allow(Instant::now())
                {
                    warn!("late readers are not served: {error}{suppressed}");
                }
            }
        };
        let thread = std::thread::Builder::new().name("late readers".into());
        thread.spawn_scoped(scope, serve).context("cannot start the thread for late readers")?;
        let fed = feed();
        drop(feeding);
        fed
    })
}

/// Publishes the frames of one camera. All images have the size of the first one.
struct Feeder<'a> {
    camera: CameraName,
    resolver: CameraResolver,
    images: &'a OnceLock<RgbPublisher>,
    stop: Stop,
    /// The memory of the next frame.
    frame: Frame,
    lost: RateLimit,
    sent: u64,
    /// Newer ones replaced them within the source.
    superseded: u64,
    failed: u64,
}

/// The publisher of the `rgb` topic.
struct RgbPublisher {
    publisher: Publisher,
    size: ImageSize,
    /// The capacity of a message, bytes.
    room: usize,
}

impl<'a> Feeder<'a> {
    fn new(
        camera: CameraName,
        resolver: CameraResolver,
        images: &'a OnceLock<RgbPublisher>,
        stop: &Stop,
    ) -> Self {
        let (frame, lost) = (Frame::default(), RateLimit::default());
        let stop = stop.clone();
        Self { camera, resolver, images, stop, frame, lost, sent: 0, superseded: 0, failed: 0 }
    }

    /// Sends a frame; opens shared memory at the first one.
    fn send(&mut self, frame: &Frame) -> anyhow::Result<ControlFlow<()>> {
        let camera = match self.resolver.resolve(frame).map_err(anyhow::Error::from) {
            Ok(camera) => camera,
            // The camera does not fit the images, so all frames would fail.
            Err(error) if is_usage(&error) => return Err(error),
            Err(error) => {
                self.lose(frame, &error);
                return Ok(ControlFlow::Continue(()));
            }
        };
        let images = match self.images.get() {
            Some(images) => images,
            None => match RgbPublisher::open(&self.camera, frame, &self.stop) {
                Err(_) if self.stop.requested() => return Ok(ControlFlow::Break(())),
                opened => {
                    let opened = opened?;
                    self.images.get_or_init(|| opened)
                }
            },
        };
        match images.has_room(frame) {
            Ok(()) => {
                images.send(frame, camera)?;
                self.sent += 1;
            }
            Err(error) => self.lose(frame, &error),
        }
        Ok(ControlFlow::Continue(()))
    }

    fn lose(&mut self, frame: &Frame, error: &anyhow::Error) {
        if let Some(text) = self.lost.lost_frame(Instant::now(), frame.sequence, error) {
            warn!("{text}");
        }
        self.failed += 1;
    }
}

impl FrameHandler for Feeder<'_> {
    fn buffer(&mut self) -> Frame {
        std::mem::take(&mut self.frame)
    }

    fn on_frame(&mut self, frame: Frame) -> anyhow::Result<ControlFlow<()>> {
        self.superseded += frame.superseded;
        let sent = self.send(&frame);
        self.frame = frame;
        sent
    }

    fn on_lost(&mut self, frame: Frame) {
        self.superseded += frame.superseded;
        self.failed += 1;
        self.frame = frame;
    }

    fn on_idle(&mut self, frame: Frame, _is_crowded: bool) {
        self.frame = frame;
    }
}

impl RgbPublisher {
    fn open(camera: &CameraName, frame: &Frame, stop: &Stop) -> anyhow::Result<Self> {
        let room = frame.view()?.bytes().len();
        let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: room };
        let publisher = Publisher::create_unless(camera, &[plan], &Limits::default(), &|| stop.requested())?;
        info!("camera `{camera}`: {}, {} of shared memory", frame.size, publisher.reservation());
        Ok(Self { publisher, size: frame.size, room })
    }

    /// Shared memory is reserved once, for the size and format of the first image.
    fn has_room(&self, frame: &Frame) -> anyhow::Result<()> {
        let view = frame.view()?;
        let bytes = view.bytes().len();
        ensure!(
            frame.size == self.size,
            "an image of {} from a camera that began with {}: a camera has one size",
            frame.size,
            self.size
        );
        ensure!(
            bytes <= self.room,
            "an image of {bytes} bytes ({}) from a camera that began with {}: a camera has one format",
            view.format(),
            self.room
        );
        Ok(())
    }

    fn send(&self, frame: &Frame, camera: Option<Camera>) -> anyhow::Result<()> {
        let view = frame.view()?;
        let mut loan = self.publisher.loan_bytes(Topic::Rgb, view.bytes().len())?;
        loan.bytes_mut().copy_from_slice(view.bytes());
        describe(loan.header_mut(), frame, view.format(), camera);
        loan.publish(monotonic_nanos())?;
        Ok(self.publisher.notify(Wake::Image)?)
    }
}

fn describe(header: &mut FrameHeader, frame: &Frame, format: PixelFormat, camera: Option<Camera>) {
    *header = FrameHeader::default();
    frame.identify(header);
    header.set_encoding(format.into());
    (header.width, header.height) = (frame.size.width, frame.size.height);
    header.row_stride_bytes = frame.row_stride;
    if let Some(camera) = camera {
        header.set_camera(&(&camera).into());
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU64;

    use super::*;
    use crate::exit::camera_name;
    use crate::source::{Fill, Rate, Source, SourceError};

    /// A gray image, and then color ones, each instead of as many others as its number. The fourth cannot be
    /// read.
    struct Turning(u64);

    impl Source for Turning {
        fn fill(&mut self, frame: &mut Frame) -> Fill {
            let format = if self.0 == 0 { PixelFormat::Mono8 } else { PixelFormat::Rgb8 };
            frame.rgb_buffer((4, 2).into());
            frame.format = Some(format);
            frame.row_stride = format.min_stride(4);
            frame.buffer(format.byte_len(4, 2, frame.row_stride));
            (frame.sequence, frame.superseded) = (self.0, self.0);
            self.0 += 1;
            if self.0 == 4 { Fill::Failed(SourceError::bad_frame("unreadable")) } else { Fill::Frame }
        }
    }

    #[test]
    fn an_image_without_shared_memory_is_lost_alone() {
        nunet_ipc::use_root(&nunet_testkit::ipc_root()).unwrap();
        let camera = camera_name(&format!("turning_{}", std::process::id())).unwrap();
        let images = OnceLock::new();
        let stop = Stop::default();
        let mut feeder = Feeder::new(camera, CameraResolver::default(), &images, &stop);
        let pace = Pace { rate: Rate::Max, limit: NonZeroU64::new(4) };
        drive(&mut Turning(0), pace, &stop, &mut feeder).unwrap();
        assert_eq!((feeder.sent, feeder.superseded, feeder.failed), (1, 6, 3));
    }
}
