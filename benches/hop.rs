//! How long a frame takes from its publisher to its reader, by payload size. Nothing is copied, so size
//! should not matter.
//!
//! `hop/wake/SIZE` is two processes: from before the send to the received view, with the reader asleep (its
//! clock is the publisher's, `CLOCK_MONOTONIC`). `hop/loan_publish_receive/SIZE` is one process; its reader
//! does not sleep.

#![expect(clippy::unwrap_used, reason = "a benchmark may stop at the first thing that is wrong")]

use std::hint::black_box;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput};
use nunet_ipc::{CameraName, Limits, Publisher, Reader, Topic, TopicPlan, Wake, monotonic_nanos};

const SIZES: [usize; 5] = [64 << 10, 256 << 10, 1 << 20, 4 << 20, 16 << 20];
const TIMEOUT: Duration = Duration::from_secs(10);
/// The camera that the reader's process reads; set in that process only.
const READER: &str = "NUNET_BENCH_HOP_READER";

fn main() {
    if let Ok(camera) = std::env::var(READER) {
        return read(&camera);
    }
    let mut criterion = Criterion::default().configure_from_args();
    wake(&mut criterion);
    loan_publish_receive(&mut criterion);
    criterion.final_summary();
}

fn wake(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("hop/wake");
    for bytes in SIZES {
        let publisher = publisher(bytes);
        let mut reader = ReaderProcess::spawn(publisher.camera());
        group.throughput(Throughput::Bytes(bytes as u64));
        group.bench_function(BenchmarkId::from_parameter(name_of(bytes)), |bencher| {
            bencher.iter_custom(|frames| (0..frames).map(|_| hop(&publisher, &mut reader)).sum());
        });
    }
    group.finish();
}

/// One frame to the other process, which answers with the time at which it had the view.
fn hop(publisher: &Publisher, reader: &mut ReaderProcess) -> Duration {
    let loan = publisher.loan(Topic::Depth).unwrap();
    let sent = monotonic_nanos();
    loan.publish(sent).unwrap();
    publisher.notify(Wake::Depth).unwrap();
    let mut line = String::new();
    reader.answers.read_line(&mut line).unwrap();
    let received: i64 = line.trim().parse().unwrap();
    Duration::from_nanos(received.abs_diff(sent))
}

fn loan_publish_receive(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("hop/loan_publish_receive");
    for bytes in SIZES {
        let publisher = publisher(bytes);
        let reader = Reader::open(publisher.camera(), &[Topic::Depth], TIMEOUT).unwrap();
        group.throughput(Throughput::Bytes(bytes as u64));
        group.bench_function(BenchmarkId::from_parameter(name_of(bytes)), |bencher| {
            bencher.iter(|| {
                publisher.loan(Topic::Depth).unwrap().publish(0).unwrap();
                black_box(reader.latest(Topic::Depth).unwrap().unwrap().bytes().len())
            });
        });
    }
    group.finish();
}

fn publisher(payload_bytes: usize) -> Publisher {
    let camera =
        CameraName::new(&format!("bench-{}-{}", std::process::id(), name_of(payload_bytes))).unwrap();
    let plan = TopicPlan { topic: Topic::Depth, payload_bytes };
    Publisher::create(&camera, &[plan], &Limits::default()).unwrap()
}

fn name_of(bytes: usize) -> String {
    if bytes < 1 << 20 { format!("{}KB", bytes >> 10) } else { format!("{}MB", bytes >> 20) }
}

/// This program again, as a reader.
struct ReaderProcess {
    child: Child,
    answers: BufReader<ChildStdout>,
}

impl ReaderProcess {
    fn spawn(camera: &CameraName) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.env(READER, camera.as_str()).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut answers = BufReader::new(child.stdout.take().unwrap());
        let mut ready = String::new();
        answers.read_line(&mut ready).unwrap();
        Self { child, answers }
    }
}

impl Drop for ReaderProcess {
    fn drop(&mut self) {
        drop(self.child.stdin.take()); // ends it
        let _ = self.child.wait();
    }
}

/// Answers every frame with the time, until the benchmark's end of the pipe is closed.
fn read(camera: &str) {
    std::thread::spawn(|| {
        let _ = std::io::stdin().read_line(&mut String::new());
        END.store(true, std::sync::atomic::Ordering::Relaxed);
    });
    let reader = Reader::open(&CameraName::new(camera).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    let mut output = std::io::stdout();
    writeln!(output, "ready").unwrap();
    while !END.load(std::sync::atomic::Ordering::Relaxed) {
        reader.wait(Duration::from_millis(100)).unwrap();
        if let Some(frame) = reader.latest(Topic::Depth).unwrap() {
            black_box(frame.bytes().len());
            writeln!(output, "{}", monotonic_nanos()).unwrap();
        }
    }
}

static END: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);
