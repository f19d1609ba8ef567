//! The policy with a simulated machine: its time advances in waits, and cameras are plugged in and out.

#[path = "../../tests/suite/mod.rs"]
mod suite;

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};

use image::{Rgb, RgbImage};
use nunet_core::frame::PixelFormat;

use self::suite::{Subject, assert_frames};
use super::device::{BufferFormat, Capability, ControlRange, Errno, FourCc, Interval, Intervals, Sizes};
use super::*;
use crate::jpeg::JpegError;
use crate::{CameraSetting, CameraSettings};

const MS: i64 = 1_000_000;
const SECOND: i64 = 1000 * MS;
const PATH: &str = "/dev/video0";
const SIZE: ImageSize = ImageSize::new(4, 2);
const REQUESTED: RequestedMode = RequestedMode { size: SIZE, hz: 30.0, settings: CameraSettings::UNCHANGED };
const NV12: FourCc = FourCc::new(b"NV12");
const YUYV: FourCc = FourCc::new(b"YUYV");
const MJPG: FourCc = FourCc::new(b"MJPG");
const GREY: FourCc = FourCc::new(b"GREY");
const H264: FourCc = FourCc::new(b"H264");

/// A filled buffer.
#[derive(Clone)]
struct Shot {
    bytes: Vec<u8>,
    flawed: bool,
    taken_nanos: Option<i64>,
}

/// A format with its sizes and their rates.
type Offer = (FourCc, Vec<(Sizes, Vec<Intervals>)>);

/// The machine, as the test sees and changes it.
#[derive(Default)]
struct World {
    now_nanos: i64,
    /// What the camera that is plugged in offers; `None` while none is.
    camera: Option<Vec<Offer>>,
    /// Counts the times that a camera was unplugged: what was opened before is dead.
    unplugged: u32,
    kind: Option<Capability>,
    refuses_open: Option<Errno>,
    refuses_start: Option<Errno>,
    /// What the driver makes of the format asked for, where it does not obey.
    chooses: Option<BufferFormat>,
    filled: VecDeque<Shot>,
    asked: Option<(FourCc, ImageSize, Interval)>,
    /// The times at which the camera was opened.
    tries: Vec<i64>,
    /// Devices that are open.
    open: usize,
    /// The controls of the camera, with their ranges and the values that are refused.
    controls: Vec<(u32, ControlRange, Vec<i32>)>,
    /// What was set.
    set: Vec<(u32, i32)>,
    /// Buffers that were taken and not given back.
    held: usize,
    most_held: usize,
}

#[derive(Clone, Default)]
struct FakeHost(Arc<Mutex<World>>);

struct FakeDevice {
    world: FakeHost,
    /// How often a camera had been unplugged when it was opened.
    born: u32,
    buffers: Vec<Vec<u8>>,
    set: Option<(FourCc, ImageSize)>,
}

impl FakeHost {
    fn with(offers: Vec<Offer>) -> Self {
        let host = Self::default();
        host.world().camera = Some(offers);
        host.world().now_nanos = 100 * SECOND;
        host
    }

    /// A camera of one format, 4x2 at 30 Hz.
    fn of(format: FourCc) -> Self {
        Self::with(vec![one(format, SIZE, 30.0)])
    }

    fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap()
    }

    fn open(&self) -> V4l2Camera<Self> {
        self.try_open(REQUESTED).unwrap()
    }

    fn try_open(&self, requested: RequestedMode) -> Result<V4l2Camera<Self>, SourceError> {
        V4l2Camera::open(self.clone(), Path::new(PATH), requested)
    }

    /// Fills a buffer now.
    fn shoot(&self, bytes: impl Into<Vec<u8>>) {
        let mut world = self.world();
        let shot = Shot { bytes: bytes.into(), flawed: false, taken_nanos: Some(world.now_nanos) };
        world.filled.push_back(shot);
    }

    fn unplug(&self) {
        let mut world = self.world();
        world.camera = None;
        world.unplugged += 1;
        world.filled.clear();
        world.held = 0;
    }

    fn plug_in(&self, offers: Vec<Offer>) {
        self.world().camera = Some(offers);
    }
}

fn one(format: FourCc, size: ImageSize, hz: f64) -> Offer {
    (format, vec![(Sizes::One(size), vec![Intervals::One(Interval::of_hz(hz))])])
}

