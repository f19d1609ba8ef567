//! Measures the factor of a camera, by which the network's meters must be multiplied.
//!
//! Each frame, image or reading is an observation: true depth over the network's depth. [`Agreement`] is
//! their median, if they agree.

mod agreement;
mod doubt;
mod error;
mod file;
mod kind;
mod point;
mod readings;
mod truth;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nunet_core::camera::{Camera, Mount, check_scale_factor};
use nunet_core::depth::DepthImage;
use nunet_core::obstacle::FloorView;
use nunet_core::pipeline::{Outputs, Pipeline};
use nunet_core::scale::FloorGauge;
use nunet_source::{BitDepthCheck, CameraNews, CameraResolver, Frame, Rotator, decode};
use nunet_types::ImageSize;

use self::agreement::Observation;
use self::readings::{Reading, SkippedReadings};
use crate::dataset::report_dim;
use crate::error::EvalError;
use crate::event::{Event, OnEvent};
use crate::image_name::ImageName;

pub use self::agreement::Agreement;
pub use self::doubt::FactorDoubt;
pub use self::error::CalibrateError;
pub use self::kind::ReferenceKind;
pub use self::point::{Pixel, Point};
pub use self::readings::files as files_of_readings;

/// The reference that each frame is compared with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reference {
    /// A point at a known distance.
    Point(Point),
    /// The floor under a camera with a known mount.
    Floor(Mount),
}

/// Collects observations. The pipeline must compute the network's meters unchanged
/// ([`ScaleMode::Off`](nunet_core::scale::ScaleMode::Off)), without filters.
pub struct Calibrator {
    pipeline: Pipeline,
    resolver: CameraResolver,
    depth_m: Vec<f32>,
    labels: Vec<u8>,
    /// For the camera and the mount of the last frame.
    gauge: Option<(Camera, Mount, FloorGauge)>,
    /// The floors that frames show, for a look at the mount.
    floors: Vec<FloorView>,
    /// The camera of the images, if it is known.
    camera: Option<Camera>,
    requires_camera: bool,
    observations: Vec<Observation>,
    /// What the observations were made with.
    kind: ReferenceKind,
    skipped: u64,
    unusable: usize,
}

impl Calibrator {
    /// A calibrator. `resolver` finds the camera of each image.
    #[must_use]
    pub fn new(pipeline: Pipeline, resolver: CameraResolver) -> Self {
        let pixels = pipeline.size().pixel_count();
        let labels = if pipeline.graph().has_labels() { vec![0; pixels] } else { Vec::new() };
        Self {
            depth_m: vec![0.0; pixels],
            labels,
            pipeline,
            resolver,
            gauge: None,
            floors: Vec::new(),
            camera: None,
            requires_camera: false,
            observations: Vec::new(),
            kind: ReferenceKind::Readings,
            skipped: 0,
            unusable: 0,
        }
    }

    /// Whether an unknown camera is an error at the first image. Otherwise it is one only when a calibration
    /// is written ([`Calibrator::write_calibration`]), after everything has been measured.
    #[must_use]
    pub fn require_camera(self, requires_camera: bool) -> Self {
        Self { requires_camera, ..self }
    }

    /// The camera of the last image whose camera is known, at the size of this image.
    #[must_use]
    pub fn camera(&self) -> Option<&Camera> {
        self.camera.as_ref()
    }

    /// The pipeline.
    #[must_use]
    pub fn pipeline(&self) -> &Pipeline {
        &self.pipeline
    }

    /// How many images with true depth could not be read, or had no depth.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// How many frames, readings or images were compared without a factor: the network has no depth there, or
    /// no floor is where the mount expects it.
    #[must_use]
    pub fn unusable(&self) -> usize {
        self.unusable
    }

    /// The factor, and how well the observations agree.
    ///
    /// # Errors
    /// Too few observations, or observations that contradict each other.
    pub fn agreement(&self) -> Result<Agreement, CalibrateError> {
        let found = Agreement::of(&self.observations, self.kind)?;
        check_scale_factor(found.factor)?;
        Ok(found)
    }

    /// Compares a frame of a source with a reference. Returns what a user should know about the camera, once.
    /// A frame without depth at the point, or without enough floor, is not an observation.
    ///
    /// # Errors
    /// A point outside the image, a camera that does not fit or is required and unknown, or a failure of the
    /// network.
    pub fn add_frame(&mut self, frame: &Frame, reference: &Reference) -> Result<CameraNews, CalibrateError> {
        let news = self.predict(frame)?;
        let factor = match reference {
            Reference::Point(point) => {
                self.kind = ReferenceKind::Point;
                self.at_point(point, frame.size)?
            }
            Reference::Floor(mount) => {
                self.kind = ReferenceKind::Floor;
                self.on_floor(*mount)?
            }
        };
        self.observe(format!("frame {}", frame.sequence), factor);
        Ok(news)
    }

