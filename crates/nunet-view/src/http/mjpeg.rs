//! `image.mjpeg` and `depth.mjpeg`: one JPEG after the other in a response that does not end.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Path, Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::Instant;

use super::parameters::VideoQuery;
use super::{ServerState, no_camera, text, too_many_viewers};
use crate::camera::{SharedCamera, Slot};
use crate::encode::{auto_range, colorize, image_jpeg, rgb_jpeg, stride_for};
use crate::frame::{Encoded, ViewFrame};
use crate::pacing::ClientPacer;
use crate::protocol::Watch;

const CONTENT_TYPE: &str = "multipart/x-mixed-replace; boundary=nunet-frame";

/// The parameters of an address: names and values.
type Parameters = Vec<(String, String)>;

/// How a frame becomes a JPEG.
type Encode = Box<dyn FnMut(&ViewFrame) -> Bytes + Send>;

/// The image.
pub(super) async fn image(
    State(shared): State<ServerState>,
    Path(camera): Path<String>,
    Query(parameters): Query<Parameters>,
) -> Response {
    respond(&shared, &camera, &parameters, |_, watch| {
        let max_width = watch.max_width;
        Box::new(move |frame| {
            let stride = frame.image().map_or(1, |(image, _)| stride_for(image.size.width, max_width));
            frame.encoded(Encoded::Jpeg(stride), || image_jpeg(frame, stride))
        })
    })
}

/// Depth in colors.
pub(super) async fn depth(
    State(shared): State<ServerState>,
    Path(camera): Path<String>,
    Query(parameters): Query<Parameters>,
) -> Response {
    respond(&shared, &camera, &parameters, |query, watch| {
        let (near, far, max_width) = (query.near, query.far, watch.max_width);
        let mut smooth = None;
        Box::new(move |frame| {
            let range = smoothed(&mut smooth, auto_range(frame));
            depth_jpeg(frame, max_width, (near.unwrap_or(range.0), far.unwrap_or(range.1)))
        })
    })
}

fn respond(
    shared: &ServerState,
    name: &str,
    parameters: &[(String, String)],
    encoder: impl FnOnce(&VideoQuery, &Watch) -> Encode,
) -> Response {
    let camera = match shared.cameras.find(name) {
        Ok(camera) => camera,
        Err(reason) => return no_camera(&reason),
    };
    let checked = VideoQuery::read(parameters).and_then(|query| Ok((query.watch(name)?, query)));
    let (watch, query) = match checked {
        Ok(checked) => checked,
        Err(error) => return text(StatusCode::BAD_REQUEST, format!("{error}\n")),
    };
    let Some(place) = shared.place() else { return too_many_viewers() };
    let encode = encoder(&query, &watch);
    let pacer = ClientPacer::new(watch.max_fps, watch.max_mbit_per_s);
    // The frame that is kept comes first, also if the source is paused.
    let slot = camera.slot();
    let video = MjpegStream { camera, slot, pacer, encode, _place: place };
    let parts = futures_util::stream::unfold(video, |mut video| async move {
        let part = video.next().await?;
        Some((Ok::<_, std::convert::Infallible>(part), video))
    });
    ([(header::CONTENT_TYPE, CONTENT_TYPE)], Body::from_stream(parts)).into_response()
}

/// The video of one client.
struct MjpegStream {
    camera: Arc<SharedCamera>,
    slot: Slot,
    pacer: ClientPacer,
    encode: Encode,
    /// Free again once the client is gone.
    _place: OwnedSemaphorePermit,
}

impl MjpegStream {
    /// The next part of the response; `None` once the camera is gone. It is not called while the client reads
    /// nothing.
    async fn next(&mut self) -> Option<Bytes> {
        loop {
            self.pacer.ready().await;
            let frame = self.camera.next(&mut self.slot).await?;
            let jpeg = (self.encode)(&frame);
            if !jpeg.is_empty() {
                self.pacer.sent(jpeg.len(), Instant::now());
                return Some(part(&jpeg));
            }
        }
    }
}

fn part(jpeg: &Bytes) -> Bytes {
    let head = format!("--nunet-frame\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n", jpeg.len());
    [head.as_bytes(), jpeg, b"\r\n"].concat().into()
}

fn depth_jpeg(frame: &ViewFrame, max_width: u32, range: (f32, f32)) -> Bytes {
    let stride = frame.depth().map_or(1, |(info, _)| stride_for(info.size.width, max_width));
    let colors = colorize(frame, stride, range);
    colors.map(|(rgb, size)| rgb_jpeg(&rgb, size.width, size.height).into()).unwrap_or_default()
}

/// A color range that follows slowly, so that colors do not flicker.
fn smoothed(smooth: &mut Option<(f32, f32)>, (near, far): (f32, f32)) -> (f32, f32) {
    const NEW_SHARE: f32 = 0.1;
    let mix = |old: f32, new: f32| old + NEW_SHARE * (new - old);
    let range = smooth.map_or((near, far), |old| (mix(old.0, near), mix(old.1, far)));
    *smooth = Some(range);
    range
}
