//! Frame counts and latencies for Prometheus. The library `prometheus-client` counts and writes the text
//! format.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};

use crate::ledger::Counts;
use crate::messages::MessageCounts;
use crate::totals::Totals;

/// Upper bounds of the histograms' buckets: from a small network on a fast machine to a stalled one.
const BUCKETS_S: [f64; 16] =
    [0.001, 0.0025, 0.005, 0.01, 0.02, 0.033, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.5, 10.0];

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

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct MessageLabels {
    camera: String,
    output: &'static str,
    end: &'static str,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct OutputLabels {
    camera: String,
    output: &'static str,
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
    without_attitude: Family<CameraLabels, Counter>,
    scale: Family<CameraLabels, Gauge<f64, AtomicU64>>,
    scale_age: Family<CameraLabels, Gauge<f64, AtomicU64>>,
    drift: Family<CameraLabels, Gauge<f64, AtomicU64>>,
    flicker: Family<CameraLabels, Gauge<f64, AtomicU64>>,
    unstable: Family<CameraLabels, Gauge>,
    latency: Histograms<CameraLabels>,
    stage: Histograms<StageLabels>,
    messages: Family<MessageLabels, Counter>,
    connections_down: Family<OutputLabels, Gauge>,
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
            without_attitude: Family::default(),
            scale: Family::default(),
            scale_age: Family::default(),
            drift: Family::default(),
            flicker: Family::default(),
            unstable: Family::default(),
            latency: Family::new_with_constructor(histogram),
            stage: Family::new_with_constructor(histogram),
            messages: Family::default(),
            connections_down: Family::default(),
        };
        let help = "1 while the source delivers frames, 0 while it is retried and after its end";
        registry.register("camera_up", help, families.up.clone());
        registry.register("frames_captured", "Frames that reached the source", families.captured.clone());
        registry.register("frames_ended", "Published, superseded and failed frames", families.ended.clone());
        registry.register("frames_in_flight", "Frames that are not finished", families.in_flight.clone());
        let help = "Published frames per second since the start";
        registry.register("frames_per_second", help, families.fps.clone());
        let help = "Mean bytes copied per frame";
        registry.register("bytes_copied_per_frame", help, families.bytes_copied.clone());
        let help = "Frames for which no attitude of the robot was found, although it is read";
        registry.register("frames_without_attitude", help, families.without_attitude.clone());
        let help = "Factor by which the network's meters are multiplied; 0 for relative depth";
        registry.register("scale_factor", help, families.scale.clone());
        let help = "Time since the scale factor was measured; 0 for one that does not change";
        registry.register_with_unit("scale_age", help, Unit::Seconds, families.scale_age.clone());
        families.register_stability(registry);
        let help = "Time from the arrival of the image to the wake-up of the readers";
        registry.register_with_unit("latency", help, Unit::Seconds, families.latency.clone());
        registry.register_with_unit("stage", "Time of each stage", Unit::Seconds, families.stage.clone());
        registry.register("messages", "Messages to other machines by outcome", families.messages.clone());
        let help = "Connections to other machines that do not work, such as an absent router";
        registry.register("connections_down", help, families.connections_down.clone());
        families
    }

    fn register_stability(&self, registry: &mut Registry) {
        let help = "Growth of the depth's scale per frame while the image does not change; NaN if it does";
        registry.register("depth_drift_ratio", help, self.drift.clone());
        let help =
            "Change of points per frame beside the scale while the image does not change; NaN if it does";
        registry.register("depth_flicker_ratio", help, self.flicker.clone());
        let help = "1 while drift or flicker is above the limit";
        registry.register("depth_unstable", help, self.unstable.clone());
    }
}

/// The metrics of all cameras. Copies share their values.
#[derive(Debug, Clone)]
pub struct Metrics {
    families: Arc<Families>,
    registry: Arc<Registry>,
}