    /// Compares with a table of readings: CSV with the columns `image` (a file, relative to the table), `u`,
    /// `v` (pixels) and `distance` (meters). Readings that the network does not see, or where it has no
    /// depth, are reported and skipped.
    ///
    /// # Errors
    /// A table or an image that cannot be used.
    pub fn add_readings(
        &mut self,
        path: &Path,
        on_event: &mut dyn FnMut(Event<'_>),
    ) -> Result<(), CalibrateError> {
        self.kind = ReferenceKind::Readings;
        let mut by_image: BTreeMap<PathBuf, Vec<Reading>> = BTreeMap::new();
        for reading in readings::read(path)? {
            by_image.entry(reading.image.clone()).or_default().push(reading);
        }
        on_event(Event::Started { what: "images", count: by_image.len() as u64 });
        let mut frame = Frame::default();
        let mut rotator = self.resolver.rotation().map(Rotator::new);
        let mut bit_depth = BitDepthCheck::default();
        let mut skipped = SkippedReadings::default();
        for (image, readings) in by_image {
            let (line, name) = (readings.first().map_or(0, |reading| reading.line), ImageName::from(&*image));
            let decoded = decode(&image, &mut frame).and_then(|decoded| {
                report_dim(&mut bit_depth, &decoded, &name, on_event);
                rotator.as_mut().map_or(Ok(()), |rotator| rotator.rotate(&mut frame))
            });
            decoded.map_err(|source| CalibrateError::ImageOfReading {
                table: path.to_owned(),
                line,
                source: EvalError::ReadImage { image: name.into(), source }.into(),
            })?;
            self.predict_and_report(&frame, on_event)?;
            for reading in readings {
                self.add_reading(&reading, frame.size, &mut skipped).map_err(|error| match error {
                    CalibrateError::Outside { .. } => {
                        let reason = format!("line {}: {error}", reading.line);
                        CalibrateError::Readings { path: path.to_owned(), reason }
                    }
                    other => other,
                })?;
            }
            on_event(Event::Advanced);
        }
        on_event(Event::Finished);
        skipped.report(on_event);
        self.unusable += skipped.count();
        Ok(())
    }

    fn add_reading(
        &mut self,
        reading: &Reading,
        image: ImageSize,
        skipped: &mut SkippedReadings,
    ) -> Result<(), CalibrateError> {
        match self.at_point(&reading.point, image) {
            Err(CalibrateError::OutsideView { .. }) => skipped.outside_view.push(reading.line),
            Ok(None) => skipped.without_depth.push(reading.line),
            found => self.observe(format!("line {}", reading.line), found?),
        }
        Ok(())
    }

    fn predict_and_report(&mut self, frame: &Frame, on_event: OnEvent<'_>) -> Result<(), CalibrateError> {
        on_event(Event::Camera(self.predict(frame)?));
        Ok(())
    }

    /// Runs the network.
    fn predict(&mut self, frame: &Frame) -> Result<CameraNews, CalibrateError> {
        let news = self.resolver.update(frame, &mut self.pipeline)?;
        self.camera = self.resolver.resolve(frame)?.or(self.camera);
        if self.requires_camera && self.camera.is_none() {
            return Err(CalibrateError::NoIntrinsics);
        }
        self.pipeline.reset_with_scale();
        let labels = (!self.labels.is_empty()).then_some(&mut self.labels[..]);
        let outputs = Outputs { depth_m: &mut self.depth_m, labels, confidence: None, cloud: None };
        self.pipeline.process(&frame.view()?, outputs, &|| 0)?;
        Ok(news)
    }

    fn observe(&mut self, name: String, factor: Option<f64>) {
        match factor.filter(|factor| factor.is_finite() && *factor > 0.0) {
            Some(factor) => self.observations.push(Observation { name, factor }),
            None => self.unusable += 1,
        }
    }

    fn on_floor(&mut self, mount: Mount) -> Result<Option<f64>, CalibrateError> {
        let camera = *self.pipeline.points_camera();
        if self.gauge.as_ref().is_none_or(|(known, at, _)| (*known, *at) != (camera, mount)) {
            let classes = &self.pipeline.graph().description().classes;
            self.gauge = Some((camera, mount, FloorGauge::new(&camera, mount, classes)?));
        }
        let labels = (!self.labels.is_empty()).then_some(&self.labels[..]);
        let image = DepthImage { depth_m: &self.depth_m, labels, confidence: self.pipeline.confidence() };
        self.floors.extend(self.gauge.as_ref().and_then(|(.., gauge)| gauge.floor_view(&image)));
        let found = self.gauge.as_mut().and_then(|(.., gauge)| gauge.measure(&image));
        Ok(found.map(|found| f64::from(found.ratio)))
    }
}
