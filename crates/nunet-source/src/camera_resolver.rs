//! Finds the camera that took a frame: the one that the user gave, otherwise that of the source.

use std::io::{self, ErrorKind, Read as _};
use std::path::{Path, PathBuf};

use nunet_core::camera::{CalibratedScale, Calibration, Camera, CameraError, IntrinsicsSpec};
use nunet_core::depth::ScaleSource;
use nunet_core::framing::Framing;
use nunet_core::pipeline::Pipeline;
use nunet_core::plain_file;
use nunet_types::{Hint as _, ImageSize};
use tracing::warn;

use crate::error::SourceError;
use crate::frame::Frame;
use crate::rotation::Rotation;

/// The camera that the user gave: intrinsics or a calibration.
#[derive(Debug, Clone, Default)]
pub struct CameraGeometry {
    /// Focal lengths and principal point of a camera without distortion.
    pub intrinsics: Option<IntrinsicsSpec>,
    /// A calibration file.
    pub calibration: Option<PathBuf>,
    /// How images are rotated. Intrinsics and calibration describe the images before.
    pub rotation: Option<Rotation>,
    /// The factor of depth. The pipeline has it too; a calibration file must not give another one.
    pub factor: Option<f32>,
}

/// Determines the camera of each frame of a stream.
#[derive(Debug, Default)]
pub struct CameraResolver {
    named: Option<Named>,
    /// From the images that the named camera describes to those of the frames.
    rotation: Option<Rotation>,
    /// The inputs of the pipeline's current camera.
    current: Option<Key>,
    has_reported: bool,
    has_reported_framing: bool,
    /// The named camera, if any, fitted a frame.
    fits: bool,
}

/// The camera that the user named.
#[derive(Debug)]
enum Named {
    Intrinsics(IntrinsicsSpec),
    Calibration(Box<Calibration>),
}

impl Named {
    fn at_size(&self, ImageSize { width, height }: ImageSize) -> Result<Camera, CameraError> {
        match self {
            Self::Intrinsics(spec) => spec.at_size(width, height).map(Camera::pinhole),
            Self::Calibration(calibration) => calibration.at_size(width, height),
        }
    }
}

/// What a user should know about the camera of a stream, each once.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraNews {
    /// What is assumed about an unknown camera: "points assume the training camera".
    pub assumption: Option<&'static str>,
    /// How images of another aspect ratio than the network's are taken ([`Framing::notice`]).
    pub framing: Option<Framing>,
}

/// A camera is resolved again when one of these changes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Key {
    size: ImageSize,
    camera: Option<Camera>,
}

impl CameraResolver {
    /// A camera that the user named takes precedence over that of the source.
    ///
    /// # Errors
    /// The calibration file cannot be read or is not a calibration, or a factor of depth is given twice.
    pub fn new(geometry: &CameraGeometry) -> Result<Self, SourceError> {
        let named = match (&geometry.calibration, geometry.intrinsics) {
            (Some(path), _) => Some(Named::Calibration(read_calibration(path)?.into())),
            (None, intrinsics) => intrinsics.map(Named::Intrinsics),
        };
        let resolver = Self { named, rotation: geometry.rotation, ..Self::default() };
        resolver.check_rotation(geometry.calibration.as_deref())?;
        match (resolver.calibrated_scale(), geometry.factor, &geometry.calibration) {
            (Some(scale), Some(given), Some(path)) => Err(SourceError::bad_arguments(format!(
                "the scale factor {given} conflicts with the factor {} in the calibration `{}`",
                scale.factor,
                path.display()
            ))
            .with_hint("give one of them: remove `nunet_scale` from the file, or omit the number")),
            _ => Ok(resolver),
        }
    }

    /// Refuses a calibration whose camera cannot be rotated, before any frame.
    fn check_rotation(&self, path: Option<&Path>) -> Result<(), SourceError> {
        let (Some(rotation), Some(Named::Calibration(calibration))) = (self.rotation, &self.named) else {
            return Ok(());
        };
        let rotated = rotation.camera(&calibration.camera());
        rotated.map(drop).map_err(|error| {
            let shown = path.unwrap_or(Path::new("")).display();
            SourceError::bad_arguments(format!("cannot rotate the camera of the calibration `{shown}`"))
                .with_cause(error)
        })
    }

    /// How the images of the frames were rotated.
    #[must_use]
    pub fn rotation(&self) -> Option<Rotation> {
        self.rotation
    }

    /// The factor of depth in the calibration that the user named.
    fn calibrated_scale(&self) -> Option<CalibratedScale> {
        match &self.named {
            Some(Named::Calibration(calibration)) => calibration.scale(),
            _ => None,
        }
    }

