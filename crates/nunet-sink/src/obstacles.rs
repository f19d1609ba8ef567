//! The stage that finds obstacles. It runs after the pipeline, only for frames whose obstacles a reader or a
//! sink needs.

use std::fmt::Display;
use std::time::Instant;

use nunet_core::camera::{Camera, Mount};
use nunet_core::depth::DepthImage;
use nunet_core::obstacle::{ObstacleDetector, ObstacleError, ObstacleOptions, Obstacles};
use nunet_core::pipeline::Pipeline;
use nunet_types::Units;
use tracing::{info, warn};

use crate::mount_check::{LITTLE_FLOOR, MountCheck};

/// How obstacles are found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObstacleConfig {
    /// The pose of the camera on the robot.
    pub mount: Mount,
    /// What counts as an obstacle.
    pub options: ObstacleOptions,
    /// Whether the user requested obstacles. If not, a model without metric depth turns them off without an
    /// error.
    pub is_required: bool,
}

/// Finds the obstacles of one camera.
pub struct ObstacleStage {
    config: ObstacleConfig,
    classes: Vec<String>,
    /// For the camera of the last frame.
    detector: Option<(Camera, ObstacleDetector)>,
    /// Whether the detector has another mount than the configuration.
    has_new_mount: bool,
    mount_check: MountCheck,
}

impl ObstacleStage {
    /// The stage of a camera with this configuration; `None` if the model's depth has no unit.
    #[must_use]
    pub fn new(config: ObstacleConfig, pipeline: &Pipeline) -> Option<Self> {
        if pipeline.scale().units != Units::Metre {
            return None;
        }
        let graph = pipeline.graph();
        if !graph.has_labels() {
            info!("the model has no labels: floor is detected by geometry only, and glass is not detected");
        }
        let classes = graph.description().classes.clone();
        Some(Self {
            config,
            classes,
            detector: None,
            has_new_mount: false,
            mount_check: MountCheck::default(),
        })
    }

    /// How obstacles are found.
    #[must_use]
    pub fn config(&self) -> &ObstacleConfig {
        &self.config
    }

    /// Takes another mount from the next frame on whose obstacles are needed.
    pub fn set_mount(&mut self, mount: Mount) {
        (self.config.mount, self.has_new_mount) = (mount, true);
    }

    /// Finds the obstacles of a frame of `camera`. If the network has labels, `image` must have those of this
    /// frame. `now` limits the rate of warnings.
    ///
    /// # Errors
    /// Buffers of another size than the camera's image.
    pub fn detect(
        &mut self,
        camera: &Camera,
        image: &DepthImage<'_>,
        capture_nanos: i64,
        now: Instant,
    ) -> Result<&Obstacles, ObstacleError> {
        let mount = self.config.mount;
        let (detector, mount_check) = self.run(camera, image, capture_nanos)?;
        mount_check.check(detector, &mount, image, now);
        Ok(detector.last())
    }

    /// The same for an image that is independent of those before, which are forgotten. If its floor
    /// contradicts the mount, a warning with its `name` says so.
    ///
    /// # Errors
    /// Buffers of another size than the camera's image.
    pub fn detect_alone(
        &mut self,
        camera: &Camera,
        image: &DepthImage<'_>,
        name: &dyn Display,
        now: Instant,
    ) -> Result<&Obstacles, ObstacleError> {
        self.reset();
        let mount = self.config.mount;
        let (detector, mount_check) = self.run(camera, image, 0)?;
        mount_check.check_alone(detector, &mount, image, name, now);
        Ok(detector.last())
    }

    /// Finds the obstacles. Returns the detector that did, and what checks its mount.
    fn run(
        &mut self,
        camera: &Camera,
        image: &DepthImage<'_>,
        capture_nanos: i64,
    ) -> Result<(&ObstacleDetector, &mut MountCheck), ObstacleError> {
        let is_known = self.detector.as_ref().is_some_and(|(known, _)| known == camera);
        if !is_known {
            self.detector = Some((*camera, self.new_detector(camera)?));
        }
        let (_, detector) = self.detector.as_mut().expect("created above");
        if std::mem::take(&mut self.has_new_mount) && is_known {
            detector.set_mount(self.config.mount);
        }
        detector.detect(image, capture_nanos)?;
        Ok((&*detector, &mut self.mount_check))
    }

    fn new_detector(&self, camera: &Camera) -> Result<ObstacleDetector, ObstacleError> {
        let ObstacleConfig { mount, options, .. } = self.config;
        let detector = ObstacleDetector::new(camera, mount, &self.classes, options)?;
        let percent = 100.0 * detector.floor_in_view();
        if detector.floor_in_view() < LITTLE_FLOOR {
            warn!(
                "with this mount, only {percent:.1} % of the image shows floor within {} m: most directions will be unknown",
                options.max_range_m
            );
        }
        Ok(detector)
    }

    /// The obstacles of the last frame.
    #[must_use]
    pub fn last(&self) -> Option<&Obstacles> {
        self.detector.as_ref().map(|(_, detector)| detector.last())
    }

    /// Marks a discontinuity.
    pub fn reset(&mut self) {
        if let Some((_, detector)) = &mut self.detector {
            detector.reset();
        }
    }
}