impl Host for FakeHost {
    fn open(&mut self, _path: &Path) -> device::Result<Box<dyn Device>> {
        let mut world = self.world();
        let now = world.now_nanos;
        world.tries.push(now);
        assert_eq!(
            world.open, 0,
            "a lost camera that is still open keeps its path from the one that is plugged in"
        );
        if let Some(errno) = world.refuses_open {
            return Err(errno);
        }
        if world.camera.is_none() {
            return Err(Errno::NOENT);
        }
        let born = world.unplugged;
        world.open += 1;
        Ok(Box::new(FakeDevice { world: self.clone(), born, buffers: Vec::new(), set: None }))
    }

    fn nodes(&self) -> Vec<PathBuf> {
        self.world().camera.iter().map(|_| PATH.into()).collect()
    }

    fn now(&self) -> Now {
        let monotonic_nanos = self.world().now_nanos;
        Now { monotonic_nanos, unix_nanos: monotonic_nanos + 1000 * SECOND }
    }

    fn pause(&self, time: Duration) {
        self.world().now_nanos += time.as_nanos() as i64;
    }
}

impl Drop for FakeDevice {
    fn drop(&mut self) {
        self.world.world().open -= 1;
    }
}

impl FakeDevice {
    fn alive(&self) -> device::Result<MutexGuard<'_, World>> {
        let world = self.world.world();
        if world.unplugged == self.born { Ok(world) } else { Err(Errno::NODEV) }
    }
}

impl Device for FakeDevice {
    fn capability(&mut self) -> device::Result<Capability> {
        let usual = Capability { name: "Fake Cam".into(), captures: true, streams: true };
        Ok(self.alive()?.kind.clone().unwrap_or(usual))
    }

    fn formats(&mut self) -> device::Result<Vec<FourCc>> {
        Ok(self.alive()?.camera.iter().flatten().map(|(format, _)| *format).collect())
    }

    fn sizes(&mut self, format: FourCc) -> device::Result<Vec<Sizes>> {
        let world = self.alive()?;
        let offers = world.camera.iter().flatten().filter(|(offered, _)| *offered == format);
        Ok(offers.flat_map(|(_, sizes)| sizes).map(|(sizes, _)| *sizes).collect())
    }

    fn intervals(&mut self, format: FourCc, size: ImageSize) -> device::Result<Vec<Intervals>> {
        let world = self.alive()?;
        let offers = world.camera.iter().flatten().filter(|(offered, _)| *offered == format);
        let fitting = offers.flat_map(|(_, sizes)| sizes).filter(|(sizes, _)| *sizes == Sizes::One(size));
        Ok(fitting.flat_map(|(_, intervals)| intervals.clone()).collect())
    }

    fn set_format(&mut self, format: FourCc, size: ImageSize) -> device::Result<BufferFormat> {
        let chosen = self.alive()?.chooses.unwrap_or(BufferFormat { format, size, row_stride: 0 });
        self.set = Some((chosen.format, chosen.size));
        Ok(chosen)
    }

    fn set_interval(&mut self, interval: Interval) -> device::Result<Option<Interval>> {
        let (format, size) = self.set.expect("the format comes first: it resets the rate");
        self.alive()?.asked = Some((format, size, interval));
        Ok(Some(interval))
    }

    fn start(&mut self, buffers: u32) -> device::Result<()> {
        self.buffers = vec![Vec::new(); buffers as usize];
        self.alive()?.refuses_start.map_or(Ok(()), Err)
    }

    fn wait(&mut self, timeout: Duration) -> device::Result<bool> {
        let mut world = self.alive()?;
        if world.filled.is_empty() {
            world.now_nanos += timeout.as_nanos() as i64;
        }
        Ok(!world.filled.is_empty())
    }

    fn dequeue(&mut self) -> device::Result<Option<Buffer>> {
        let mut world = self.alive()?;
        let Some(shot) = world.filled.pop_front() else { return Ok(None) };
        world.held += 1;
        world.most_held = world.most_held.max(world.held);
        drop(world);
        let index = self.buffers.len();
        let buffer = Buffer {
            index: index as u32,
            used: shot.bytes.len(),
            flawed: shot.flawed,
            taken_nanos: shot.taken_nanos,
        };
        self.buffers.push(shot.bytes);
        Ok(Some(buffer))
    }

    fn bytes(&self, buffer: &Buffer) -> &[u8] {
        &self.buffers[buffer.index as usize]
    }

    fn queue(&mut self, buffer: Buffer) -> device::Result<()> {
        // What is looked at after it was given back is another image.
        self.buffers[buffer.index as usize].fill(0xee);
        self.alive()?.held -= 1;
        Ok(())
    }

    fn control_range(&mut self, id: u32) -> device::Result<Option<ControlRange>> {
        let world = self.alive()?;
        Ok(world.controls.iter().find(|(own, ..)| *own == id).map(|(_, range, _)| *range))
    }

