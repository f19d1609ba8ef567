//! Finds the camera that took a frame: the one that the user named, otherwise the one that the source knows.

use std::io::{self, ErrorKind, Read as _};
use std::path::Path;

use anyhow::Context as _;
use nunet_core::camera::{Calibration, Camera, CameraError, IntrinsicsSpec};
use nunet_core::depth::ScaleSource;
use nunet_core::pipeline::Pipeline;
use nunet_core::plain_file;
use tracing::warn;

use crate::exit::{BadArguments, WithHint};
use crate::options::CameraGeometry;
use crate::source::Frame;

/// The camera of a stream's frames, followed from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct CameraResolver {
    named: Option<Named>,
    /// What the pipeline's camera was made from.
    current: Option<Key>,
    has_warned: bool,
    /// The named camera, if any, fitted a frame.
    fits: bool,
}

/// The camera that the user named.
#[derive(Debug)]
enum Named {
    Intrinsics(IntrinsicsSpec),
    Calibration(Calibration),
}

impl Named {
    fn at_size(&self, (width, height): (u32, u32)) -> Result<Camera, CameraError> {
        match self {
            Self::Intrinsics(spec) => spec.at_size(width, height).map(Camera::pinhole),
            Self::Calibration(calibration) => calibration.at_size(width, height),
        }
    }
}

/// A camera is resolved again when one of these changes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Key {
    size: (u32, u32),
    camera: Option<Camera>,
}

impl CameraResolver {
    /// A camera that the user named takes precedence over that of the source.
    ///
    /// # Errors
    /// The calibration file cannot be read or is not a calibration.
    pub(crate) fn new(geometry: &CameraGeometry) -> anyhow::Result<Self> {
        let named = match (&geometry.calibration, geometry.intrinsics) {
            (Some(path), _) => Some(Named::Calibration(read_calibration(path)?)),
            (None, intrinsics) => intrinsics.map(Named::Intrinsics),
        };
        Ok(Self { named, current: None, has_warned: false, fits: false })
    }

    /// The camera that took `frame`, at the frame's size; `None` if it is unknown.
    ///
    /// # Errors
    /// The named camera does not fit the frame's size.
    pub(crate) fn camera_of(&self, frame: &Frame) -> Result<Option<Camera>, CameraError> {
        let named = self.named.as_ref().map(|named| named.at_size(frame.size)).transpose()?;
        Ok(named.or(frame.camera))
    }

    /// The same, for a stream of frames.
    ///
    /// # Errors
    /// [`BadArguments`] if the camera that the user named does not fit the first frame: it will not fit the next one
    /// either. Otherwise it does not fit this frame; the next frame tries again.
    pub(crate) fn resolve(&mut self, frame: &Frame) -> anyhow::Result<Option<Camera>> {
        match self.camera_of(frame) {
            Err(error) if !self.fits => {
                let text = "the given calibration or intrinsics do not fit the images of the source";
                Err(anyhow::Error::from(error).context(BadArguments(text.into())))
            }
            camera => {
                let camera = camera?;
                self.fits = true;
                Ok(camera)
            }
        }
    }

    /// Passes the camera to the pipeline if it changed. Warns once if the camera is unknown.
    ///
    /// # Errors
    /// As [`CameraResolver::resolve`], or the camera does not fit the network.
    pub(crate) fn update(&mut self, frame: &Frame, pipeline: &mut Pipeline) -> anyhow::Result<()> {
        let key = Key { size: frame.size, camera: frame.camera };
        if self.current == Some(key) {
            return Ok(());
        }
        let camera = self.resolve(frame)?;
        pipeline.set_camera(camera)?;
        self.current = Some(key);
        if camera.is_none() && !std::mem::replace(&mut self.has_warned, true) {
            let training_camera = pipeline.graph().description().camera.is_some();
            let guess = match pipeline.scale().source {
                ScaleSource::AssumedCamera => "metres and points assume the training camera",
                _ if training_camera => "points assume the training camera",
                _ => "points assume a camera of 60 degrees from left to right",
            };
            warn!("no intrinsics: {guess}\nhint: --intrinsics fx,fy,cx,cy or --calibration FILE.yaml");
        }
        Ok(())
    }
}

/// Reads a calibration that the user named.
///
/// # Errors
/// The file cannot be read or is not a calibration.
pub(crate) fn read_calibration(path: &Path) -> anyhow::Result<Calibration> {
    let path_shown = path.display();
    let text = read_start(path).map_err(|error| {
        let message = format!("cannot read the calibration `{path_shown}`");
        WithHint::usage(message, "pass a ROS `camera_info` file in YAML").because(error)
    })?;
    let calibration = Calibration::parse(&text)
        .with_context(|| BadArguments(format!("cannot use the calibration `{path_shown}`")))?;
    if let Some(skew) = calibration.ignored_skew() {
        warn!("calibration `{path_shown}`: {skew}");
    }
    Ok(calibration)
}

/// Reads at most one byte more than a calibration may have. The parser rejects text that is not UTF-8.
fn read_start(path: &Path) -> io::Result<String> {
    let Some(mut file) = plain_file::open(path, Calibration::MAX_BYTES as u64 + 1)? else {
        return Err(io::Error::new(ErrorKind::InvalidInput, "it is not a plain file"));
    };
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
