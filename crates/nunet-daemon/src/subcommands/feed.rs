//! `nunetd feed`: publishes a source's frames in shared memory, as a camera driver would.

use std::num::NonZeroU64;
use std::sync::OnceLock;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Instant;

use anyhow::{Context as _, bail, ensure};
use nunet_core::camera::Camera;
use nunet_core::frame::PixelFormat;
use nunet_ipc::{
    CameraName, FrameHeader, LATE_JOINER_PERIOD, Limits, Publisher, Topic, TopicPlan, Wake, monotonic_nanos,
};
use tracing::{error, info, warn};

use crate::Outcome;
use crate::cli::FeedArgs;
use crate::exit::{BadArguments, camera_name};
use crate::source::{self, Fill, Frame, Kind, Opening, Pacer, Rate, Source};
use crate::stream::{Optics, Stop};

/// Publishes until the source ends, `--frames` are sent, or a signal comes.
pub(super) fn feed(arguments: &FeedArgs) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    let kind = Kind::parse(&arguments.source);
    if let Kind::SharedMemory(_) = kind {
        bail!(BadArguments(
            "a camera in shared memory needs no feed: name it with --source shm:CAMERA".into()
        ));
    }
    let optics = Optics::new(&arguments.geometry)?;
    let opening = Opening { stopped: Some(stop.flag()), ..arguments.pace.opening() };
    let source = source::open(&kind, opening);
    if stop.requested() {
        return Ok(Outcome::Done);
    }
    let mut source = source?;
    let port = OnceLock::new();
    let mut feeder = Feeder::new(camera_name(&arguments.camera)?, optics, &port);
    // A camera was asked for the rate; it keeps it by itself.
    let pacer =
        Pacer::new(arguments.pace.rate.unwrap_or(Rate::Max), Instant::now()).filter(|_| !source.is_live());
    serving_late_joiners(&port, || feeder.run(source.as_mut(), pacer, arguments.pace.frames, &stop))?;
    info!("camera `{}`: {} frames sent, {} failed", feeder.camera, feeder.sent, feeder.failed);
    if feeder.failed > 0 {
        error!("{} of {} frames were lost", feeder.failed, feeder.sent + feeder.failed);
    }
    Ok(if feeder.failed == 0 && !feeder.cut { Outcome::Done } else { Outcome::Lost })
}