    fn set_control(&mut self, id: u32, value: i32) -> device::Result<()> {
        let mut world = self.alive()?;
        let control = world.controls.iter().find(|(own, ..)| *own == id).ok_or(Errno::INVAL)?;
        if control.2.contains(&value) {
            return Err(Errno::INVAL);
        }
        world.set.push((id, value));
        Ok(())
    }
}

/// The next image's bytes, or what came instead.
fn next(video: &mut V4l2Camera<FakeHost>) -> Result<Vec<u8>, Fill> {
    let mut frame = Frame::default();
    match video.fill(&mut frame) {
        Fill::Frame => Ok(frame.view().unwrap().bytes().to_vec()),
        other => Err(other),
    }
}

/// A camera that has been asked for an image already, so that nothing counts as old any more.
fn awake(host: &FakeHost) -> V4l2Camera<FakeHost> {
    let mut video = host.open();
    assert!(matches!(next(&mut video), Err(Fill::Nothing)));
    video
}

#[track_caller]
fn failure(fill: Result<Vec<u8>, Fill>) -> String {
    match fill {
        Err(Fill::Failed(error)) => {
            assert_eq!(error.kind(), SourceErrorKind::BadFrame, "{error:#}");
            format!("{error:#}")
        }
        other => panic!("{other:?} is no failure"),
    }
}

/// A JPEG that the camera sent must fail for what it lacks.
#[track_caller]
fn assert_damaged(fill: Result<Vec<u8>, Fill>, jpeg: &[u8]) -> JpegError {
    let reason = crate::jpeg::check(jpeg).unwrap_err();
    let failure = failure(fill);
    assert!(failure.ends_with(&reason.to_string()), "{failure}\ninstead of {reason}");
    reason
}

fn refusal(host: &FakeHost) -> String {
    let error = host.try_open(REQUESTED).err().expect("it is refused");
    let cause = std::error::Error::source(&error).and_then(|cause| cause.downcast_ref::<SourceError>());
    let hint = cause.and_then(nunet_types::Hint::hint);
    hint.map_or_else(|| format!("{error:#}"), |hint| format!("{error:#} | {hint}"))
}

/// Opening the camera must fail with this fault and its hint.
#[track_caller]
fn assert_refused(host: &FakeHost, fault: &CameraFault) {
    let expected = match fault.hint_on(host) {
        Some(hint) => format!("`{PATH}`: {fault} | {hint}"),
        None => format!("`{PATH}`: {fault}"),
    };
    let refusal = refusal(host);
    assert!(refusal.ends_with(&expected), "{refusal}\ninstead of {expected}");
}

fn jpeg(width: u32, height: u32) -> Vec<u8> {
    let image = RgbImage::from_pixel(width, height, Rgb([200, 100, 50]));
    let mut file = std::io::Cursor::new(Vec::new());
    image.write_to(&mut file, image::ImageFormat::Jpeg).unwrap();
    file.into_inner()
}

#[test]
fn raw_images_are_passed_on_unchanged() {
    for (format, lies, bytes) in
        [(YUYV, PixelFormat::Yuyv, 16), (NV12, PixelFormat::Nv12, 12), (GREY, PixelFormat::Mono8, 8)]
    {
        let host = FakeHost::of(format);
        let mut video = awake(&host);
        let image: Vec<u8> = (0..bytes).collect();
        host.shoot([&image[..], b"what a driver leaves behind"].concat());
        let mut frame = Frame { file: vec![1], ..Frame::default() };
        assert!(matches!(video.fill(&mut frame), Fill::Frame), "{format}");
        let view = frame.view().unwrap();
        assert_eq!((view.format(), view.size(), view.bytes()), (lies, SIZE, &image[..]));
        assert!(frame.file.is_empty(), "the file of the frame that used this buffer before");
    }
}

#[test]
fn rows_with_padding_stay_as_they_are() {
    let host = FakeHost::of(GREY);
    host.world().chooses = Some(BufferFormat { format: GREY, size: SIZE, row_stride: 6 });
    let mut video = awake(&host);
    host.shoot([1, 2, 3, 4, 0, 0, 5, 6, 7, 8]);
    assert_eq!(next(&mut video).unwrap(), [1, 2, 3, 4, 0, 0, 5, 6, 7, 8], "the last row needs no padding");
}

