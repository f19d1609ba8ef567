//! A result from what the network computed.

use std::sync::Arc;

use nunet_engine::Inferred;
use nunet_types::shortest;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::memory::array;
use super::{Origin, Result, ResultContext};
use crate::camera::PyCamera;
use crate::image_replay::ReplayedImage;

impl Result {
    /// The results of an image.
    pub(crate) fn of_image(py: Python<'_>, inferred: Inferred, shared: Arc<ResultContext>) -> PyResult<Self> {
        Self::new(py, inferred, Origin::default(), shared)
    }

    /// The results of an image of a recording.
    pub(crate) fn of_recording(
        py: Python<'_>,
        played: ReplayedImage,
        topic: String,
        shared: Arc<ResultContext>,
    ) -> PyResult<Self> {
        let origin = Origin {
            topic: Some(topic),
            frame_id: played.frame_id,
            sequence: Some(played.sequence),
            capture_nanos: Some(played.capture_unix_nanos),
        };
        Self::new(py, played.inferred, origin, shared)
    }

    fn new(py: Python<'_>, inferred: Inferred, origin: Origin, shared: Arc<ResultContext>) -> PyResult<Self> {
        let Inferred { depth, labels, confidence, rgb, report, points_camera, framing, total_nanos, .. } =
            inferred;
        let (width, height) = (points_camera.intrinsics.width, points_camera.intrinsics.height);
        let (rows, columns) = (height as usize, width as usize);
        let timings = PyDict::new(py);
        for (name, &micros) in shared.stage_names.iter().zip(report.stages.micros()) {
            timings.set_item(name, f64::from(micros) / 1e3)?;
        }
        timings.set_item("total", total_nanos as f64 / 1e6)?;
        let labels = labels.map(|labels| array(py, labels, [rows, columns])).transpose()?;
        let confidence = confidence.map(|values| array(py, values, [rows, columns])).transpose()?;
        Ok(Self {
            depth: array(py, depth, [rows, columns])?.cast_into()?.unbind(),
            labels: labels.map(|labels| labels.cast_into().map(Bound::unbind)).transpose()?,
            confidence: confidence.map(|values| values.cast_into().map(Bound::unbind)).transpose()?,
            rgb: array(py, rgb, [rows, columns, 3])?.cast_into()?.unbind(),
            units: report.units.name().to_owned(),
            scale_source: report.scale_source.name().to_owned(),
            scale_factor: (report.scale_factor > 0.0).then_some(shortest(report.scale_factor)),
            timings: timings.unbind(),
            invalid_pixels: report.invalid_pixels,
            quality: report.quality.name().to_owned(),
            camera: report.camera.map(|camera| PyCamera(camera, None)),
            origin,
            points_camera,
            image_size: framing.image(),
            view: framing.view(),
            shared,
        })
    }
}