    /// The camera that took `frame`, at the frame's size; `None` if it is unknown.
    ///
    /// # Errors
    /// The named camera does not fit the frame's size.
    pub fn camera_of(&self, frame: &Frame) -> Result<Option<Camera>, CameraError> {
        let Some(named) = &self.named else { return Ok(frame.camera) };
        match self.rotation {
            None => named.at_size(frame.size),
            Some(rotation) => rotation.camera(&named.at_size(rotation.size(frame.size))?),
        }
        .map(Some)
    }

    /// As [`CameraResolver::camera_of`], for a stream of frames.
    ///
    /// # Errors
    /// [`Argument`](crate::SourceErrorKind::Argument) if the camera that the user named does not fit
    /// the first frame: it will not fit the next one either. [`BadFrame`](crate::SourceErrorKind::BadFrame)
    /// if it does not fit a later one.
    pub fn resolve(&mut self, frame: &Frame) -> Result<Option<Camera>, SourceError> {
        let camera = self.camera_of(frame).map_err(|error| {
            let wrong = if self.fits { SourceError::bad_frame } else { SourceError::bad_arguments };
            wrong("the given calibration or intrinsics do not fit the images of the source".to_owned())
                .with_cause(error)
        })?;
        self.fits = true;
        Ok(camera)
    }

    /// Passes the camera and the size of the frame to the pipeline if they changed. Returns what a user
    /// should know, once.
    ///
    /// # Errors
    /// As [`CameraResolver::resolve`], or [`BadFrame`](crate::SourceErrorKind::BadFrame) if the camera does
    /// not fit the network.
    pub fn update(&mut self, frame: &Frame, pipeline: &mut Pipeline) -> Result<CameraNews, SourceError> {
        let key = Key { size: frame.size, camera: frame.camera };
        if self.current == Some(key) {
            return Ok(CameraNews::default());
        }
        let camera = self.resolve(frame)?;
        pipeline.set_camera(camera).and_then(|()| pipeline.fit_to(frame.size)).map_err(|error| {
            SourceError::bad_frame("the camera does not fit the network").with_cause(error)
        })?;
        if self.current.is_none() {
            self.pass_factor(pipeline)?;
        }
        self.current = Some(key);
        let is_news = camera.is_none() && !std::mem::replace(&mut self.has_reported, true);
        let framing = Some(*pipeline.framing()).filter(|framing| {
            framing.notice().is_some() && !std::mem::replace(&mut self.has_reported_framing, true)
        });
        Ok(CameraNews { assumption: is_news.then(|| assumption(pipeline)), framing })
    }
}

impl CameraResolver {
    /// Passes the factor of the calibration to the pipeline, unless it was measured with another model.
    fn pass_factor(&self, pipeline: &mut Pipeline) -> Result<(), SourceError> {
        let Some(scale) = self.calibrated_scale() else { return Ok(()) };
        let factor = scale.factor;
        if !scale.is_for(&pipeline.graph().description().hash) {
            warn!(
                "the calibration's scale factor {factor} is ignored: it was measured with another model; calibrate again"
            );
            return Ok(());
        }
        pipeline.set_calibrated_factor(Some(factor)).map_err(|error| {
            SourceError::bad_arguments("the calibration's scale factor cannot be used".to_owned())
                .with_cause(error)
        })?;
        if let Some(mismatch) = pipeline.aspect_mismatch(&scale) {
            warn!(hint = mismatch.hint().as_deref(), "{mismatch}");
        }
        Ok(())
    }
}

/// What a pipeline assumes about an unknown camera.
fn assumption(pipeline: &Pipeline) -> &'static str {
    let training_camera = pipeline.graph().description().camera.is_some();
    match pipeline.scale().source {
        ScaleSource::AssumedCamera => "meters and points assume the training camera",
        _ if training_camera => "points assume the training camera",
        _ => "points assume a camera of 60 degrees from left to right",
    }
}

/// Reads a calibration that the user named.
///
/// # Errors
/// The file cannot be read or is not a calibration.
pub fn read_calibration(path: &Path) -> Result<Calibration, SourceError> {
    let path_shown = path.display();
    let text = read_start(path).map_err(|error| {
        SourceError::bad_arguments(format!("cannot read the calibration `{path_shown}`"))
            .with_hint("pass a ROS `camera_info` file in YAML")
            .with_cause(error)
    })?;
    let calibration = Calibration::parse(&text).map_err(|error| {
        SourceError::bad_arguments(format!("cannot use the calibration `{path_shown}`")).with_cause(error)
    })?;
    if let Some(skew) = calibration.ignored_skew() {
        warn!("calibration `{path_shown}`: {skew}");
    }
    if let Some(model) = calibration.assumed_model() {
        warn!("calibration `{path_shown}` names no distortion model: its coefficients are read as `{model}`");
    }
    Ok(calibration)
}