#[test]
fn a_jpeg_is_decoded_and_kept_for_recordings() {
    let host = FakeHost::of(MJPG);
    let mut video = awake(&host);
    host.shoot(jpeg(4, 2));
    let mut frame = Frame::default();
    assert!(matches!(video.fill(&mut frame), Fill::Frame));
    assert_eq!((frame.size, frame.format), (SIZE, Some(PixelFormat::Rgb8)));
    assert_eq!(frame.file, jpeg(4, 2));
    assert!(frame.view().unwrap().bytes()[0].abs_diff(200) < 8);
}

#[test]
fn of_several_images_the_newest_is_taken_and_the_others_go_back_to_the_driver() {
    let host = FakeHost::of(GREY);
    let mut video = awake(&host);
    for number in 1..=4 {
        host.shoot([number; 8]);
    }
    let mut frame = Frame::default();
    assert!(matches!(video.fill(&mut frame), Fill::Frame));
    assert_eq!(frame.view().unwrap().bytes(), [4; 8]);
    assert_eq!((frame.sequence, frame.superseded), (3, 3), "those that were passed over count");
    assert!(video.is_live(), "and so it is behind the source");
    host.shoot([5; 8]);
    assert!(matches!(video.fill(&mut frame), Fill::Frame));
    assert_eq!((frame.view().unwrap().bytes(), frame.sequence, frame.superseded), (&[5; 8][..], 4, 0));
    let world = host.world();
    assert_eq!((world.held, world.most_held), (0, 2), "one is kept while the next is looked at");
}

#[test]
fn buffers_filled_before_the_first_read_are_skipped() {
    let host = FakeHost::of(GREY);
    let mut video = host.open();
    host.shoot([1; 8]);
    host.world().now_nanos += 60 * SECOND;
    assert!(matches!(next(&mut video), Err(Fill::Nothing)), "and a slow start is no stalled camera");
    host.shoot([2; 8]);
    assert_eq!(next(&mut video).unwrap(), [2; 8]);
    assert_eq!(host.world().tries.len(), 1);
}

#[test]
fn each_bad_image_is_an_error_and_the_next_good_one_is_taken() {
    let host = FakeHost::of(GREY);
    let mut video = awake(&host);
    host.shoot([1; 8]);
    host.world().filled[0].flawed = true;
    insta::assert_snapshot!(
        failure(next(&mut video)),
        @"an image of `/dev/video0`: the driver reports that it is damaged"
    );
    host.shoot([]);
    insta::assert_snapshot!(
        failure(next(&mut video)),
        @"an image of `/dev/video0`: it is empty"
    );
    host.shoot([1; 7]);
    let short = failure(next(&mut video));
    assert_eq!(short, "an image of `/dev/video0`: it has 7 bytes; GREY 4x2 at 30 Hz takes 8");
    host.shoot([9; 8]);
    let mut frame = Frame::default();
    assert!(matches!(video.fill(&mut frame), Fill::Frame));
    assert_eq!((frame.sequence, frame.segment), (3, 0), "bad ones count, and the stream goes on");
    let world = host.world();
    assert_eq!((world.held, world.tries.len()), (0, 1));
}

/// The rules that `tests/conformance.rs` checks for other sources.
#[test]
fn a_camera_follows_the_rules_of_all_sources() {
    const SMALL: ImageSize = ImageSize::new(2, 2);
    let host = FakeHost::with(vec![one(GREY, SMALL, 30.0)]);
    let mut video = host.try_open(RequestedMode { size: SMALL, ..REQUESTED }).unwrap();
    assert!(matches!(next(&mut video), Err(Fill::Nothing)));
    // The second image is too short.
    let offer = move |number: u64| host.shoot(vec![9_u8; if number == 1 { 3 } else { 4 }]);
    assert_frames(Subject {
        name: "V4L2",
        source: Box::new(video),
        has_bad_frames: true,
        has_sizes: false,
        offer: Box::new(offer),
    });
}

#[test]
fn jpegs_that_are_damaged_cut_off_or_of_another_size_fail() {
    let host = FakeHost::of(MJPG);
    let mut video = awake(&host);
    let whole = jpeg(4, 2);
    let cut = &whole[..whole.len() - 3];
    host.shoot(cut);
    assert_damaged(next(&mut video), cut);
    host.shoot(*b"\xff\xd8 no JPEG at all \xff\xd9");
    failure(next(&mut video));
    host.shoot([0; 100]);
    failure(next(&mut video));
    host.shoot(jpeg(8, 8));
    let other_size = failure(next(&mut video));
    assert!(other_size.contains("8x8") && other_size.contains("4x2"), "{other_size}");
    host.shoot(whole);
    assert!(next(&mut video).is_ok());
}

