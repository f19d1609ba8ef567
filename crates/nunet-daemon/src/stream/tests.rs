//! Concurrent streams, with sources and disks that a test controls.

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Condvar, Mutex};
use std::time::Instant;

use nunet_core::graph::{GraphOptions, Provider, Runtime, SerialGraph};
use nunet_core::pipeline::{Pipeline, PipelineOptions};
use nunet_ipc::{CameraName, Encoding, Limits, Publisher, Reader, Topic, TopicPlan, monotonic_nanos};
use nunet_sink::archive::Archive;
use nunet_sink::last_frame::last_frame_into;
use nunet_sink::record::RecordedFrame;
use nunet_sink::recorder::record_into;
use nunet_testkit::models;
use nunet_types::ImageSize;

use super::*;
use crate::Outcome;
use crate::config::Publish;
use crate::sink::Sink;
use crate::sink::shm::{ShmPublisher, ShmPublisherOptions};
use crate::source::{CameraGeometry, CameraResolver, Fill, Frame, OpenOptions, SourceName};
use nunet_telemetry::DrainTimeout;

/// No test waits longer for anything.
const TIMEOUT: Duration = Duration::from_secs(60);
const SIZE: ImageSize = ImageSize::new(64, 48);

/// Gray images; of a live source one each millisecond.
struct Gray {
    left: u64,
    sequence: u64,
    live: bool,
}

impl Source for Gray {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        if self.left == 0 {
            return Fill::End;
        }
        if self.live {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.left -= 1;
        frame.sequence = self.sequence;
        self.sequence += 1;
        frame.rgb_buffer(SIZE).fill(100);
        frame.capture.nanos = monotonic_nanos();
        Fill::Frame
    }

    fn is_live(&self) -> bool {
        self.live
    }
}

/// A disk that stalls until it is released.
#[derive(Default)]
struct Disk {
    state: Mutex<DiskState>,
    changed: Condvar,
}

#[derive(Default)]
struct DiskState {
    asked: bool,
    free: bool,
    written: Vec<u64>,
}

impl Disk {
    /// Waits for `wanted`; says whether it came.
    fn wait(&self, wanted: impl Fn(&DiskState) -> bool) -> bool {
        let state = self.state.lock().unwrap();
        let (state, _) = self.changed.wait_timeout_while(state, TIMEOUT, |state| !wanted(state)).unwrap();
        wanted(&state)
    }

    fn set(&self, change: impl FnOnce(&mut DiskState)) {
        change(&mut self.state.lock().unwrap());
        self.changed.notify_all();
    }
}

/// Writes to a disk that the test shares.
struct OnDisk(Arc<Disk>);

impl Archive for OnDisk {
    fn path(&self) -> &Path {
        Path::new("disk of a test")
    }

    fn write(&mut self, record: &RecordedFrame) -> anyhow::Result<()> {
        self.0.set(|state| state.asked = true);
        anyhow::ensure!(self.0.wait(|state| state.free), "nobody let the disk go");
        self.0.set(|state| state.written.push(record.frame.sequence));
        Ok(())
    }

    fn sync(&mut self) -> anyhow::Result<()> {
        Ok(())
    }

    fn finish(self: Box<Self>) -> anyhow::Result<()> {
        Ok(())
    }
}

/// Also a test that fails comes to its end.
struct LetGo<'a>(&'a Disk, &'a Stop);

impl Drop for LetGo<'_> {
    fn drop(&mut self) {
        self.0.set(|state| state.free = true);
        self.1.request();
    }
}

fn camera(test: &str) -> CameraName {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    CameraName::new(&format!("{test}_{}_{number}", std::process::id())).unwrap()
}

fn pipeline() -> Pipeline {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.onnx");
    models::wnet(SIZE, true).write(&path);
    let runtime = Runtime::load(&nunet_testkit::runtime_library()).unwrap();
    let options = GraphOptions { provider: Provider::Cpu, ..GraphOptions::default() };
    let graph = SerialGraph::load(&path, &runtime, &options).unwrap();
    Pipeline::new(graph, PipelineOptions::default()).unwrap()
}

/// A sink that records to `disk`.
fn recorder(disk: &Arc<Disk>, notify: &Arc<Notify>) -> Vec<Box<dyn Sink>> {
    let notify = Arc::clone(notify);
    vec![record_into(Box::new(OnDisk(Arc::clone(disk))), Arc::new(move || notify.notify())).unwrap()]
}

fn stream(name: &CameraName, source: Gray, sinks: Vec<Box<dyn Sink>>) -> Stream {
    stream_of(name, Box::new(source), &[Publish::Depth], sinks)
}

