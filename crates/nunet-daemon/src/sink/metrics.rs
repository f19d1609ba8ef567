//! `--metrics ADDRESS:PORT`: the frame counts and latencies for Prometheus.
//!
//! The library `prometheus-client` counts and writes the text format. The HTTP part answers `GET` and `HEAD` of one page,
//! each caller on a thread of its own, so that idle connections delay nobody.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};
use tracing::{debug, info};

use super::shm::stage_names;
use super::{FinishingSink, PublishedFrame, Results, Sink, SinkContext, Status, Wants};
use crate::exit::WithHint;

/// A caller that does not send a request or does not read the answer for so long is disconnected.
const CALLER_TIMEOUT: Duration = Duration::from_secs(2);
/// No request is longer.
const MAX_REQUEST_BYTES: usize = 8 << 10;
/// More connections at a time are refused: each has a thread.
const MAX_CALLERS: usize = 64;
/// Upper bounds of the histograms' buckets: from a small network on a fast machine to a stalled one.
const BUCKETS_S: [f64; 16] =
    [0.001, 0.0025, 0.005, 0.01, 0.02, 0.033, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.5, 10.0];
const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct CameraLabels {
    camera: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct EndLabels {
    camera: String,
    end: &'static str,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct StageLabels {
    camera: String,
    stage: String,
}

type Histograms<L> = Family<L, Histogram, fn() -> Histogram>;

/// The metrics of all cameras.
#[derive(Debug)]
struct Families {
    up: Family<CameraLabels, Gauge>,
    captured: Family<CameraLabels, Counter>,
    ended: Family<EndLabels, Counter>,
    in_flight: Family<CameraLabels, Gauge>,
    fps: Family<CameraLabels, Gauge<f64, AtomicU64>>,
    bytes_copied: Family<CameraLabels, Gauge<f64, AtomicU64>>,
    latency: Histograms<CameraLabels>,
    stage: Histograms<StageLabels>,
}

fn histogram() -> Histogram {
    Histogram::new(BUCKETS_S)
}

impl Families {
    /// Metrics without values; `registry` writes them.
    fn register(registry: &mut Registry) -> Self {
        let families = Self {
            up: Family::default(),
            captured: Family::default(),
            ended: Family::default(),
            in_flight: Family::default(),
            fps: Family::default(),
            bytes_copied: Family::default(),
            latency: Family::new_with_constructor(histogram),
            stage: Family::new_with_constructor(histogram),
        };
        let Self { up, captured, ended, in_flight, fps, bytes_copied, latency, stage } = &families;
        let help =
            "1 while the source of the camera gives frames, 0 while it is waited for and after its end";
        registry.register("camera_up", help, up.clone());
        registry.register("frames_captured", "Frames that the source handed over", captured.clone());
        registry.register("frames_ended", "Frames by how they ended", ended.clone());
        registry.register("frames_in_flight", "Frames that have not ended", in_flight.clone());
        registry.register("frames_per_second", "Published frames per second since the start", fps.clone());
        let help = "Bytes that were moved although they existed already, per frame";
        registry.register("bytes_copied_per_frame", help, bytes_copied.clone());
        let help = "From the source to the wake-up of the readers";
        registry.register_with_unit("latency", help, Unit::Seconds, latency.clone());
        registry.register_with_unit("stage", "Time of each stage", Unit::Seconds, stage.clone());
        families
    }
}

/// The endpoint. Its threads end with the process.
pub(crate) struct MetricsServer {
    families: Families,
}

impl MetricsServer {
    /// Opens the endpoint.
    ///
    /// # Errors
    /// The address is in use or is not an address of this machine.
    pub(crate) fn open(address: SocketAddr) -> anyhow::Result<Self> {
        let listener = TcpListener::bind(address).map_err(|error| {
            let message = format!("cannot serve metrics on `{address}`");
            WithHint::new(message, "pass --metrics 127.0.0.1:PORT with a free port").because(error)
        })?;
        info!("metrics on http://{}/metrics", listener.local_addr().unwrap_or(address));
        Self::serve(listener, CALLER_TIMEOUT)
    }

    fn serve(listener: TcpListener, timeout: Duration) -> anyhow::Result<Self> {
        let mut registry = Registry::with_prefix("nunet");
        let families = Families::register(&mut registry);
        let registry = Arc::new(registry);
        named("metrics").spawn(move || accept(&listener, &registry, timeout))?;
        Ok(Self { families })
    }

    /// The metrics of one camera, with the stages of its frames.
    fn sink<'a>(&self, camera: &str, stages: impl Iterator<Item = &'a str>) -> MetricsSink {
        let labels = CameraLabels { camera: camera.to_owned() };
        let end = |end| EndLabels { camera: camera.to_owned(), end };
        let stage = |stage: &str| StageLabels { camera: camera.to_owned(), stage: stage.to_owned() };
        let Families { up, captured, ended, in_flight, fps, bytes_copied, latency, stage: times } =
            &self.families;
        let sink = MetricsSink {
            up: up.get_or_create_owned(&labels),
            captured: captured.get_or_create_owned(&labels),
            published: ended.get_or_create_owned(&end("published")),
            superseded: ended.get_or_create_owned(&end("superseded")),
            failed: ended.get_or_create_owned(&end("failed")),
            in_flight: in_flight.get_or_create_owned(&labels),
            fps: fps.get_or_create_owned(&labels),
            bytes_copied: bytes_copied.get_or_create_owned(&labels),
            latency: latency.get_or_create_owned(&labels),
            stages: stages.map(|name| times.get_or_create_owned(&stage(name))).collect(),
        };
        // A camera is up until its source says otherwise.
        sink.up.set(1);
        sink
    }
}