#[test]
fn the_driver_s_time_is_the_time_of_capture_where_it_can_be_one() {
    let host = FakeHost::of(GREY);
    let mut video = awake(&host);
    let mut frame = Frame::default();
    let arrived = host.world().now_nanos;
    for (taken, expected) in [
        (Some(arrived - 20 * MS), arrived - 20 * MS),
        (None, arrived),
        (Some(0), arrived),
        (Some(arrived + MS), arrived),
        (Some(i64::MIN), arrived),
    ] {
        host.shoot([1; 8]);
        host.world().filled[0].taken_nanos = taken;
        assert!(matches!(video.fill(&mut frame), Fill::Frame));
        assert_eq!(frame.capture.nanos, expected, "{taken:?}");
        assert_eq!(frame.capture.unix_nanos, expected + 1000 * SECOND, "{taken:?}");
        assert_eq!(frame.capture.clock, Clock::Monotonic);
    }
}

#[test]
fn an_unplugged_camera_is_retried_with_growing_pauses_until_it_is_back() {
    let host = FakeHost::of(GREY);
    let mut video = awake(&host);
    host.shoot([1; 8]);
    next(&mut video).unwrap();
    host.unplug();
    let lost = host.world().now_nanos;
    while host.world().now_nanos < lost + 20 * SECOND {
        assert!(matches!(next(&mut video), Err(Fill::Nothing)));
    }
    let tries: Vec<_> = host.world().tries[1..].iter().map(|nanos| (nanos - lost) / MS).collect();
    assert_eq!(tries, [200, 600, 1400, 3000, 6200, 11_200, 16_200]);
    host.plug_in(vec![one(YUYV, ImageSize::new(8, 2), 15.0)]);
    let mut frame = Frame::default();
    while host.world().tries.len() < 9 {
        assert!(matches!(video.fill(&mut frame), Fill::Nothing));
    }
    host.shoot([7; 32]);
    assert!(matches!(video.fill(&mut frame), Fill::Frame));
    assert_eq!(
        (frame.size, frame.format),
        (ImageSize::new(8, 2), Some(PixelFormat::Yuyv)),
        "another camera, configured again"
    );
    assert_eq!((frame.sequence, frame.segment), (1, 1), "it does not follow the last one");
}

#[test]
fn a_silent_camera_is_reopened_and_reported_back_only_after_a_frame() {
    let host = FakeHost::of(GREY);
    let mut video = awake(&host);
    let start = host.world().now_nanos;
    while host.world().now_nanos < start + 30 * SECOND {
        assert!(matches!(next(&mut video), Err(Fill::Nothing)));
    }
    let tries: Vec<_> = host.world().tries[1..].iter().map(|nanos| (nanos - start) / SECOND).collect();
    assert_eq!(tries, [3, 6, 10, 15, 21, 29], "3 s without images, then a longer wait each time");
    host.shoot([1; 8]);
    while next(&mut video).is_err() {
        if host.world().filled.is_empty() {
            host.shoot([1; 8]);
        }
    }
    assert_eq!(video.health.wait(host.world().now_nanos), Duration::ZERO);
}

#[test]
fn a_slow_camera_has_time_for_its_frames() {
    let host = FakeHost::with(vec![one(GREY, SIZE, 0.5)]);
    let mut video = awake(&host);
    let start = host.world().now_nanos;
    while host.world().now_nanos < start + 9 * SECOND {
        assert!(matches!(next(&mut video), Err(Fill::Nothing)));
    }
    assert_eq!(host.world().tries.len(), 1, "2 s a frame: 9 s are no stall");
}

#[test]
fn a_camera_that_comes_back_busy_or_without_rights_or_formats_is_tried_until_it_can_be_used() {
    let host = FakeHost::of(GREY);
    let mut video = awake(&host);
    host.unplug();
    let wait = |video: &mut V4l2Camera<FakeHost>, seconds: i64| {
        let until = host.world().now_nanos + seconds * SECOND;
        while host.world().now_nanos < until {
            assert!(matches!(next(video), Err(Fill::Nothing)));
        }
    };
    host.plug_in(vec![one(GREY, SIZE, 30.0)]);
    host.world().refuses_open = Some(Errno::ACCESS);
    wait(&mut video, 6);
    host.world().refuses_open = None;
    host.world().refuses_start = Some(Errno::BUSY);
    wait(&mut video, 6);
    host.world().refuses_start = None;
    host.plug_in(vec![one(H264, SIZE, 30.0)]);
    wait(&mut video, 6);
    host.plug_in(vec![one(GREY, SIZE, 30.0)]);
    wait(&mut video, 6);
    host.shoot([3; 8]);
    assert_eq!(next(&mut video).unwrap(), [3; 8]);
}