/// Reads at most one byte more than a calibration may have. The parser rejects text that is not UTF-8.
fn read_start(path: &Path) -> io::Result<String> {
    let Some(mut file) = plain_file::open(path, Calibration::MAX_BYTES as u64 + 1)? else {
        return Err(io::Error::new(ErrorKind::InvalidInput, "it is not a regular file"));
    };
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::SourceErrorKind;

    #[test]
    fn a_camera_that_does_not_fit_is_a_bad_argument_at_first_and_a_bad_frame_later() {
        let intrinsics = Some("50,50,32,18@64x36".parse().unwrap());
        let geometry = CameraGeometry { intrinsics, ..CameraGeometry::default() };
        let frame = |size| Frame { size, ..Frame::default() };
        let mut resolver = CameraResolver::new(&geometry).unwrap();
        let mut kind = |size| resolver.resolve(&frame(size)).map_err(|error| error.kind());
        assert_eq!(kind((64, 64).into()), Err(SourceErrorKind::Argument));
        assert!(kind((128, 72).into()).unwrap().is_some());
        assert_eq!(kind((64, 64).into()), Err(SourceErrorKind::BadFrame));
        assert_eq!(CameraResolver::default().resolve(&frame((64, 64).into())).unwrap(), None);
    }

    #[test]
    fn the_named_camera_describes_the_image_before_the_rotation() {
        let intrinsics = Some("50,60,20,15@64x36".parse().unwrap());
        let geometry =
            CameraGeometry { intrinsics, rotation: Some(Rotation::Quarter), ..CameraGeometry::default() };
        let resolver = CameraResolver::new(&geometry).unwrap();
        let frame = Frame { size: (72, 128).into(), ..Frame::default() };
        let camera = resolver.camera_of(&frame).unwrap().unwrap().intrinsics;
        assert_eq!((camera.width, camera.height), (72, 128));
        assert_eq!((camera.fx_px, camera.fy_px), (120.0, 100.0));
        let upright = Frame { size: (128, 72).into(), ..Frame::default() };
        assert!(resolver.camera_of(&upright).is_err(), "the stored image would be 72x128");
    }

    #[test]
    fn a_calibration_that_cannot_be_rotated_is_a_bad_argument() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let text = "image_width: 64\nimage_height: 36\ndistortion_model: rational_polynomial\n\
                    camera_matrix: {rows: 3, cols: 3, data: [50, 0, 32, 0, 50, 18, 0, 0, 1]}\n\
                    distortion_coefficients: {rows: 1, cols: 14, data: [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.01, 0]}\n";
        std::fs::write(file.path(), text).unwrap();
        let upright = CameraGeometry { calibration: Some(file.path().into()), ..CameraGeometry::default() };
        assert!(CameraResolver::new(&upright).is_ok());
        let turned = CameraGeometry { rotation: Some(Rotation::Half), ..upright };
        assert_eq!(CameraResolver::new(&turned).unwrap_err().kind(), SourceErrorKind::Argument);
    }

    #[test]
    fn a_factor_that_is_given_twice_is_a_bad_argument() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let camera =
            Camera::pinhole(nunet_core::camera::Intrinsics::new(50.0, 50.0, 32.0, 18.0, 64, 36).unwrap());
        std::fs::write(file.path(), Calibration::file_of(&camera) + "nunet_scale: {factor: 0.8}\n").unwrap();
        let geometry = CameraGeometry { calibration: Some(file.path().into()), ..CameraGeometry::default() };
        assert_eq!(CameraResolver::new(&geometry).unwrap().calibrated_scale().unwrap().factor, 0.8);
        let twice = CameraGeometry { factor: Some(0.9), ..geometry };
        let error = CameraResolver::new(&twice).unwrap_err();
        assert_eq!(error.kind(), SourceErrorKind::Argument);
        insta::assert_snapshot!(
            error.to_string().replace(file.path().to_str().unwrap(), "FILE"),
            @"the scale factor 0.9 conflicts with the factor 0.8 in the calibration `FILE`"
        );
    }

    #[test]
    fn a_calibration_that_is_missing_or_none_is_a_bad_argument() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "no: calibration").unwrap();
        for path in [file.path(), Path::new("missing.yaml")] {
            assert_eq!(read_calibration(path).unwrap_err().kind(), SourceErrorKind::Argument);
        }
    }
}
