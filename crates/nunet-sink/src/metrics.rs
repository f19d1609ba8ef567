//! Frame counts and latencies as Prometheus metrics.

use nunet_telemetry::{CameraMetrics, Metrics};
use nunet_types::shortest;

use crate::results::Results;
use crate::sink::{FinishingSink, PublishedFrame, Sink, Status, Wants};

/// The metrics of a camera whose frames have these stages, which are named in the order of
/// [`Timings::stages`](crate::sink::Timings::stages).
pub fn metrics_sink<'a>(
    metrics: &Metrics,
    camera: &str,
    stages: impl IntoIterator<Item = &'a str>,
) -> Box<dyn Sink> {
    Box::new(MetricsSink(metrics.camera(camera, stages)))
}

struct MetricsSink(CameraMetrics);

impl Sink for MetricsSink {
    fn wants(&self) -> Wants {
        Wants::default()
    }

    fn on_frame(&mut self, published: &PublishedFrame<'_>) {
        self.0.record(published.timings.total_micros, published.timings.stages());
        let scale = published.results.scale;
        self.0.set_scale(shortest(scale.factor), scale.age_nanos as f64 / 1e9);
    }

    fn on_status(&mut self, status: &Status<'_>) {
        self.0.set_up(status.is_up);
        self.0.set(status.counts, status.totals);
    }

    fn finish(self: Box<Self>, _last: Option<&Results<'_>>) -> FinishingSink {
        self.0.set_up(false);
        FinishingSink::done()
    }
}