#[test]
fn a_device_that_cannot_be_used_at_startup_is_an_error_with_its_reason() {
    let host = FakeHost::default();
    assert_refused(&host, &CameraFault::Missing);
    assert!(refusal(&host).contains("/dev/video*"), "there is no device to name");
    let host = FakeHost::of(GREY);
    for (errno, fault, named) in [
        (Errno::NOENT, CameraFault::Missing, "`/dev/video0`; `nunetd doctor`"),
        (Errno::NOTTY, CameraFault::NoVideo, "`/dev/video0`; `nunetd doctor`"),
        (Errno::ACCESS, CameraFault::Forbidden, "usermod -aG video"),
        (Errno::BUSY, CameraFault::Busy, "`fuser"),
        (Errno::IO, CameraFault::Failed { step: "open it", errno: Errno::IO }, "open it"),
    ] {
        host.world().refuses_open = Some(errno);
        assert_refused(&host, &fault);
        assert!(refusal(&host).contains(named), "{fault}");
    }
    host.world().refuses_open = None;
    for (errno, fault) in [(Errno::BUSY, CameraFault::Busy), (Errno::NOSPC, CameraFault::NoBandwidth)] {
        host.world().refuses_start = Some(errno);
        assert_refused(&host, &fault);
    }
}

#[test]
fn a_device_of_another_kind_and_a_camera_of_unknown_formats_are_refused_by_name() {
    let host = FakeHost::of(GREY);
    let metadata = Capability { name: "Meta".into(), captures: false, streams: true };
    host.world().kind = Some(metadata.clone());
    assert_refused(&host, &CameraFault::NoCapture { name: "Meta".to_owned() });
    host.world().kind = Some(Capability { captures: true, streams: false, ..metadata });
    let what = "without mapped buffers";
    assert_refused(&host, &CameraFault::OtherCapture { name: "Meta".to_owned(), what });
    let host = FakeHost::with(vec![one(H264, SIZE, 30.0), one(FourCc::new(b"pBAA"), SIZE, 30.0)]);
    let error = refusal(&host);
    assert!(error.contains("H264, pBAA; ") && error.contains(" NV12, YUYV, RGB3"), "{error}");
    let error = refusal(&FakeHost::with(vec![]));
    assert!(error.contains("no format; ") && error.contains(" NV12, YUYV, RGB3"), "{error}");
}

#[test]
fn a_driver_that_chooses_what_cannot_be_read_is_refused() {
    let host = FakeHost::of(GREY);
    host.world().chooses = Some(BufferFormat { format: YUYV, size: SIZE, row_stride: 8 });
    assert_refused(&host, &CameraFault::OtherFormat { asked: GREY, got: YUYV });
    for (size, row_stride) in [(SIZE, 3), (ImageSize::new(0, 2), 0), (ImageSize::new(1 << 20, 2), 0)] {
        host.world().chooses = Some(BufferFormat { format: GREY, size, row_stride });
        assert_refused(&host, &CameraFault::NoLayout { size, row_stride });
    }
}

/// What is asked of a camera that offers all this.
fn asked(offers: Vec<Offer>, requested: RequestedMode) -> (FourCc, ImageSize, f64) {
    let host = FakeHost::with(offers);
    drop(host.try_open(requested).unwrap());
    let (format, size, interval) = host.world().asked.unwrap();
    (format, size, interval.hz().unwrap())
}

#[test]
fn the_nearest_size_comes_first_then_the_nearest_rate_then_the_format() {
    let requested = RequestedMode::default();
    let webcam = || {
        vec![
            one(MJPG, ImageSize::new(1280, 720), 30.0),
            one(YUYV, ImageSize::new(1280, 720), 10.0),
            one(MJPG, ImageSize::new(640, 480), 30.0),
            one(YUYV, ImageSize::new(640, 480), 30.000_03),
        ]
    };
    assert_eq!(asked(webcam(), requested).0, YUYV, "nothing to decode");
    let large = RequestedMode { size: ImageSize::new(1280, 720), ..REQUESTED };
    assert_eq!(asked(webcam(), large), (MJPG, ImageSize::new(1280, 720), 30.0), "raw would be too slow");
    let slow = RequestedMode { size: ImageSize::new(1280, 720), hz: 5.0, ..REQUESTED };
    assert_eq!(asked(webcam(), slow), (YUYV, ImageSize::new(1280, 720), 10.0));
    let both = vec![one(NV12, ImageSize::new(640, 360), 30.0), one(MJPG, ImageSize::new(640, 480), 5.0)];
    assert_eq!(asked(both, requested), (MJPG, ImageSize::new(640, 480), 5.0));
}

