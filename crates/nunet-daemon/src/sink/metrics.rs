//! `--metrics ADDRESS:PORT`: the frame counts and latencies for Prometheus.

use std::net::SocketAddr;
use std::sync::Arc;

use nunet_sink::metrics::metrics_sink;
use nunet_sink::stats_record::stage_names;
use nunet_telemetry::Metrics;
use nunet_view::MetricsServer;
use tracing::info;

use super::{Sink, SinkContext};
use crate::exit::cannot_serve;

/// Serves the metrics of all cameras until the returned value is dropped.
///
/// # Errors
/// The address is in use or is not an address of this machine.
pub(crate) fn serve(metrics: &Metrics, address: SocketAddr) -> anyhow::Result<MetricsServer> {
    let metrics = metrics.clone();
    let server = MetricsServer::open(address, Arc::new(move || metrics.text()))
        .map_err(|error| cannot_serve("metrics", address, error))?;
    info!("metrics on http://{}/metrics", server.address());
    Ok(server)
}

/// Opens the sink if metrics are served.
pub(super) fn open(context: &SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>> {
    let camera = context.config.name.as_str();
    let stages = stage_names(context.pipeline, context.has_obstacles);
    let sink = context.metrics.map(|metrics| metrics_sink(metrics, camera, stages));
    Ok(sink)
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
        assert!(text.contains(&format!("metrics on `{}`", taken.local_addr().unwrap())), "{text}");
        assert!(text.contains("\nhint: choose another port"), "{text}");
    }

    #[test]
    fn an_address_of_another_machine_is_an_error_with_its_own_hint() {
        let error = serve(&Metrics::default(), "192.0.2.1:0".parse().unwrap()).err().unwrap();
        let text = crate::exit::chain_text(&error);
        assert!(text.contains("\nhint: choose an address of this machine"), "{text}");
    }
}
