//! `--metrics ADDRESS:PORT`: the frame counts and latencies for Prometheus.

use std::net::SocketAddr;
use std::sync::Arc;

use nunet_telemetry::{CameraMetrics, Metrics};
use nunet_view::MetricsServer;
use tracing::info;

use super::shm::stage_names;
use super::{FinishingSink, PublishedFrame, Results, Sink, SinkContext, Status, Wants};
use crate::exit::WithHint;

/// Serves the metrics of all cameras until the returned value is dropped.
///
/// # Errors
/// The address is in use or is not an address of this machine.
pub(crate) fn serve(metrics: &Metrics, address: SocketAddr) -> anyhow::Result<MetricsServer> {
    let metrics = metrics.clone();
    let server = MetricsServer::open(address, Arc::new(move || metrics.text())).map_err(|error| {
        let message = format!("cannot serve metrics on `{address}`");
        WithHint::new(message, "pass --metrics 127.0.0.1:PORT with a free port").because(error)
    })?;
    info!("metrics on http://{}/metrics", server.address());
    Ok(server)
}

/// Opens the sink if metrics are served.
pub(super) fn open(context: &SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>> {
    let camera = context.config.name.as_str();
    let stages = stage_names(context.pipeline, context.has_obstacles);
    let sink = context.metrics.map(|metrics| sink(metrics, camera, stages));
    Ok(sink)
}

/// The metrics of a camera whose frames have these stages.
pub(super) fn sink<'a>(
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

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn an_address_in_use_is_an_error_with_a_hint() {
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let error = serve(&Metrics::default(), taken.local_addr().unwrap()).err().unwrap();
        let text = crate::exit::chain_text(&error);
        assert!(text.starts_with("error: cannot serve metrics on `127.0.0.1:"), "{text}");
        assert!(text.contains("\nhint: pass --metrics 127.0.0.1:PORT"), "{text}");
    }
}