#[test]
fn gray_is_taken_only_where_there_is_no_color() {
    let requested = RequestedMode::default();
    let infrared = one(GREY, ImageSize::new(640, 480), 30.0);
    assert_eq!(asked(vec![infrared.clone(), one(MJPG, ImageSize::new(1920, 1080), 5.0)], requested).0, MJPG);
    assert_eq!(asked(vec![infrared], requested).0, GREY);
}

#[test]
fn a_driver_without_lists_gets_the_requested_mode() {
    assert_eq!(asked(vec![(YUYV, vec![])], RequestedMode::default()), (YUYV, ImageSize::new(640, 480), 30.0));
}

#[test]
fn cameras_are_listed_with_what_they_offer_and_what_would_be_taken() {
    let sizes = [ImageSize::new(320, 240), ImageSize::new(640, 480)].map(|size| (Sizes::One(size), vec![]));
    let mut host = FakeHost::with(vec![(YUYV, sizes.to_vec()), one(H264, ImageSize::new(1920, 1080), 30.0)]);
    let listed = |host: &mut FakeHost| -> Vec<Result<String, String>> {
        let text = |(problem, hint): (String, Option<std::borrow::Cow<'_, str>>)| match hint {
            Some(hint) => format!("{problem} | {hint}"),
            None => problem,
        };
        list::cameras_of(host).into_iter().map(|camera| camera.offer.map_err(text)).collect()
    };
    let all = "Fake Cam offers YUYV 320x240 to 640x480, H264 1920x1080 (not read); nunetd takes YUYV 640x480";
    assert_eq!(listed(&mut host), [Ok(all.to_owned())]);
    assert!(host.world().asked.is_none(), "looking changes nothing");
    host.plug_in(vec![one(H264, ImageSize::new(8, 8), 30.0)]);
    assert_eq!(
        listed(&mut host),
        [Ok("Fake Cam offers H264 8x8 (not read); nunetd reads none of them".into())]
    );
    host.world().refuses_open = Some(Errno::ACCESS);
    assert!(
        listed(&mut host)[0]
            .as_ref()
            .is_err_and(|why| why.starts_with(&format!("{} | ", CameraFault::Forbidden)))
    );
    host.world().refuses_open = Some(Errno::NOTTY);
    assert!(listed(&mut host).is_empty());
    assert!(listed(&mut FakeHost::default()).is_empty());
}

#[test]
fn formats_that_need_a_conversion_are_read_as_recordings_are() {
    let planes = [1, 2, 3, 4, 5, 6, 7, 8, 50, 51, 60, 61];
    let pairs = |first: [u8; 2], second: [u8; 2]| [&planes[..8], &first, &second].concat();
    for (letters, sent, expected) in [
        (b"YU12", planes.to_vec(), pairs([50, 60], [51, 61])),
        (b"YV12", planes.to_vec(), pairs([60, 50], [61, 51])),
        (b"NV21", planes.to_vec(), pairs([51, 50], [61, 60])),
        (b"UYVY", (0..16).collect(), vec![1, 0, 3, 2, 5, 4, 7, 6, 9, 8, 11, 10, 13, 12, 15, 14]),
        (b"BGR3", (0..24).collect(), (0..24).collect()),
        (b"RGB3", (0..24).collect(), (0..24).collect()),
    ] {
        let host = FakeHost::of(FourCc::new(letters));
        let mut video = awake(&host);
        host.shoot(sent);
        assert_eq!(next(&mut video).unwrap(), expected, "{}", FourCc::new(letters));
    }
}

#[test]
fn a_jpeg_that_lost_its_middle_fails_and_one_without_tables_is_read() {
    let host = FakeHost::with(vec![one(MJPG, ImageSize::new(64, 48), 30.0)]);
    let mut video = host.try_open(RequestedMode { size: ImageSize::new(64, 48), ..REQUESTED }).unwrap();
    while !matches!(next(&mut video), Err(Fill::Nothing)) {}
    host.shoot(nunet_testkit::cases::read("mjpeg_without_tables/no_dht.jpg"));
    assert!(next(&mut video).is_ok());
    let lost = nunet_testkit::cases::read("jpeg_lost_middle/lost.jpg");
    host.shoot(lost.clone());
    let reason = assert_damaged(next(&mut video), &lost);
    assert!(matches!(reason, JpegError::EndedEarly { .. }), "{reason}");
}

const EXPOSURE_MODE: u32 = 0x009a_0901;
const EXPOSURE_TIME: u32 = 0x009a_0902;
const AUTOMATIC_GAIN: u32 = 0x0098_0912;
const GAIN: u32 = 0x0098_0913;

