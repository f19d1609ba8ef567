//! Inference of one image.

use std::sync::{Arc, PoisonError};

use nunet_core::camera::CalibratedScale;
use nunet_engine::{EngineError, Inferred};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::{PyModel, scale};
use crate::camera::PyCamera;
use crate::error::{failure, hinted, of_camera};
use crate::image::ImageArgument;
use crate::result::{Result, ResultContext};

impl PyModel {
    /// Runs `work` with exclusive access to the model and without the GIL.
    ///
    /// # Errors
    /// This process is a fork of the one that made the model.
    pub(crate) fn exclusive<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut nunet_engine::Model) -> T + Send,
    ) -> PyResult<T> {
        let inner = self.inner.get("model")?;
        // After a panic the buffers may hold values of an older image: every run overwrites them.
        Ok(py.detach(|| work(&mut inner.lock().unwrap_or_else(PoisonError::into_inner))))
    }

    pub(crate) fn shared(&self) -> Arc<ResultContext> {
        Arc::clone(&self.shared)
    }

    /// Warns, once for a model, of a missing camera, of images with another aspect ratio, and of a factor
    /// that was measured with them taken otherwise.
    pub(crate) fn warn_of_guesses(&self, py: Python<'_>, inferred: &Inferred) -> PyResult<()> {
        self.warnings.issue(py, inferred.report.scale_source, &inferred.framing)?;
        self.warnings.issue_of_measured_aspect(py, inferred.aspect_mismatch.as_ref())
    }

    /// Warns, once for a model, that a camera's factor is for another model.
    pub(crate) fn warn_of_factor(&self, py: Python<'_>, is_used: bool) -> PyResult<()> {
        self.warnings.issue_of_factor(py, is_used)
    }

    pub(super) fn infer_one(
        &self,
        py: Python<'_>,
        image: &ImageArgument<'_>,
        Setting { camera, keep_state, attitude }: Setting,
    ) -> PyResult<Result> {
        let frame = image.view()?;
        let size = frame.size();
        let factor = self.factor_of(camera)?;
        let fitted = |camera: PyCamera| camera.0.fitted_to(size.width, size.height).map_err(of_camera);
        let camera = camera.map(fitted).transpose()?;
        let mount = attitude.map(|attitude| scale::with_attitude(self.mount, attitude)).transpose()?;
        let usual = self.mount.filter(|_| mount.is_some());
        let inferred = self.exclusive(py, |model| {
            let is_used = model.set_calibrated_scale(factor)?;
            mount.into_iter().for_each(|mount| model.set_mount(mount));
            let inferred = model.infer(&frame, camera, keep_state);
            // The attitude is that of this image only.
            usual.into_iter().for_each(|usual| model.set_mount(usual));
            Ok((is_used, inferred?))
        })?;
        let (is_used, inferred) = inferred.map_err(|error: EngineError| failure(&error.into()))?;
        self.warnings.issue_of_image(py, image)?;
        self.warn_of_factor(py, is_used)?;
        self.warn_of_guesses(py, &inferred)?;
        Result::of_image(py, inferred, self.shared())
    }
}

/// The settings of one inference.
#[derive(Clone, Copy)]
pub(super) struct Setting {
    pub(super) camera: Option<PyCamera>,
    pub(super) keep_state: bool,
    /// Roll and pitch of the camera, radians.
    pub(super) attitude: Option<(f64, f64)>,
}

impl PyModel {
    /// The factor of a camera's calibration.
    ///
    /// # Errors
    /// The model has a factor too.
    pub(crate) fn factor_of(&self, camera: Option<PyCamera>) -> PyResult<Option<CalibratedScale>> {
        match camera.and_then(|camera| camera.1) {
            Some(scale) if self.has_factor => Err(hinted::<PyValueError>(
                format!("the camera has the scale {}, and the model has one too", scale.factor),
                "give one of them: `Camera(..., scale=)` or `Model(..., scale=)`",
            )),
            scale => Ok(scale),
        }
    }
}
