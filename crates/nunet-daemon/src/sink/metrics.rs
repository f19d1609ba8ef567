//! `--metrics ADDRESS:PORT`: the ledger and the latencies for Prometheus, in its text format.
//!
//! An endpoint that answers one question to one caller at a time: no web server is worth its dependencies here.

use std::fmt::Write as _;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use tracing::{debug, info};

use crate::telemetry::{Counts, Latencies, Summary, Totals};

/// How often percentiles are computed anew; counts are of every frame.
const SUMMARY_PERIOD: Duration = Duration::from_millis(500);
/// A caller who does not ask or listen within it is left.
const PATIENCE: Duration = Duration::from_secs(2);
/// No question is longer.
const MAX_REQUEST_BYTES: usize = 8 << 10;

/// A camera's end of the endpoint.
pub(crate) struct Metrics {
    figures: Arc<Mutex<Figures>>,
    summarised: Option<Instant>,
}

#[derive(Debug, Default)]
struct Figures {
    camera: String,
    /// Its source gives frames, or has only just been asked.
    up: bool,
    counts: Counts,
    fps: f64,
    bytes_copied_per_frame: f64,
    total: Summary,
    stages: Vec<(String, Summary)>,
}

impl Metrics {
    /// Opens the endpoint for `cameras`; returns each one's end of it. Its thread ends with the process.
    ///
    /// # Errors
    /// The address is taken or not ours.
    pub(crate) fn serve(address: SocketAddr, cameras: &[&str]) -> anyhow::Result<Vec<Self>> {
        let listener = TcpListener::bind(address).with_context(|| {
            format!(
                "cannot serve metrics on `{address}`\nhint: --metrics 127.0.0.1:PORT with a port that is free"
            )
        })?;
        info!("metrics on http://{}/metrics", listener.local_addr().unwrap_or(address));
        let figures = cameras.iter().map(|&camera| {
            Arc::new(Mutex::new(Figures { camera: camera.to_owned(), up: true, ..Figures::default() }))
        });
        let figures: Vec<_> = figures.collect();
        let served = figures.clone();
        let serve = move || {
            for caller in listener.incoming() {
                if let Err(error) = caller.and_then(|caller| answer(caller, &served)) {
                    debug!("a caller of the metrics got no answer: {error}");
                }
            }
        };
        std::thread::Builder::new()
            .name("metrics".into())
            .spawn(serve)
            .context("cannot start the metrics' thread")?;
        Ok(figures.into_iter().map(|figures| Self { figures, summarised: None }).collect())
    }

    /// Whether the source gives frames. Never waits; it is told again and again.
    pub(crate) fn tell_health(&self, up: bool) {
        if let Ok(mut figures) = self.figures.try_lock() {
            figures.up = up;
        }
    }

    /// Takes the figures as they are after a frame. Never waits: what a caller is reading is brought up to date with the
    /// next frame.
    pub(crate) fn update(&mut self, counts: &Counts, totals: &Totals, latencies: &Latencies) {
        let Ok(mut figures) = self.figures.try_lock() else { return };
        figures.counts = *counts;
        figures.up = true;
        if self.summarised.is_some_and(|then| then.elapsed() < SUMMARY_PERIOD) {
            return;
        }
        self.summarised = Some(Instant::now());
        figures.fps = totals.fps();
        figures.bytes_copied_per_frame = totals.bytes_copied_per_frame();
        figures.total = latencies.total();
        if figures.stages.is_empty() {
            figures.stages = latencies.stages().map(|(name, summary)| (name.to_owned(), summary)).collect();
        }
        for ((_, kept), (_, summary)) in figures.stages.iter_mut().zip(latencies.stages()) {
            *kept = summary;
        }
    }
}

fn answer(mut caller: TcpStream, figures: &[Arc<Mutex<Figures>>]) -> std::io::Result<()> {
    caller.set_read_timeout(Some(PATIENCE))?;
    caller.set_write_timeout(Some(PATIENCE))?;
    let mut request = Vec::new();
    let mut part = [0; 1024];
    let start = Instant::now();
    while !request.windows(4).any(|end| end == b"\r\n\r\n") {
        let read = caller.read(&mut part)?;
        request.extend_from_slice(part.get(..read).unwrap_or_default());
        if read == 0 || request.len() > MAX_REQUEST_BYTES || start.elapsed() > PATIENCE {
            return Ok(());
        }
    }
    let (status, body) = if request.starts_with(b"GET /metrics ") {
        ("200 OK", text(figures))
    } else {
        ("404 Not Found", "metrics are at /metrics\n".to_owned())
    };
    write!(
        caller,
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\nContent-Length: {}\r\n\
         Connection: close\r\n\r\n{body}",
        body.len()
    )
}

