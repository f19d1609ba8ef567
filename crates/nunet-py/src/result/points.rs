//! What is computed from a result's arrays: points, files and obstacles.

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use numpy::PyArrayMethods as _;
use nunet_core::camera;
use nunet_core::cloud::{CloudOptions, CloudPoint, organized_cloud};
use nunet_core::depth::DepthImage;
use nunet_core::filter::Appearance;
use nunet_core::obstacle::ObstacleOptions;
use nunet_files::{ResultArrays, write_results};
use nunet_types::ImageSize;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::Result;
use crate::camera::PyCamera;
use crate::cloud::METRE;
use crate::error::{NunetError, failure, hinted, of_camera};
use crate::obstacles::{self, PyObstacles};

impl Result {
    /// Width and height of `depth`.
    pub(super) fn size(&self) -> ImageSize {
        ImageSize::new(self.points_camera.intrinsics.width, self.points_camera.intrinsics.height)
    }

    /// The camera of the points, at the size of `depth`. A given camera may have the size of the image or any
    /// other of its aspect ratio.
    pub(super) fn camera_for_points(&self, camera: Option<PyCamera>) -> PyResult<camera::Camera> {
        let Some(PyCamera(camera, _)) = camera else { return Ok(self.points_camera) };
        let (image, own) = (self.image_size, self.size());
        let fitted = camera
            .fitted_to(image.width, image.height)
            .and_then(|camera| camera.cropped(self.view).scaled_to(own.width, own.height));
        fitted.map_err(of_camera)
    }

    /// One point per pixel of `depth`; those beyond `max_range_m` have no coordinates.
    pub(super) fn points(
        &self,
        py: Python<'_>,
        camera: Option<PyCamera>,
        max_range_m: f32,
    ) -> PyResult<Vec<CloudPoint>> {
        let camera = self.camera_for_points(camera)?;
        let depth = self.depth.bind(py).try_readonly()?;
        let rgb = self.rgb.bind(py).try_readonly()?;
        let labels = self.labels.as_ref().map(|labels| labels.bind(py).try_readonly()).transpose()?;
        let (depth, rgb) = (depth.as_slice()?, rgb.as_slice()?);
        let labels = labels.as_ref().map(|labels| labels.as_slice()).transpose()?;
        let points = py.detach(|| {
            let mut points = vec![CloudPoint::NONE; depth.len()];
            let rays = self.shared.rays(camera);
            let options = CloudOptions { stride: NonZeroU32::MIN, max_range_m };
            let appearance = Appearance { rgb, labels };
            organized_cloud(depth, &rays, &appearance, options, &mut points).map(|()| points)
        });
        points.map_err(|error| NunetError::new_err(error.to_string()))
    }

    /// Writes the files of [`Result::save`].
    pub(super) fn write(
        &self,
        py: Python<'_>,
        folder: &Path,
        cloud: &[CloudPoint],
    ) -> PyResult<Vec<PathBuf>> {
        let depth = self.depth.bind(py).try_readonly()?;
        let labels = self.labels.as_ref().map(|labels| labels.bind(py).try_readonly()).transpose()?;
        let confidence = self.confidence.as_ref().map(|values| values.bind(py).try_readonly()).transpose()?;
        let results = ResultArrays {
            size: self.size(),
            depth: depth.as_slice()?,
            metric: self.units == METRE,
            labels: labels.as_ref().map(|labels| labels.as_slice()).transpose()?,
            confidence: confidence.as_ref().map(|values| values.as_slice()).transpose()?,
            cloud: Some(cloud),
        };
        py.detach(|| write_results(folder, &results)).map_err(|error| failure(&error.into()))
    }

    /// The obstacles of [`Result::obstacles`].
    pub(super) fn find_obstacles(
        &self,
        py: Python<'_>,
        mount: &[f64],
        camera: Option<PyCamera>,
        options: ObstacleOptions,
    ) -> PyResult<PyObstacles> {
        if self.units != METRE {
            let text = format!("obstacles need depth in meters; this result is `{}`", self.units);
            return Err(hinted::<PyValueError>(text, "take a model with metric depth"));
        }
        let mount = obstacles::mount(mount)?;
        let camera = self.camera_for_points(camera)?;
        let classes: Vec<String> = self.shared.class_names.extract(py)?;
        let depth = self.depth.bind(py).try_readonly()?;
        let labels = self.labels.as_ref().map(|labels| labels.bind(py).try_readonly()).transpose()?;
        let labels = labels.as_ref().map(|labels| labels.as_slice()).transpose()?;
        let confidence = self.confidence.as_ref().map(|values| values.bind(py).try_readonly()).transpose()?;
        let confidence = confidence.as_ref().map(|values| values.as_slice()).transpose()?;
        let image = DepthImage { depth_m: depth.as_slice()?, labels, confidence };
        PyObstacles::of_depth(py, &image, &camera, mount, &classes, options)
    }
}
