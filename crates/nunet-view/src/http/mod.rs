//! The routes of the HTTP server.

mod access;
mod api;
mod metrics;
mod mjpeg;
mod page;
mod parameters;
mod snapshots;
mod socket;
mod watching;

use std::sync::Arc;

use axum::Router;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::camera::{Cameras, NoCamera};
use crate::token::Token;
pub(crate) use metrics::metrics_only;

/// Writes the metrics; called for each request.
pub type MetricsText = Arc<dyn Fn() -> String + Send + Sync>;

/// More clients with a WebSocket or a video are refused, so that there is always a connection for the page
/// and the metrics.
pub(crate) const MAX_VIEWERS: usize = 32;

/// The state that all handlers share.
#[derive(Clone)]
pub(crate) struct ServerState {
    pub(crate) cameras: Arc<Cameras>,
    pub(crate) token: Option<Token>,
    pub(crate) metrics: Option<MetricsText>,
    pub(crate) port: u16,
    /// Room for more viewers.
    pub(crate) room: Arc<Semaphore>,
}

impl ServerState {
    /// The place of one more viewer, for as long as it is kept; `None` if all are taken.
    fn place(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.room).try_acquire_owned().ok()
    }
}

/// All routes of the live view.
pub(crate) fn router(shared: ServerState) -> Router {
    Router::new()
        .route("/", get(page::index))
        // No camera has this name: names begin with a letter or a digit.
        .route("/_page/{file}", get(page::asset))
        .route("/api/cameras", get(api::cameras))
        .route("/ws", get(socket::open))
        .route("/metrics", get(metrics::metrics))
        .route("/{camera}/image.mjpeg", get(mjpeg::image))
        .route("/{camera}/depth.mjpeg", get(mjpeg::depth))
        .route("/{camera}/frame.jpg", get(snapshots::image))
        .route("/{camera}/depth.png", get(snapshots::depth))
        .fallback(|| async {
            text(StatusCode::NOT_FOUND, "there is nothing at this address; the page is at /\n")
        })
        .layer(axum::middleware::from_fn_with_state(shared.clone(), access::check))
        .with_state(shared)
}

/// A response of one line.
fn text(status: StatusCode, message: impl Into<String>) -> Response {
    let kind = (header::CONTENT_TYPE, HeaderValue::from_static("text/plain; charset=utf-8"));
    (status, [kind], message.into()).into_response()
}

/// The response to a viewer without a place.
fn too_many_viewers() -> Response {
    let message =
        format!("{MAX_VIEWERS} WebSockets and videos are open, which is the most; close one of them\n");
    text(StatusCode::SERVICE_UNAVAILABLE, message)
}

/// The response for a camera that is not there.
fn no_camera(reason: &NoCamera) -> Response {
    let status = match reason {
        NoCamera::Starting => StatusCode::SERVICE_UNAVAILABLE,
        NoCamera::Unknown { .. } => StatusCode::NOT_FOUND,
    };
    text(status, format!("{reason}\n"))
}
