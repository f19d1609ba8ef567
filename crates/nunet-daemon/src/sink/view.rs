//! `--view ADDRESS:PORT`: the results live in the browser. The server is `nunet-view`; this sink copies frames for it while
//! somebody watches.

use std::sync::Arc;

use nunet_core::camera::{Camera, RayTable};
use nunet_telemetry::Metrics;
use nunet_types::ImageSize;
use nunet_view::{
    CameraFeed, CameraStatus, DepthInfo, MetricsText, ObstacleMap, OnDemand, RayGrid, ViewConfig, ViewFrame,
    ViewOptions, ViewServer,
};
use tracing::info;

use super::{FinishingSink, PublishedFrame, Results, Sink, SinkContext, Status, Wants};
use crate::exit::WithHint;

/// Nodes of the grid of rays. A lens is smooth: between them, the page interpolates.
const GRID: ImageSize = ImageSize::new(32, 24);

/// Opens the server, which serves `metrics` too.
///
/// # Errors
/// The address is in use, or is not an address of this machine.
pub(crate) fn open_server(config: &ViewConfig, metrics: &Metrics) -> anyhow::Result<ViewServer> {
    let ViewConfig { address, token } = config.clone();
    let (has_token, metrics) = (token.is_some(), metrics.clone());
    let text: MetricsText = Arc::new(move || metrics.text());
    let server = ViewServer::open(address, ViewOptions { token, metrics: Some(text) }).map_err(|error| {
        let message = format!("cannot serve the live view on `{address}`");
        WithHint::new(message, "pass --view 127.0.0.1:PORT with a free port").because(error)
    })?;
    let query = if has_token { "?token=TOKEN" } else { "" };
    info!("live view on {}{query}", server.url());
    Ok(server)
}

/// Opens the sink if `--view` is given.
pub(super) fn open(context: &SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>> {
    let name = context.config.name.as_str();
    Ok(context.view.map(|server| in_server(server, name, context.common.classes)))
}

/// One camera of `server`.
pub(super) fn in_server(server: &ViewServer, camera: &str, classes: &[String]) -> Box<dyn Sink> {
    Box::new(ViewSink { feed: server.add_camera(camera, classes), grid: None })
}

/// One camera's frames.
struct ViewSink {
    feed: CameraFeed,
    /// The rays of the last camera; computed again only if it changes.
    grid: Option<(Camera, Arc<RayGrid>)>,
}

impl Sink for ViewSink {
    /// The cloud is made in the browser.
    fn wants(&self) -> Wants {
        Wants {
            labels: self.feed.wants(OnDemand::Labels),
            cloud: false,
            obstacles: self.feed.wants(OnDemand::Obstacles),
        }
    }

    fn on_frame(&mut self, published: &PublishedFrame<'_>) {
        if !self.feed.is_wanted() {
            return;
        }
        let rays = published.results.camera.and_then(|camera| self.rays_of(camera));
        self.feed.offer(|frame| {
            frame.rays = rays;
            copy(published, frame);
        });
    }

    fn on_status(&mut self, status: &Status<'_>) {
        let &Status { is_up: up, counts: &frames, totals } = status;
        self.feed.set_status(CameraStatus { up, frames, fps: totals.fps() });
    }

    /// Frames that are not on their way to a viewer yet are not waited for.
    fn finish(self: Box<Self>, _last: Option<&Results<'_>>) -> FinishingSink {
        FinishingSink::done()
    }
}

impl ViewSink {
    /// `None` for a camera that cannot be scaled to the grid: its image has no pixels.
    fn rays_of(&mut self, camera: Camera) -> Option<Arc<RayGrid>> {
        if self.grid.as_ref().is_none_or(|(known, _)| *known != camera) {
            let table = RayTable::new(&camera.scaled_to(GRID.width, GRID.height).ok()?);
            let grid = RayGrid { columns: GRID.width, rows: GRID.height, rays: table.rays().to_vec() };
            self.grid = Some((camera, Arc::new(grid)));
        }
        self.grid.as_ref().map(|(_, grid)| Arc::clone(grid))
    }
}

/// Copies what a viewer may look at.
fn copy(published: &PublishedFrame<'_>, frame: &mut ViewFrame) {
    let PublishedFrame { frame: source, results, timings, .. } = published;
    frame.sequence = source.sequence;
    frame.capture_unix_nanos = source.capture.unix_nanos;
    frame.total_micros = timings.total_micros;
    if let Ok(image) = source.view() {
        frame.set_image(image.bytes(), image.size(), image.row_stride(), image.format());
    }
    let Results { units, scale_source, size, depth, labels, obstacles, .. } = *results;
    frame.set_depth(depth, DepthInfo { size, units, scale_source });
    frame.set_labels(labels.unwrap_or_default());
    if let Some(found) = obstacles {
        frame.set_obstacles(&ObstacleMap {
            sectors: &found.sectors,
            points: &found.points,
            angle_min_rad: found.angle_min_rad,
            angle_step_rad: found.angle_step_rad,
            max_range_m: found.max_range_m,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A server on a free port of loopback.
    fn server() -> ViewServer {
        ViewServer::open("127.0.0.1:0".parse().unwrap(), ViewOptions::default()).unwrap()
    }

    #[test]
    fn an_address_in_use_is_an_error_with_a_hint() {
        let taken = server();
        let config = ViewConfig { address: taken.address(), token: None };
        let error = open_server(&config, &Metrics::default()).err().unwrap();
        let text = crate::exit::chain_text(&error);
        assert!(text.starts_with("error: cannot serve the live view on `127.0.0.1:"), "{text}");
        assert!(text.contains("\nhint: pass --view 127.0.0.1:PORT"), "{text}");
    }

    #[test]
    fn the_grid_has_the_rays_of_the_camera_and_is_computed_once() {
        let intrinsics = nunet_core::camera::Intrinsics::new(500.0, 500.0, 319.5, 239.5, 640, 480).unwrap();
        let camera = Camera::pinhole(intrinsics);
        let mut sink = ViewSink { feed: server().add_camera("front", &[]), grid: None };
        let grid = sink.rays_of(camera).unwrap();
        // Node 0 is the mean of the first 20 pixels: pixel 9.5.
        let expected = (9.5 - 319.5) / 500.0;
        assert!((grid.rays[0][0] - expected).abs() < 1e-6, "{:?}", grid.rays[0]);
        assert!(Arc::ptr_eq(&grid, &sink.rays_of(camera).unwrap()));
    }
}