fn stream_of(
    name: &CameraName,
    source: Box<dyn Source>,
    publish: &[Publish],
    sinks: Vec<Box<dyn Sink>>,
) -> Stream {
    let pipeline = pipeline();
    let options = ShmPublisherOptions {
        camera: name,
        frame_id: "camera",
        publish,
        obstacles: false,
        obstacle_frame: "base_link",
        limits: Limits::default(),
        model: "model.onnx",
        given_up: &|| false,
    };
    nunet_ipc::use_root(&nunet_testkit::ipc_root()).unwrap();
    let publisher = ShmPublisher::open(&pipeline, &options).unwrap();
    let task = StreamTask::new(pipeline, CameraResolver::default(), publisher, sinks);
    Stream { source, pace: Pace::ALL, task, span: Span::none() }
}

/// Waits until a frame of at least this number is out.
fn wait_for_frame(reader: &Reader, number: u64) -> u64 {
    let start = Instant::now();
    loop {
        assert!(start.elapsed() < TIMEOUT, "frame {number} never came");
        match reader.latest(Topic::Depth).unwrap().map(|frame| frame.header().sequence) {
            Some(sequence) if sequence >= number => return sequence,
            _ => drop(reader.wait(Duration::from_millis(100)).unwrap()),
        }
    }
}

#[test]
fn a_stalled_disk_delays_only_its_own_camera_and_drops_no_frame() {
    const FRAMES: u64 = 40;
    // Far more turns than the queues in front of the disk have places.
    const TURNS: u64 = 200;
    let (disk, notify, stop) = (Arc::new(Disk::default()), Arc::new(Notify::default()), Stop::default());
    let (recorded, live) = (camera("recorded"), camera("live"));
    let streams = vec![
        stream(&recorded, Gray { left: FRAMES, sequence: 0, live: false }, recorder(&disk, &notify)),
        stream(&live, Gray { left: u64::MAX, sequence: 0, live: true }, Vec::new()),
    ];
    let reader = Reader::open(&live, &[Topic::Depth], TIMEOUT).unwrap();
    let held = Reader::open(&recorded, &[Topic::Depth], TIMEOUT).unwrap();
    let mut ended = std::thread::scope(|scope| {
        let ended = scope.spawn(|| run(streams, &notify, &stop).unwrap());
        let _let_go = LetGo(&disk, &stop);
        assert!(disk.wait(|disk| disk.asked), "nothing was recorded");
        let now = wait_for_frame(&reader, 0);
        wait_for_frame(&reader, now + TURNS);
        let last = wait_for_frame(&held, 0);
        assert!(last + 1 < FRAMES, "the source that waits did not wait for its disk");
        disk.set(|state| state.free = true);
        let all = disk.wait(|state| state.written.len() as u64 == FRAMES);
        assert!(all, "not every frame of the source that waits came to the disk");
        stop.request();
        ended.join().unwrap()
    });
    assert_eq!(disk.state.lock().unwrap().written, (0..FRAMES).collect::<Vec<_>>());
    let StreamEnd { counts, mut summary, source } = ended.remove(0);
    assert_eq!((counts.captured, counts.published), (FRAMES, FRAMES));
    assert_eq!(source.unwrap(), SourceEnd::Complete);
    let recorded = summary.sinks.remove(0).wait(&mut DrainTimeout::new(&|| false));
    assert_eq!(recorded.unwrap(), Outcome::Done);
}

#[test]
fn a_stop_ends_a_run_whose_disk_stalls_and_unwritten_frames_count_as_dropped() {
    // As many frames as there is room for in front of the disk; then the source waits, and so does its next
    // frame.
    const UNDER_WAY: u64 = 8;
    let (disk, notify, stop) = (Arc::new(Disk::default()), Arc::new(Notify::default()), Stop::default());
    let name = camera("held");
    let source = Gray { left: u64::MAX, sequence: 0, live: false };
    let streams = vec![stream(&name, source, recorder(&disk, &notify))];
    let reader = Reader::open(&name, &[Topic::Depth], TIMEOUT).unwrap();
    std::thread::scope(|scope| {
        let (done, ended) = channel();
        let (notify, stop) = (&notify, &stop);
        let _let_go = LetGo(&disk, stop);
        scope.spawn(move || done.send(run(streams, notify, stop).unwrap()));
        wait_for_frame(&reader, UNDER_WAY - 1);
        stop.request();
        let mut ended = ended.recv_timeout(TIMEOUT).expect("the stop was not seen");
        let StreamEnd { counts, mut summary, source } = ended.remove(0);
        assert_eq!((counts.published, counts.failed, counts.in_flight), (UNDER_WAY, 0, 0));
        assert_eq!(counts.captured, UNDER_WAY + counts.superseded, "nothing is lost from the ledger");
        assert_ne!(source.unwrap(), SourceEnd::Truncated);
        let stopped = || stop.requested();
        let mut timeout = DrainTimeout::with(&stopped, Duration::from_millis(50), TIMEOUT);
        let recorded = summary.sinks.remove(0).wait(&mut timeout);
        assert_eq!(recorded.unwrap(), Outcome::Lost);
    });
}

