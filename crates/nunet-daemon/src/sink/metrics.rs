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

/// The stream's end of the endpoint.
pub(crate) struct Metrics {
    figures: Arc<Mutex<Figures>>,
    summarised: Option<Instant>,
}

#[derive(Debug, Default)]
struct Figures {
    camera: String,
    counts: Counts,
    fps: f64,
    bytes_copied_per_frame: f64,
    total: Summary,
    stages: Vec<(String, Summary)>,
}

impl Metrics {
    /// Opens the endpoint; its thread ends with the process.
    ///
    /// # Errors
    /// The address is taken or not ours.
    pub(crate) fn serve(address: SocketAddr, camera: &str) -> anyhow::Result<Self> {
        let listener = TcpListener::bind(address).with_context(|| {
            format!(
                "cannot serve metrics on `{address}`\nhint: --metrics 127.0.0.1:PORT with a port that is free"
            )
        })?;
        info!("metrics on http://{}/metrics", listener.local_addr().unwrap_or(address));
        let figures = Arc::new(Mutex::new(Figures { camera: camera.to_owned(), ..Figures::default() }));
        let served = Arc::clone(&figures);
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
        Ok(Self { figures, summarised: None })
    }

    /// Takes the figures as they are after a frame. Never waits: what a caller is reading is brought up to date with the
    /// next frame.
    pub(crate) fn update(&mut self, counts: &Counts, totals: &Totals, latencies: &Latencies) {
        let Ok(mut figures) = self.figures.try_lock() else { return };
        figures.counts = *counts;
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

fn answer(mut caller: TcpStream, figures: &Mutex<Figures>) -> std::io::Result<()> {
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
        ("200 OK", text(&figures.lock().unwrap_or_else(PoisonError::into_inner)))
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

/// Prometheus' text format, version 0.0.4. Seconds and bytes, as its naming rules ask.
fn text(figures: &Figures) -> String {
    let camera = &figures.camera;
    let mut text = String::new();
    let mut metric = |name: &str, kind: &str, help: &str, samples: &[(String, f64)]| {
        // Writing into a string does not fail.
        let _ = writeln!(text, "# HELP nunet_{name} {help}\n# TYPE nunet_{name} {kind}");
        for (labels, value) in samples {
            let _ = writeln!(text, "nunet_{name}{{camera=\"{camera}\"{labels}}} {value}");
        }
    };
    let counts = figures.counts;
    let plain = |value: f64| vec![(String::new(), value)];
    let ends =
        [("published", counts.published), ("superseded", counts.superseded), ("failed", counts.failed)];
    let ends: Vec<_> = ends.map(|(end, count)| (format!(",end=\"{end}\""), count as f64)).into();
    metric(
        "frames_captured_total",
        "counter",
        "Frames that the source handed over.",
        &plain(counts.captured as f64),
    );
    metric("frames_ended_total", "counter", "Frames by how they ended.", &ends);
    metric("frames_in_flight", "gauge", "Frames on their way.", &plain(counts.in_flight as f64));
    metric("frames_per_second", "gauge", "Published frames a second since the start.", &plain(figures.fps));
    metric(
        "bytes_copied_per_frame",
        "gauge",
        "Bytes that were moved although they existed.",
        &plain(figures.bytes_copied_per_frame),
    );
    metric(
        "latency_seconds",
        "gauge",
        "From the source to the readers' wake-up.",
        &quantiles("", &figures.total),
    );
    let stages: Vec<_> = figures
        .stages
        .iter()
        .flat_map(|(stage, summary)| quantiles(&format!(",stage=\"{stage}\""), summary))
        .collect();
    metric("stage_seconds", "gauge", "Time of each stage.", &stages);
    text
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
        let mut metrics = Metrics::serve(address, "front").unwrap();
        let counts = Counts { captured: 7, published: 4, superseded: 2, failed: 1, in_flight: 0 };
        let mut latencies = Latencies::new(["decode"]);
        latencies.record(2000, [500]);
        metrics.update(&counts, &Totals::default(), &latencies);
        let answer = ask(address, "GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n");
        assert!(answer.starts_with("HTTP/1.1 200 OK\r\nContent-Type: text/plain; version=0.0.4"), "{answer}");
        for line in [
            "nunet_frames_captured_total{camera=\"front\"} 7",
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
        let error = Metrics::serve(taken.local_addr().unwrap(), "front").err().unwrap().to_string();
        assert!(
            error.contains("cannot serve metrics on `127.0.0.1:") && error.contains("\nhint: "),
            "{error}"
        );
    }
}