/// A webcam: exposure of 0.3 to 200 ms, automatic by aperture priority alone.
fn webcam() -> FakeHost {
    let host = FakeHost::of(GREY);
    let range = |least, most| ControlRange { least, most };
    host.world().controls = vec![
        (EXPOSURE_MODE, range(0, 3), vec![0, 2]),
        (EXPOSURE_TIME, range(3, 2000), vec![]),
        (AUTOMATIC_GAIN, range(0, 1), vec![]),
        (GAIN, range(0, 64), vec![]),
    ];
    host
}

/// What is set in a camera, or why it is not.
fn set_in(host: &FakeHost, exposure: &str, gain: &str) -> Result<Vec<(u32, i32)>, String> {
    let parse = |text: &str| (!text.is_empty()).then(|| text.parse::<CameraSetting>().unwrap());
    let settings = CameraSettings { exposure: parse(exposure), gain: parse(gain) };
    host.world().set.clear();
    match host.try_open(RequestedMode { settings, ..REQUESTED }) {
        Ok(_) => Ok(host.world().set.clone()),
        Err(error) => {
            assert_eq!(error.kind(), SourceErrorKind::Argument);
            Err(format!("{error:#}"))
        }
    }
}

#[test]
fn exposure_and_gain_are_set_by_the_controls_that_a_camera_has_and_are_else_left_alone() {
    let host = webcam();
    assert_eq!(set_in(&host, "", ""), Ok(vec![]));
    assert_eq!(set_in(&host, "auto", "auto"), Ok(vec![(EXPOSURE_MODE, 3), (AUTOMATIC_GAIN, 1)]));
    let manual = vec![(EXPOSURE_MODE, 1), (EXPOSURE_TIME, 80), (AUTOMATIC_GAIN, 0), (GAIN, 16)];
    assert_eq!(set_in(&host, "8000", "16"), Ok(manual));
    host.world().controls.retain(|(id, ..)| [EXPOSURE_TIME, GAIN].contains(id));
    assert_eq!(set_in(&host, "8040", "16"), Ok(vec![(EXPOSURE_TIME, 80), (GAIN, 16)]));
}

#[test]
fn a_missing_control_and_a_value_out_of_range_are_refused() {
    let host = webcam();
    let refused = |exposure, gain| set_in(&host, exposure, gain).unwrap_err();
    for (exposure, gain, expected) in [
        ("100", "", "it takes exposure times from 300 to 200000 \u{b5}s, not 100 \u{b5}s"),
        ("4000000000", "", "to 200000 \u{b5}s, not 4000000000"),
        ("", "65", "it takes gains from 0 to 64, not 65"),
        ("", "4000000000", "it takes gains from 0 to 64"),
    ] {
        let error = refused(exposure, gain);
        assert!(error.contains(expected), "{error}");
    }
    host.world().controls.clear();
    for (exposure, gain, expected) in [
        ("auto", "", "it has no control for automatic exposure"),
        ("8000", "", "it has no control for the exposure time"),
        ("", "auto", "it has no control for automatic gain"),
        ("", "1", "it has no control for gain"),
    ] {
        let error = refused(exposure, gain);
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn a_camera_that_is_plugged_in_again_is_set_again() {
    let host = webcam();
    let settings = CameraSettings { gain: Some(CameraSetting::Value(7)), ..CameraSettings::UNCHANGED };
    let mut video = host.try_open(RequestedMode { settings, ..REQUESTED }).unwrap();
    host.unplug();
    host.plug_in(vec![one(GREY, SIZE, 30.0)]);
    host.world().set.clear();
    while host.world().tries.len() < 2 {
        assert!(matches!(next(&mut video), Err(Fill::Nothing)));
    }
    assert!(host.world().set.contains(&(GAIN, 7)));
}

#[test]
fn planes_that_were_joined_are_read_as_one_image() {
    for (letters, format) in
        [(b"NM12", PixelFormat::Nv12), (b"NM21", PixelFormat::Nv12), (b"YM12", PixelFormat::Nv12)]
    {
        let host = FakeHost::of(FourCc::new(letters));
        let mut video = awake(&host);
        host.shoot((0..12).collect::<Vec<u8>>());
        let mut frame = Frame::default();
        assert!(matches!(video.fill(&mut frame), Fill::Frame));
        assert_eq!((frame.size, frame.format), (SIZE, Some(format)));
        assert_eq!(frame.view().unwrap().bytes()[..8], [0, 1, 2, 3, 4, 5, 6, 7]);
    }
}
