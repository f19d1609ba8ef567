//! Results for the live view in the browser. The server is `nunet-view`; this sink copies frames for it while
//! a client watches.

use std::sync::Arc;

use nunet_core::camera::{Camera, RayTable};
use nunet_types::{ImageSize, PixelRect};
use nunet_view::{CameraFeed, CameraStatus, DepthInfo, OnDemand, RayGrid, ViewFrame, ViewServer};

use crate::results::Results;
use crate::sink::{FinishingSink, PublishedFrame, Sink, Status, Wants};

/// Nodes of the grid of rays. The page interpolates between them, because lens models are smooth.
const GRID: ImageSize = ImageSize::new(32, 24);

/// Adds a camera to `server`.
#[must_use]
pub fn view_sink(server: &ViewServer, camera: &str, classes: &[String]) -> Box<dyn Sink> {
    Box::new(ViewSink { feed: server.add_camera(camera, classes), grid: None })
}

/// One camera's frames.
struct ViewSink {
    feed: CameraFeed,
    /// The rays of the last camera; computed again only if it changes.
    grid: Option<(Camera, Arc<RayGrid>)>,
}

impl Sink for ViewSink {
    /// The browser computes the cloud.
    fn wants(&self) -> Wants {
        Wants {
            labels: self.feed.wants(OnDemand::Labels),
            confidence: self.feed.wants(OnDemand::Confidence),
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

    /// Does not wait for frames that are not being sent yet.
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

/// Copies the results that viewers show.
fn copy(published: &PublishedFrame<'_>, frame: &mut ViewFrame) {
    let PublishedFrame { frame: source, results, timings, .. } = published;
    frame.sequence = source.sequence;
    frame.capture_unix_nanos = source.capture.unix_nanos;
    frame.total_micros = timings.total_micros;
    if let Ok(image) = source.view() {
        frame.set_image(image.bytes(), image.size(), image.row_stride(), image.format());
    }
    let Results { scale, size, depth, labels, confidence, obstacles, view, .. } = *results;
    let view = shares_of(view, source.size);
    frame.set_depth(depth, DepthInfo { size, units: scale.units, scale_source: scale.source, view });
    frame.set_labels(labels.unwrap_or_default());
    frame.set_confidence(confidence.unwrap_or_default());
    if let Some(found) = obstacles {
        frame.set_obstacles(&found.map());
    }
}

/// A part of an image as shares of it.
fn shares_of(part: PixelRect, ImageSize { width, height }: ImageSize) -> [f32; 4] {
    let (columns, rows) = (width.max(1) as f32, height.max(1) as f32);
    [part.x as f32 / columns, part.y as f32 / rows, part.width as f32 / columns, part.height as f32 / rows]
}

#[cfg(test)]
mod tests {
    use nunet_view::ViewOptions;

    use super::*;

    /// A server on a free port of loopback.
    fn server() -> ViewServer {
        ViewServer::open("127.0.0.1:0".parse().unwrap(), ViewOptions::default()).unwrap()
    }

    #[test]
    fn a_part_of_an_image_becomes_shares_of_it() {
        let part = PixelRect { x: 160, y: 0, width: 960, height: 720 };
        assert_eq!(shares_of(part, ImageSize::new(1280, 720)), [0.125, 0.0, 0.75, 1.0]);
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
