//! `/api/cameras`.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use super::ServerState;
use crate::camera::{CameraStatus, SharedCamera};

#[derive(Serialize)]
struct List<'a> {
    contract: u32,
    cameras: Vec<Item<'a>>,
}

#[derive(Serialize)]
struct Item<'a> {
    name: &'a str,
    #[serde(flatten)]
    status: CameraStatus,
    classes: &'a [String],
    image: Option<Size>,
    depth: Option<Size>,
    /// `metre` or `relative`; `null` before the first frame.
    units: Option<&'static str>,
    scale_source: Option<&'static str>,
    /// Of the newest frame that was kept.
    sequence: Option<u64>,
    capture_unix_nanos: Option<i64>,
    latency_ms: Option<f64>,
}

#[derive(Serialize)]
struct Size {
    width: u32,
    height: u32,
}

impl From<nunet_types::ImageSize> for Size {
    fn from(size: nunet_types::ImageSize) -> Self {
        Self { width: size.width, height: size.height }
    }
}

fn item(camera: &SharedCamera) -> Item<'_> {
    let newest = camera.newest();
    let frame = newest.as_deref();
    let depth = frame.and_then(|frame| frame.depth()).map(|(info, _)| info);
    Item {
        name: &camera.name,
        status: camera.status(),
        classes: &camera.classes,
        image: frame.and_then(|frame| frame.image()).map(|(image, _)| image.size.into()),
        depth: depth.map(|depth| depth.size.into()),
        units: depth.map(|depth| depth.units.name()),
        scale_source: depth.map(|depth| depth.scale_source.name()),
        sequence: frame.map(|frame| frame.sequence),
        capture_unix_nanos: frame.map(|frame| frame.capture_unix_nanos),
        latency_ms: frame.map(|frame| f64::from(frame.total_micros) / 1e3),
    }
}

/// All cameras and the state of their streams.
pub(super) async fn cameras(State(shared): State<ServerState>) -> Response {
    let cameras = shared.cameras.all();
    let list = List {
        contract: nunet_types::CONTRACT_VERSION,
        cameras: cameras.iter().map(|camera| item(camera)).collect(),
    };
    // Strings, numbers and lists are always JSON.
    let json = serde_json::to_string(&list).unwrap_or_default();
    ([(header::CONTENT_TYPE, "application/json")], json).into_response()
}