#[test]
fn a_camera_whose_last_frame_cannot_be_written_delays_no_other() {
    const TURNS: u64 = 50;
    let folder = tempfile::tempdir().unwrap();
    // Opening it for writing never returns, as on a dead network mount, because no process reads it.
    let pipe = std::process::Command::new("mkfifo").arg(folder.path().join("depth.npy")).status().unwrap();
    assert!(pipe.success());
    let (disk, notify, stop) = (Arc::new(Disk::default()), Arc::new(Notify::default()), Stop::default());
    let (over, live) = (camera("over"), camera("beside"));
    let streams = vec![
        stream(
            &over,
            Gray { left: 3, sequence: 0, live: false },
            vec![last_frame_into(folder.path().to_owned(), false)],
        ),
        stream(&live, Gray { left: u64::MAX, sequence: 0, live: true }, Vec::new()),
    ];
    let reader = Reader::open(&live, &[Topic::Depth], TIMEOUT).unwrap();
    std::thread::scope(|scope| {
        let (done, ended) = channel();
        let (notify, stop) = (&notify, &stop);
        let _let_go = LetGo(&disk, stop);
        scope.spawn(move || done.send(run(streams, notify, stop).unwrap()));
        let start = Instant::now();
        while Reader::open(&over, &[Topic::Depth], Duration::ZERO).is_ok() {
            assert!(start.elapsed() < TIMEOUT, "the camera that has ended keeps its memory");
            std::thread::sleep(Duration::from_millis(10));
        }
        let now = wait_for_frame(&reader, 0);
        wait_for_frame(&reader, now + TURNS);
        stop.request();
        let mut ended = ended.recv_timeout(TIMEOUT).expect("the stop was not seen");
        let StreamEnd { counts, mut summary, .. } = ended.remove(0);
        assert_eq!((counts.captured, counts.published), (3, 3));
        let mut timeout = DrainTimeout::with(&|| true, Duration::ZERO, TIMEOUT);
        let error = summary.sinks.remove(0).wait(&mut timeout).unwrap_err();
        assert!(error.to_string().starts_with("cannot write the files in `"), "{error}");
    });
}

/// The frame that is kept for late readers of labels is the only one that the camera lends.
#[test]
fn a_camera_that_lends_one_frame_at_a_time_does_not_stall() {
    let (notify, stop, disk) = (Arc::new(Notify::default()), Stop::default(), Disk::default());
    let (lender, name) = (camera("lender"), camera("borrower"));
    nunet_ipc::use_root(&nunet_testkit::ipc_root()).unwrap();
    let plan = TopicPlan { topic: Topic::Rgb, payload_bytes: 3 * SIZE.pixel_count() };
    let limits = Limits { max_held_frames: 1, ..Limits::default() };
    let images = Publisher::create(&lender, &[plan], &limits).unwrap();
    let source = SourceName::parse(&format!("shm:{lender}")).open(OpenOptions::default()).unwrap();
    let streams = vec![stream_of(&name, source, &[Publish::Depth, Publish::Labels], Vec::new())];
    let reader = Reader::open(&name, &[Topic::Depth], TIMEOUT).unwrap();
    std::thread::scope(|scope| {
        let _let_go = LetGo(&disk, &stop);
        scope.spawn(|| run(streams, &notify, &stop).unwrap());
        let has_come = |sequence| {
            let newest = reader.latest(Topic::Depth).unwrap();
            newest.is_some_and(|frame| frame.header().sequence >= sequence)
        };
        for sequence in 0..3 {
            let mut loan = images.loan(Topic::Rgb).unwrap();
            let header = loan.header_mut();
            (header.sequence, header.width, header.height) = (sequence, SIZE.width, SIZE.height);
            header.row_stride_bytes = 3 * SIZE.width;
            header.set_encoding(Encoding::Rgb8);
            header.capture_nanos = monotonic_nanos();
            loan.publish(monotonic_nanos()).unwrap();
            let start = Instant::now();
            while !has_come(sequence) {
                assert!(start.elapsed() < TIMEOUT, "frame {sequence} never came");
                images.refresh().unwrap(); // for the source, which connects late
                reader.wait(Duration::from_millis(20)).unwrap();
            }
        }
    });
}

/// A source of another size than the camera that the user named.
#[test]
fn a_camera_that_fits_no_frame_ends_its_stream_at_the_first_one() {
    let (notify, stop) = (Arc::new(Notify::default()), Stop::default());
    let geometry = CameraGeometry {
        intrinsics: Some("50,50,32,18@64x36".parse().unwrap()),
        ..CameraGeometry::default()
    };
    let source = Gray { left: u64::MAX, sequence: 0, live: true };
    let stream = stream(&camera("misfit"), source, Vec::new());
    let task = stream.task.with_camera(CameraResolver::new(&geometry).unwrap());
    let mut ended = run(vec![Stream { task, ..stream }], &notify, &stop).unwrap();
    let StreamEnd { counts, source, .. } = ended.remove(0);
    let error = source.unwrap_err();
    assert!(crate::exit::is_usage(&error), "{error:#}");
    assert_eq!((counts.published, counts.failed, counts.in_flight), (0, 1, 0), "{counts:?}");
    assert!(counts.balances());
}