/// Hands the last picture to readers that come while `feed` waits for the next one. On a thread of its own: a pipe is
/// silent for as long as it likes, and a slow pace sleeps.
fn serving_late_joiners(
    port: &OnceLock<Port>,
    feed: impl FnOnce() -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    std::thread::scope(|scope| {
        let (feeding, over) = channel::<()>();
        let serve = move || {
            while over.recv_timeout(LATE_JOINER_PERIOD) == Err(RecvTimeoutError::Timeout) {
                if let Some(Err(error)) = port.get().map(|port| port.publisher.refresh()) {
                    warn!("late readers are not served: {error}");
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

/// A camera of the first picture's size.
struct Feeder<'a> {
    camera: CameraName,
    optics: Optics,
    port: &'a OnceLock<Port>,
    sent: u64,
    failed: u64,
    cut: bool,
}

/// The owner of the `rgb` topic.
struct Port {
    publisher: Publisher,
    size: (u32, u32),
    /// As many bytes as there is room for.
    room: usize,
}

impl<'a> Feeder<'a> {
    fn new(camera: CameraName, optics: Optics, port: &'a OnceLock<Port>) -> Self {
        Self { camera, optics, port, sent: 0, failed: 0, cut: false }
    }

    fn run(
        &mut self,
        source: &mut dyn Source,
        mut pacer: Option<Pacer>,
        limit: Option<NonZeroU64>,
        stop: &Stop,
    ) -> anyhow::Result<()> {
        let mut frame = Frame::default();
        let limit = limit.map_or(u64::MAX, NonZeroU64::get);
        let mut next_is_due = true;
        while self.sent + self.failed < limit && !stop.requested() {
            if next_is_due && let Some(pacer) = &mut pacer {
                stop.sleep(pacer.wait(Instant::now()));
            }
            let fill = source.fill(&mut frame);
            next_is_due = fill.had_frame();
            match fill {
                Fill::Frame => self.send(&frame, stop)?,
                Fill::Failed(error) => self.lose(&frame, &error),
                Fill::Nothing | Fill::Crowded => {}
                Fill::End => break,
                Fill::Cut(_) | Fill::Broken(_) if stop.requested() => break,
                Fill::Cut(error) => {
                    error!("the source ends early: {error:#}");
                    self.cut = true;
                    break;
                }
                Fill::Broken(error) => return Err(error),
            }
        }
        Ok(())
    }

    fn send(&mut self, frame: &Frame, stop: &Stop) -> anyhow::Result<()> {
        let port = match self.port.get() {
            Some(port) => port,
            None => match Port::open(&self.camera, frame, stop) {
                Err(_) if stop.requested() => return Ok(()),
                opened => {
                    let opened = opened?;
                    self.port.get_or_init(|| opened)
                }
            },
        };
        if let Err(error) = port.has_room(frame) {
            self.lose(frame, &error);
            return Ok(());
        }
        match self.optics.camera_of(frame) {
            Ok(camera) => {
                port.send(frame, camera)?;
                self.sent += 1;
            }
            Err(error) => self.lose(frame, &error.into()),
        }
        Ok(())
    }

    fn lose(&mut self, frame: &Frame, error: &anyhow::Error) {
        warn!("frame {} is lost: {error:#}", frame.sequence);
        self.failed += 1;
    }
}

impl Port {
    fn open(camera: &CameraName, frame: &Frame, stop: &Stop) -> anyhow::Result<Self> {
        let room = frame.view()?.bytes().len();
        let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: room };
        let publisher = Publisher::create_unless(camera, &[plan], &Limits::default(), &|| stop.requested())?;
        let (width, height) = frame.size;
        info!("camera `{camera}`: {width}x{height}, {} of shared memory", publisher.reservation());
        Ok(Self { publisher, size: frame.size, room })
    }

    /// Shared memory is reserved once, for pictures like the first.
    fn has_room(&self, frame: &Frame) -> anyhow::Result<()> {
        let view = frame.view()?;
        let bytes = view.bytes().len();
        ensure!(
            frame.size == self.size,
            "a picture of {:?} from a camera that began with {:?}: a camera has one size",
            frame.size,
            self.size
        );
        ensure!(
            bytes <= self.room,
            "a picture of {bytes} bytes ({}) from a camera that began with {}: a camera has one format",
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
        Ok(self.publisher.notify(Wake::Picture)?)
    }
}

fn describe(header: &mut FrameHeader, frame: &Frame, format: PixelFormat, camera: Option<Camera>) {
    *header = FrameHeader::default();
    header.sequence = frame.sequence;
    header.capture_nanos = frame.capture.nanos;
    header.capture_unix_nanos = frame.capture.unix_nanos;
    header.set_capture_clock(frame.capture.clock);
    header.set_encoding(format.into());
    (header.width, header.height) = frame.size;
    header.row_stride_bytes = frame.row_stride;
    if let Some(camera) = camera {
        header.set_camera(&(&camera).into());
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;

    /// Silence before each picture, none of which can be read: they need no shared memory.
    struct Sparse(u64);

    impl Source for Sparse {
        fn fill(&mut self, _frame: &mut Frame) -> Fill {
            self.0 += 1;
            if self.0.is_multiple_of(10) {
                Fill::Failed(anyhow::anyhow!("unreadable"))
            } else {
                Fill::Nothing
            }
        }
    }

    /// A grey picture, and then a colour one.
    struct Turning(u64);

    impl Source for Turning {
        fn fill(&mut self, frame: &mut Frame) -> Fill {
            let format = if self.0 == 0 { PixelFormat::Mono8 } else { PixelFormat::Rgb8 };
            frame.rgb_buffer((4, 2));
            frame.format = Some(format);
            frame.row_stride = format.min_stride(4);
            frame.buffer(format.byte_len(4, 2, frame.row_stride));
            frame.sequence = self.0;
            self.0 += 1;
            Fill::Frame
        }
    }

    #[test]
    fn a_picture_that_there_is_no_room_for_is_lost_alone() {
        let camera = camera_name(&format!("turning_{}", std::process::id())).unwrap();
        let port = OnceLock::new();
        let mut feeder = Feeder::new(camera, Optics::default(), &port);
        feeder.run(&mut Turning(0), None, NonZeroU64::new(3), &Stop::default()).unwrap();
        assert_eq!((feeder.sent, feeder.failed), (1, 2));
    }

    #[test]
    fn a_rate_is_of_frames_and_silence_costs_no_turn() {
        let stop = Stop::default();
        let (send, failed) = channel();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let port = OnceLock::new();
                let mut feeder = Feeder::new(camera_name("sparse").unwrap(), Optics::default(), &port);
                // Nobody waits for a second turn of this rate.
                let pacer = Pacer::new(Rate::Hz(0.001), Instant::now());
                feeder.run(&mut Sparse(0), pacer, NonZeroU64::new(1), &stop).unwrap();
                send.send(feeder.failed).unwrap();
            });
            let failed = failed.recv_timeout(Duration::from_secs(60));
            stop.request();
            assert_eq!(failed, Ok(1), "the first frame is due at once");
        });
    }
}
