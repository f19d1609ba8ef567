//! `frame.jpg` and `depth.png`: the newest frame as a file.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use nunet_types::Units;

use super::{ServerState, no_camera, text};
use crate::camera::SharedCamera;
use crate::encode::{depth_png, image_jpeg};
use crate::frame::{Encoded, ViewFrame};

/// If no new frame arrives within this time, the last one is sent.
const NEXT_FRAME_TIMEOUT: Duration = Duration::from_secs(1);

/// The newest image, JPEG.
pub(super) async fn image(State(shared): State<ServerState>, Path(camera): Path<String>) -> Response {
    let frame = match newest(&shared, &camera).await {
        Ok(frame) => frame,
        Err(response) => return response,
    };
    file(&frame, "image/jpeg", frame.encoded(Encoded::Jpeg(1), || image_jpeg(&frame, 1)))
}

/// The newest depth map, 16-bit PNG in millimeters.
pub(super) async fn depth(State(shared): State<ServerState>, Path(camera): Path<String>) -> Response {
    let frame = match newest(&shared, &camera).await {
        Ok(frame) => frame,
        Err(response) => return response,
    };
    if frame.depth().is_some_and(|(info, _)| info.units != Units::Metre) {
        return text(StatusCode::CONFLICT, "depth of this model is relative: it has no millimeters\n");
    }
    file(&frame, "image/png", frame.encoded(Encoded::DepthPng, || depth_png(&frame)))
}

/// The next frame, or the last one if the source is paused.
async fn newest(shared: &ServerState, name: &str) -> Result<Arc<ViewFrame>, Response> {
    let camera = shared.cameras.find(name).map_err(|reason| no_camera(&reason))?;
    let frame = next(&camera).await.or_else(|| camera.newest());
    frame.ok_or_else(|| text(StatusCode::SERVICE_UNAVAILABLE, "the camera has not delivered a frame yet\n"))
}

async fn next(camera: &SharedCamera) -> Option<Arc<ViewFrame>> {
    let mut slot = camera.slot();
    slot.mark_unchanged();
    tokio::time::timeout(NEXT_FRAME_TIMEOUT, camera.next(&mut slot)).await.ok().flatten()
}

fn file(frame: &ViewFrame, kind: &'static str, bytes: Bytes) -> Response {
    if bytes.is_empty() {
        return text(StatusCode::SERVICE_UNAVAILABLE, "the newest frame has no such image\n");
    }
    let number = |number: String| HeaderValue::try_from(number).unwrap_or(HeaderValue::from_static("0"));
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
        (HeaderName::from_static("x-nunet-sequence"), number(frame.sequence.to_string())),
        (HeaderName::from_static("x-nunet-capture-unix-nanos"), number(frame.capture_unix_nanos.to_string())),
    ];
    (headers, bytes).into_response()
}
