//! Data that a model shares with its results.

use std::sync::{Arc, Mutex, PoisonError};

use nunet_core::camera::{Camera, RayTable};
use nunet_core::pipeline::MAX_RAY_ANGLE_RAD;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// Names from the model file, and the rays of the last cloud.
pub(crate) struct ResultContext {
    pub(crate) class_names: Py<PyTuple>,
    pub(crate) stage_names: Vec<String>,
    /// Kept so that they are computed once for a stream.
    rays: Mutex<Option<(Camera, Arc<RayTable>)>>,
}

impl ResultContext {
    pub(crate) fn new(class_names: Py<PyTuple>, stage_names: Vec<String>) -> Self {
        Self { class_names, stage_names, rays: Mutex::default() }
    }

    /// The rays of a camera.
    pub(super) fn rays(&self, camera: Camera) -> Arc<RayTable> {
        let mut kept = self.rays.lock().unwrap_or_else(PoisonError::into_inner);
        match &*kept {
            Some((of, rays)) if *of == camera => Arc::clone(rays),
            _ => {
                let rays = RayTable::within_angle(&camera, MAX_RAY_ANGLE_RAD);
                Arc::clone(&kept.insert((camera, Arc::new(rays))).1)
            }
        }
    }
}
