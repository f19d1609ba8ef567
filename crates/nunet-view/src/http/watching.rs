//! The camera that a viewer of `/ws` watches.

use std::sync::Arc;

use crate::camera::{CameraStatus, Demand, OnDemand, SharedCamera, Slot};
use crate::frame::{RayGrid, ViewFrame};
use crate::pacing::ClientPacer;
use crate::protocol::{RaysJson, ServerMessage, Watch};

/// The camera that a viewer watches.
pub(super) struct Watching {
    camera: Arc<SharedCamera>,
    slot: Slot,
    pub(super) watch: Watch,
    pub(super) pacer: ClientPacer,
    is_paused: bool,
    /// What is computed for this viewer.
    demands: Vec<Demand>,
    /// The rays that were sent; `None` before the first frame.
    rays: Option<Option<Arc<RayGrid>>>,
    status: Option<CameraStatus>,
}

impl Watching {
    pub(super) fn new(camera: Arc<SharedCamera>, watch: Watch) -> Self {
        Self {
            slot: camera.slot(),
            pacer: ClientPacer::new(watch.max_fps, watch.max_mbit_per_s),
            is_paused: false,
            demands: demands(&camera, &watch),
            rays: None,
            status: None,
            camera,
            watch,
        }
    }

    /// The next frame, when it may be sent; `None` once the producer is gone.
    async fn next(&mut self) -> Option<Arc<ViewFrame>> {
        if self.is_paused {
            return std::future::pending().await;
        }
        self.pacer.ready().await;
        self.camera.next(&mut self.slot).await
    }

    pub(super) fn pause(&mut self) {
        self.is_paused = true;
        self.demands.clear();
    }

    /// The report about the stream, if it changed.
    pub(super) fn status(&mut self) -> Option<String> {
        let status = self.camera.status();
        let is_news = self.status.replace(status) != Some(status);
        is_news.then(|| ServerMessage::Status { camera: &self.camera.name, status }.to_json())
    }

    /// The report about the camera, if it changed.
    pub(super) fn description(&mut self, frame: &ViewFrame) -> Option<String> {
        if self.rays.replace(frame.rays.clone()).is_some_and(|sent| sent == frame.rays) {
            return None;
        }
        let rays = frame.rays.as_deref();
        let rays = rays.map(|grid| RaysJson { columns: grid.columns, rows: grid.rows, rays: &grid.rays });
        let SharedCamera { name, classes, .. } = &*self.camera;
        Some(ServerMessage::Camera { camera: name, classes, rays }.to_json())
    }
}

/// The results that are computed only because this viewer shows them.
fn demands(camera: &Arc<SharedCamera>, watch: &Watch) -> Vec<Demand> {
    let wanted = [
        (watch.labels, OnDemand::Labels),
        (watch.confidence, OnDemand::Confidence),
        (watch.obstacles, OnDemand::Obstacles),
    ];
    wanted.into_iter().filter(|(is_wanted, _)| *is_wanted).map(|(_, result)| camera.demand(result)).collect()
}

/// The next frame of the watched camera. Waits forever if none is watched.
pub(super) async fn next_frame(watching: &mut Option<Watching>) -> Option<Arc<ViewFrame>> {
    match watching {
        Some(watching) => watching.next().await,
        None => std::future::pending().await,
    }
}
