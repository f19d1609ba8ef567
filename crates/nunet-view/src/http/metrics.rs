//! `/metrics`, for Prometheus.

use axum::Router;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;

use super::{MetricsText, ServerState, text};

const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Only the metrics, for an address of their own.
pub(crate) fn metrics_only(metrics: MetricsText) -> Router {
    Router::new()
        .route("/metrics", get(move || std::future::ready(answer(&metrics))))
        .fallback(|| async { text(StatusCode::NOT_FOUND, "metrics are at /metrics\n") })
}

/// The metrics, at the address of the page.
pub(super) async fn metrics(State(shared): State<ServerState>) -> Response {
    match &shared.metrics {
        Some(metrics) => answer(metrics),
        None => text(StatusCode::NOT_FOUND, "there are no metrics\n"),
    }
}

fn answer(metrics: &MetricsText) -> Response {
    ([(header::CONTENT_TYPE, CONTENT_TYPE)], metrics()).into_response()
}