/// A family of samples: its name, kind and help, and what it says of a camera, as labels and a value.
type Family = (&'static str, &'static str, &'static str, fn(&Figures) -> Vec<(String, f64)>);

/// Seconds and bytes, as Prometheus' naming rules ask.
const FAMILIES: [Family; 8] = [
    (
        "camera_up",
        "gauge",
        "1 while the camera's source gives frames, 0 while it is waited for.",
        |figures| plain(f64::from(u8::from(figures.up))),
    ),
    ("frames_captured_total", "counter", "Frames that the source handed over.", |figures| {
        plain(figures.counts.captured as f64)
    }),
    ("frames_ended_total", "counter", "Frames by how they ended.", |figures| {
        let Counts { published, superseded, failed, .. } = figures.counts;
        let ends = [("published", published), ("superseded", superseded), ("failed", failed)];
        ends.map(|(end, count)| (format!(",end=\"{end}\""), count as f64)).into()
    }),
    ("frames_in_flight", "gauge", "Frames on their way.", |figures| plain(figures.counts.in_flight as f64)),
    ("frames_per_second", "gauge", "Published frames a second since the start.", |figures| {
        plain(figures.fps)
    }),
    ("bytes_copied_per_frame", "gauge", "Bytes that were moved although they existed.", |figures| {
        plain(figures.bytes_copied_per_frame)
    }),
    ("latency_seconds", "gauge", "From the source to the readers' wake-up.", |figures| {
        quantiles("", &figures.total)
    }),
    ("stage_seconds", "gauge", "Time of each stage.", |figures| {
        let stages = figures.stages.iter();
        stages.flat_map(|(stage, summary)| quantiles(&format!(",stage=\"{stage}\""), summary)).collect()
    }),
];

/// Prometheus' text format, version 0.0.4: the cameras' samples of a family stand together.
fn text(cameras: &[Arc<Mutex<Figures>>]) -> String {
    let mut text = String::new();
    for (name, kind, help, samples) in FAMILIES {
        // Writing into a string does not fail.
        let _ = writeln!(text, "# HELP nunet_{name} {help}\n# TYPE nunet_{name} {kind}");
        for figures in cameras {
            let figures = figures.lock().unwrap_or_else(PoisonError::into_inner);
            for (labels, value) in samples(&figures) {
                let _ = writeln!(text, "nunet_{name}{{camera=\"{}\"{labels}}} {value}", figures.camera);
            }
        }
    }
    text
}

/// A sample without labels of its own.
fn plain(value: f64) -> Vec<(String, f64)> {
    vec![(String::new(), value)]
}

fn quantiles(labels: &str, summary: &Summary) -> Vec<(String, f64)> {
    const MS_PER_S: f64 = 1e3;
    let quantiles = [("0.5", summary.p50), ("0.9", summary.p90), ("0.99", summary.p99), ("1", summary.max)];
    quantiles.map(|(quantile, ms)| (format!("{labels},quantile=\"{quantile}\""), ms / MS_PER_S)).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(address: SocketAddr, request: &str) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    fn free_address() -> SocketAddr {
        TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
    }

    #[test]
    fn the_ledger_and_the_latencies_are_told_and_nothing_else() {
        let address = free_address();
        let [mut metrics, rear] =
            Metrics::serve(address, &["front", "rear"]).unwrap().try_into().ok().unwrap();
        rear.tell_health(false);
        let counts = Counts { captured: 7, published: 4, superseded: 2, failed: 1, in_flight: 0 };
        let mut latencies = Latencies::new(["decode"]);
        latencies.record(2000, [500]);
        metrics.update(&counts, &Totals::default(), &latencies);
        let answer = ask(address, "GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n");
        assert!(answer.starts_with("HTTP/1.1 200 OK\r\nContent-Type: text/plain; version=0.0.4"), "{answer}");
        for line in [
            "gauge\nnunet_camera_up{camera=\"front\"} 1\nnunet_camera_up{camera=\"rear\"} 0\n",
            "nunet_frames_captured_total{camera=\"front\"} 7\nnunet_frames_captured_total{camera=\"rear\"} 0\n",
            "nunet_frames_ended_total{camera=\"front\",end=\"superseded\"} 2",
            "nunet_latency_seconds{camera=\"front\",quantile=\"0.5\"} 0.002",
            "nunet_stage_seconds{camera=\"front\",stage=\"decode\",quantile=\"1\"} 0.0005",
        ] {
            assert!(answer.contains(line), "{line} is not in\n{answer}");
        }
        assert!(ask(address, "GET / HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 404"));
        assert_eq!(ask(address, &"x".repeat(MAX_REQUEST_BYTES + 1)), "");
    }

    #[test]
    fn an_address_that_is_taken_is_told_with_the_way_out() {
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let error = Metrics::serve(taken.local_addr().unwrap(), &["front"]).err().unwrap().to_string();
        assert!(
            error.contains("cannot serve metrics on `127.0.0.1:") && error.contains("\nhint: "),
            "{error}"
        );
    }
}
