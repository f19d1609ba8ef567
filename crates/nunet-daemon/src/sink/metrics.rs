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
        Self::answer_on(listener, cameras)
    }

    fn answer_on(listener: TcpListener, cameras: &[&str]) -> anyhow::Result<Vec<Self>> {
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

    /// Takes the figures as they are now; says whether it did. Never waits: not while a caller is reading them.
    pub(crate) fn update(
        &mut self,
        up: bool,
        counts: &Counts,
        totals: &Totals,
        latencies: &Latencies,
    ) -> bool {
        let Ok(mut figures) = self.figures.try_lock() else { return false };
        figures.counts = *counts;
        figures.up = up;
        if self.summarised.is_none_or(|then| then.elapsed() >= SUMMARY_PERIOD) {
            self.summarised = Some(Instant::now());
            figures.summarise(totals, latencies);
        }
        true
    }

    /// Takes the last figures of a camera that has ended. Nobody tells them again, so it waits for a caller who is reading
    /// them, which takes no longer than writing them into a text.
    pub(crate) fn end(&mut self, counts: &Counts, totals: &Totals, latencies: &Latencies) {
        let mut figures = self.figures.lock().unwrap_or_else(PoisonError::into_inner);
        figures.up = false;
        figures.counts = *counts;
        figures.summarise(totals, latencies);
    }
}

impl Figures {
    fn summarise(&mut self, totals: &Totals, latencies: &Latencies) {
        self.fps = totals.fps();
        self.bytes_copied_per_frame = totals.bytes_copied_per_frame();
        self.total = latencies.total();
        if self.stages.is_empty() {
            self.stages = latencies.stages().map(|(name, summary)| (name.to_owned(), summary)).collect();
        }
        for ((_, kept), (_, summary)) in self.stages.iter_mut().zip(latencies.stages()) {
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
        "1 while the camera's source gives frames, 0 while it is waited for and when it has ended.",
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

    /// The endpoint of these cameras, and where it is.
    fn endpoint<const N: usize>(cameras: [&str; N]) -> ([Metrics; N], SocketAddr) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        (Metrics::answer_on(listener, &cameras).unwrap().try_into().ok().unwrap(), address)
    }

    #[test]
    fn the_ledger_and_the_latencies_are_told_and_nothing_else() {
        let ([mut metrics, rear], address) = endpoint(["front", "rear"]);
        rear.tell_health(false);
        let counts = Counts { captured: 7, published: 4, superseded: 2, failed: 1, in_flight: 0 };
        let mut latencies = Latencies::new(["decode"]);
        latencies.record(2000, [500]);
        assert!(metrics.update(true, &counts, &Totals::default(), &latencies));
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
    fn the_end_of_a_camera_is_told_with_its_last_figures_also_while_a_caller_reads() {
        let ([mut metrics], address) = endpoint(["front"]);
        let figures = Arc::clone(&metrics.figures);
        let reading = figures.lock().unwrap();
        let counts = Counts { captured: 3, published: 1, failed: 2, ..Counts::default() };
        assert!(!metrics.update(true, &counts, &Totals::default(), &Latencies::new([])), "it never waits");
        let (begins, began) = std::sync::mpsc::channel();
        let ending = std::thread::spawn(move || {
            begins.send(()).unwrap();
            metrics.end(&counts, &Totals::default(), &Latencies::new([]));
        });
        began.recv().unwrap();
        // Time to come to the lock; one that comes later finds it free, and the test is none, but does not fail.
        std::thread::sleep(Duration::from_millis(100));
        drop(reading);
        ending.join().unwrap();
        let answer = ask(address, "GET /metrics HTTP/1.1\r\n\r\n");
        assert!(answer.contains("nunet_camera_up{camera=\"front\"} 0\n"), "{answer}");
        assert!(answer.contains("nunet_frames_ended_total{camera=\"front\",end=\"failed\"} 2\n"), "{answer}");
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