impl Default for Metrics {
    fn default() -> Self {
        let mut registry = Registry::with_prefix("nunet");
        let families = Arc::new(Families::register(&mut registry));
        Self { families, registry: Arc::new(registry) }
    }
}

impl Metrics {
    /// All metrics in the text format that Prometheus reads, `OpenMetrics`.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing into a string does not fail.
        let _ = encode(&mut text, &self.registry);
        text
    }

    /// The messages of one camera's output, such as `ros2`.
    #[must_use]
    pub fn messages(&self, camera: &str, output: &'static str) -> MessageCounts {
        let messages = &self.families.messages;
        let counter =
            |end| messages.get_or_create_owned(&MessageLabels { camera: camera.to_owned(), output, end });
        let labels = OutputLabels { camera: camera.to_owned(), output };
        MessageCounts {
            sent: counter("sent"),
            not_taken: counter("not_taken"),
            superseded: counter("superseded"),
            connections_down: self.families.connections_down.get_or_create_owned(&labels),
            problems: Arc::default(),
        }
    }

    /// The metrics of one camera, with the stages of its frames.
    pub fn camera<'a>(&self, camera: &str, stages: impl IntoIterator<Item = &'a str>) -> CameraMetrics {
        let labels = CameraLabels { camera: camera.to_owned() };
        let end = |end| EndLabels { camera: camera.to_owned(), end };
        let stage = |stage: &str| StageLabels { camera: camera.to_owned(), stage: stage.to_owned() };
        let families = &self.families;
        let metrics = CameraMetrics {
            up: families.up.get_or_create_owned(&labels),
            captured: families.captured.get_or_create_owned(&labels),
            published: families.ended.get_or_create_owned(&end("published")),
            superseded: families.ended.get_or_create_owned(&end("superseded")),
            failed: families.ended.get_or_create_owned(&end("failed")),
            in_flight: families.in_flight.get_or_create_owned(&labels),
            fps: families.fps.get_or_create_owned(&labels),
            bytes_copied: families.bytes_copied.get_or_create_owned(&labels),
            without_attitude: families.without_attitude.get_or_create_owned(&labels),
            scale: families.scale.get_or_create_owned(&labels),
            scale_age: families.scale_age.get_or_create_owned(&labels),
            drift: families.drift.get_or_create_owned(&labels),
            flicker: families.flicker.get_or_create_owned(&labels),
            unstable: families.unstable.get_or_create_owned(&labels),
            latency: families.latency.get_or_create_owned(&labels),
            stages: stages.into_iter().map(|name| families.stage.get_or_create_owned(&stage(name))).collect(),
        };
        metrics.set_stability(&Totals::default());
        // A camera is up until its source reports otherwise.
        metrics.set_up(true);
        metrics
    }
}

/// One camera's metrics.
#[derive(Debug)]
pub struct CameraMetrics {
    up: Gauge,
    captured: Counter,
    published: Counter,
    superseded: Counter,
    failed: Counter,
    in_flight: Gauge,
    fps: Gauge<f64, AtomicU64>,
    bytes_copied: Gauge<f64, AtomicU64>,
    without_attitude: Counter,
    scale: Gauge<f64, AtomicU64>,
    scale_age: Gauge<f64, AtomicU64>,
    drift: Gauge<f64, AtomicU64>,
    flicker: Gauge<f64, AtomicU64>,
    unstable: Gauge,
    latency: Histogram,
    stages: Vec<Histogram>,
}

impl CameraMetrics {
    /// Adds a frame: its total, and the time of each stage in the order given to [`Metrics::camera`].
    pub fn record(&self, total_micros: u32, stages_micros: impl IntoIterator<Item = u32>) {
        let seconds = |micros: u32| f64::from(micros) / 1e6;
        self.latency.observe(seconds(total_micros));
        for (histogram, micros) in self.stages.iter().zip(stages_micros) {
            histogram.observe(seconds(micros));
        }
    }