/// Opens the sink if `--metrics` is given.
pub(super) fn open(context: &SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>> {
    let sink = context
        .metrics
        .map(|server| server.sink(context.config.name.as_str(), stage_names(context.pipeline)));
    Ok(sink.map(|sink| Box::new(sink) as Box<dyn Sink>))
}

/// One camera's metrics.
struct MetricsSink {
    up: Gauge,
    captured: Counter,
    published: Counter,
    superseded: Counter,
    failed: Counter,
    in_flight: Gauge,
    fps: Gauge<f64, AtomicU64>,
    bytes_copied: Gauge<f64, AtomicU64>,
    latency: Histogram,
    stages: Vec<Histogram>,
}

impl Sink for MetricsSink {
    fn wants(&self) -> Wants {
        Wants::default()
    }

    fn on_frame(&mut self, published: &PublishedFrame<'_>) {
        let seconds = |micros: u32| f64::from(micros) / 1e6;
        self.latency.observe(seconds(published.timings.total_micros));
        for (histogram, micros) in self.stages.iter().zip(published.timings.stages()) {
            histogram.observe(seconds(micros));
        }
    }

    fn on_status(&mut self, status: &Status<'_>) {
        self.up.set(i64::from(status.is_up));
        let set = |counter: &Counter, count| counter.inner().store(count, Ordering::Relaxed);
        set(&self.captured, status.counts.captured);
        set(&self.published, status.counts.published);
        set(&self.superseded, status.counts.superseded);
        set(&self.failed, status.counts.failed);
        self.in_flight.set(i64::try_from(status.counts.in_flight).unwrap_or(i64::MAX));
        self.fps.set(status.totals.fps());
        self.bytes_copied.set(status.totals.bytes_copied_per_frame());
    }

    fn finish(self: Box<Self>, _last: Option<&Results<'_>>) -> FinishingSink {
        self.up.set(0);
        FinishingSink::done()
    }
}

fn named(name: &str) -> std::thread::Builder {
    std::thread::Builder::new().name(name.into())
}

/// Answers callers, each on a thread of its own.
fn accept(listener: &TcpListener, registry: &Arc<Registry>, timeout: Duration) {
    let callers = Arc::new(AtomicUsize::new(0));
    for caller in listener.incoming() {
        let Ok(caller) = caller else { continue };
        if callers.fetch_add(1, Ordering::AcqRel) >= MAX_CALLERS {
            callers.fetch_sub(1, Ordering::AcqRel);
            debug!("refused a connection: {MAX_CALLERS} are open");
            continue;
        }
        let (registry, open) = (Arc::clone(registry), Arc::clone(&callers));
        let answer = move || {
            if let Err(error) = answer(caller, &registry, timeout) {
                debug!("a caller of the metrics received no answer: {error}");
            }
            open.fetch_sub(1, Ordering::AcqRel);
        };
        if let Err(error) = named("metrics caller").spawn(answer) {
            callers.fetch_sub(1, Ordering::AcqRel);
            debug!("cannot start a thread for a caller of the metrics: {error}");
        }
    }
}

fn answer(mut caller: TcpStream, registry: &Registry, timeout: Duration) -> std::io::Result<()> {
    caller.set_read_timeout(Some(timeout))?;
    caller.set_write_timeout(Some(timeout))?;
    let Some(request) = read_request(&mut caller, timeout)? else { return Ok(()) };
    let (method, target) = request_line(&request);
    let path = target.split('?').next().unwrap_or_default();
    let (status, kind, body) = match (method, path) {
        ("GET" | "HEAD", "/metrics") => ("200 OK", CONTENT_TYPE, text(registry)),
        ("GET" | "HEAD", _) => ("404 Not Found", "text/plain", "metrics are at /metrics\n".to_owned()),
        _ => ("405 Method Not Allowed", "text/plain", "only GET and HEAD are allowed\n".to_owned()),
    };
    let allow = if status.starts_with("405") { "Allow: GET, HEAD\r\n" } else { "" };
    let shown = if method == "HEAD" { "" } else { body.as_str() };
    write!(
        caller,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\n{allow}Connection: close\r\n\r\n{shown}",
        body.len()
    )
}

/// A request up to its empty line; `None` if the caller sends none.
fn read_request(caller: &mut TcpStream, timeout: Duration) -> std::io::Result<Option<Vec<u8>>> {
    let (mut request, mut part, start) = (Vec::new(), [0; 1024], Instant::now());
    while !request.windows(4).any(|end| end == b"\r\n\r\n") {
        let read = caller.read(&mut part)?;
        request.extend_from_slice(part.get(..read).unwrap_or_default());
        if read == 0 || request.len() > MAX_REQUEST_BYTES || start.elapsed() > timeout {
            return Ok(None);
        }
    }
    Ok(Some(request))
}

/// Method and target of a request; empty if it has none.
fn request_line(request: &[u8]) -> (&str, &str) {
    let line = request.split(|&byte| byte == b'\r').next().unwrap_or_default();
    let mut words = std::str::from_utf8(line).unwrap_or_default().split(' ');
    (words.next().unwrap_or_default(), words.next().unwrap_or_default())
}

fn text(registry: &Registry) -> String {
    let mut text = String::new();
    // Writing into a string does not fail.
    let _ = encode(&mut text, registry);
    text
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::sink::Timings;
    use crate::source::Frame;
    use crate::telemetry::{Counts, Totals};

    /// The answer to a request.
    pub(crate) fn ask(address: SocketAddr, request: &str) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    /// An endpoint and its address.
    pub(crate) fn endpoint() -> (MetricsServer, SocketAddr) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        (MetricsServer::serve(listener, Duration::from_secs(600)).unwrap(), address)
    }

    /// The sink of a camera with the stages `queue`, `graph` and `publish`.
    pub(crate) fn sink(server: &MetricsServer, camera: &str) -> Box<dyn Sink> {
        Box::new(server.sink(camera, ["queue", "graph", "publish"].into_iter()))
    }

    fn status(counts: &Counts, is_up: bool) -> Status<'_> {
        static TOTALS: std::sync::LazyLock<Totals> = std::sync::LazyLock::new(Totals::default);
        Status { is_up, counts, totals: &TOTALS }
    }

    #[test]
    fn counts_and_histograms_of_each_camera_are_served() {
        let (server, address) = endpoint();
        let (mut front, mut rear) = (sink(&server, "front"), sink(&server, "rear"));
        rear.on_status(&status(&Counts::default(), false));
        front.on_status(&status(
            &Counts { captured: 7, published: 4, superseded: 2, failed: 1, in_flight: 0 },
            true,
        ));
        let results = Results {
            units: nunet_types::Units::Metre,
            scale_source: nunet_types::ScaleSource::Metric,
            size: (0, 0),
            depth: &[],
            labels: None,
            cloud_size: (0, 0),
            cloud: None,
            camera: None,
        };
        let timings =
            Timings { total_micros: 40_000, queue_micros: 500, inner_micros: &[30_000], publish_micros: 9 };
        let frame = Frame::default();
        front.on_frame(&PublishedFrame { frame: &frame, camera: None, results, timings });
        let answer = ask(address, "GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n");
        assert!(
            answer.starts_with(&format!("HTTP/1.1 200 OK\r\nContent-Type: {CONTENT_TYPE}\r\n")),
            "{answer}"
        );
        for line in [
            "# TYPE nunet_latency_seconds histogram\n",
            "nunet_camera_up{camera=\"front\"} 1\n",
            "nunet_camera_up{camera=\"rear\"} 0\n",
            "nunet_frames_captured_total{camera=\"front\"} 7\n",
            "nunet_frames_captured_total{camera=\"rear\"} 0\n",
            "nunet_frames_ended_total{camera=\"front\",end=\"superseded\"} 2\n",
            "nunet_latency_seconds_sum{camera=\"front\"} 0.04\n",
            "nunet_latency_seconds_bucket{le=\"0.033\",camera=\"front\"} 0\n",
            "nunet_latency_seconds_bucket{le=\"0.05\",camera=\"front\"} 1\n",
            "nunet_stage_seconds_count{camera=\"front\",stage=\"graph\"} 1\n",
            "nunet_stage_seconds_sum{camera=\"front\",stage=\"queue\"} 0.0005\n",
        ] {
            assert!(answer.contains(line), "{line} is not in\n{answer}");
        }
        front.finish(None).wait(&mut crate::sink::shutdown::DrainTimeout::new(&|| false)).unwrap();
        let after = ask(address, "GET /metrics HTTP/1.1\r\n\r\n");
        assert!(after.contains("nunet_camera_up{camera=\"front\"} 0\n"), "{after}");
    }

    #[test]
    fn head_and_query_strings_work_and_other_requests_are_refused() {
        let (_server, address) = endpoint();
        let whole = ask(address, "GET /metrics?name[]=up HTTP/1.1\r\n\r\n");
        assert!(whole.starts_with("HTTP/1.1 200 OK") && whole.ends_with("# EOF\n"), "{whole}");
        let head = ask(address, "HEAD /metrics HTTP/1.1\r\n\r\n");
        assert_eq!(head, whole.split_inclusive("\r\n\r\n").next().unwrap(), "the same without a body");
        assert!(ask(address, "GET / HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 404"));
        assert!(ask(address, "POST /metrics HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 405"));
        assert_eq!(ask(address, &"x".repeat(MAX_REQUEST_BYTES + 1)), "");
    }

    #[test]
    fn idle_connections_do_not_delay_an_answer() {
        let (_server, address) = endpoint();
        let idle: Vec<_> = (0..5).map(|_| TcpStream::connect(address).unwrap()).collect();
        let answer = ask(address, "GET /metrics HTTP/1.1\r\n\r\n");
        assert!(answer.starts_with("HTTP/1.1 200 OK"));
        // They are still connected: the answer did not wait until they timed out.
        for mut connection in idle {
            connection.write_all(b"GET /metrics HTTP/1.1\r\n\r\n").unwrap();
            let mut answer = String::new();
            connection.read_to_string(&mut answer).unwrap();
            assert!(answer.starts_with("HTTP/1.1 200 OK"), "{answer}");
        }
    }

    #[test]
    fn an_address_in_use_is_an_error_with_a_hint() {
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let error = MetricsServer::open(taken.local_addr().unwrap()).err().unwrap();
        let text = crate::exit::chain_text(&error);
        assert!(text.starts_with("error: cannot serve metrics on `127.0.0.1:"), "{text}");
        assert!(text.contains("\nhint: pass --metrics 127.0.0.1:PORT"), "{text}");
    }
}