    /// Sets the counts and rates.
    pub fn set(&self, counts: &Counts, totals: &Totals) {
        let set = |counter: &Counter, count| counter.inner().store(count, Ordering::Relaxed);
        set(&self.captured, counts.captured);
        set(&self.published, counts.published);
        set(&self.superseded, counts.superseded);
        set(&self.failed, counts.failed);
        set(&self.without_attitude, totals.without_attitude);
        self.in_flight.set(i64::try_from(counts.in_flight).unwrap_or(i64::MAX));
        self.fps.set(totals.fps());
        self.bytes_copied.set(totals.bytes_copied_per_frame());
        self.set_stability(totals);
    }

    fn set_stability(&self, totals: &Totals) {
        let recent = totals.stability.recent();
        self.drift.set(recent.map_or(f64::NAN, |recent| recent.drift));
        self.flicker.set(recent.map_or(f64::NAN, |recent| recent.flicker));
        self.unstable.set(totals.stability.is_unstable().into());
    }

    /// Sets the factor of depth, and the seconds since it was measured.
    pub fn set_scale(&self, factor: f64, age_s: f64) {
        self.scale.set(factor);
        self.scale_age.set(age_s);
    }

    /// Sets whether the source delivers frames: false while it is waited for, and after its end.
    pub fn set_up(&self, is_up: bool) {
        self.up.set(i64::from(is_up));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stability::Stability;

    #[test]
    fn counts_and_histograms_of_each_camera_are_written() {
        let metrics = Metrics::default();
        let camera = |name| metrics.camera(name, ["queue", "graph", "publish"]);
        let (front, rear) = (camera("front"), camera("rear"));
        rear.set_up(false);
        let counts = Counts { captured: 7, published: 4, superseded: 2, failed: 1, in_flight: 0 };
        let mut totals = Totals::default();
        totals.without_attitude = 3;
        totals.stability.set_limit(Some(0.05));
        (0..8).for_each(|_| totals.stability.add(Some(Stability { drift: -0.25, flicker: 0.5 })));
        front.set(&counts, &totals);
        front.record(40_000, [500, 30_000, 9]);
        front.set_scale(0.5, 1.5);
        let answer = metrics.text();
        for line in [
            "# TYPE nunet_latency_seconds histogram\n",
            "nunet_camera_up{camera=\"front\"} 1\n",
            "nunet_camera_up{camera=\"rear\"} 0\n",
            "nunet_scale_factor{camera=\"front\"} 0.5\n",
            "nunet_scale_age_seconds{camera=\"front\"} 1.5\n",
            "nunet_depth_drift_ratio{camera=\"front\"} -0.25\n",
            "nunet_depth_flicker_ratio{camera=\"front\"} 0.5\n",
            "nunet_depth_unstable{camera=\"front\"} 1\n",
            "nunet_depth_drift_ratio{camera=\"rear\"} NaN\n",
            "nunet_depth_unstable{camera=\"rear\"} 0\n",
            "nunet_frames_captured_total{camera=\"front\"} 7\n",
            "nunet_frames_captured_total{camera=\"rear\"} 0\n",
            "nunet_frames_ended_total{camera=\"front\",end=\"superseded\"} 2\n",
            "nunet_frames_without_attitude_total{camera=\"front\"} 3\n",
            "nunet_latency_seconds_sum{camera=\"front\"} 0.04\n",
            "nunet_latency_seconds_bucket{le=\"0.033\",camera=\"front\"} 0\n",
            "nunet_latency_seconds_bucket{le=\"0.05\",camera=\"front\"} 1\n",
            "nunet_stage_seconds_count{camera=\"front\",stage=\"graph\"} 1\n",
            "nunet_stage_seconds_sum{camera=\"front\",stage=\"queue\"} 0.0005\n",
        ] {
            assert!(answer.contains(line), "{line} is not in\n{answer}");
        }
        front.set_up(false);
        let after = metrics.text();
        assert!(after.contains("nunet_camera_up{camera=\"front\"} 0\n"), "{after}");
    }
}
